"""Keys of kept results: no kind and no version of a method can be left out, and older keys stay as they were."""

import ast
import hashlib
import json
from pathlib import Path

import pytest

import toolkit
from toolkit.core.errors import ToolkitError
from toolkit.core.work import INPUTS, NOWHERE, Work, find_made

GIVEN = ("a", 0.5, {"y": 1, "x": [2, 3]}, None)


def digest(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def test_a_key_holds_kind_version_and_every_input():
    assert Work("cell", 4).key(*GIVEN) == digest(["cell", 4, *GIVEN])
    others = [Work("frame", 4).key(*GIVEN), Work("cell", 5).key(*GIVEN), Work("cell", 4).key(*GIVEN[:3])]
    assert len({Work("cell", 4).key(*GIVEN), *others}) == 4


@pytest.mark.parametrize(
    ("work", "held"),
    [
        (Work("cell", 4, old_at=0), [4, *GIVEN]),
        (Work("cell", 1, old_at=2), [*GIVEN[:2], 1, *GIVEN[2:]]),
        (Work("cell", 1, old_at=len(GIVEN)), [*GIVEN, 1]),
        (Work("cell", 1, old_at=NOWHERE), [*GIVEN]),
        (Work("cell", 2, old_at=NOWHERE), ["cell", 2, *GIVEN]),  # a version that is raised is in the key
    ],
)
def test_keys_from_before_they_held_the_kind_are_as_they_were(work, held):
    assert work.key(*GIVEN) == digest(held)


def test_named_inputs_hold_the_version_by_its_name():
    assert Work("shot", 3, old_at="look").key({"mesh": "ab"}) == digest({"mesh": "ab", "look": 3})


def test_no_module_makes_or_compares_keys_beside_it():
    """Fields of this name in models are attributes; as text it stands in the one place that names it."""
    root = Path(toolkit.__file__).parent
    said = [
        file.relative_to(root).as_posix()
        for file in root.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Constant) and node.value == INPUTS
    ]
    assert said == ["core/work.py"]


@pytest.mark.parametrize("spoil", ["missing", "broken", "another key"])
def test_what_an_earlier_run_left_half_written_is_made_again(tmp_path, spoil):
    file, record = tmp_path / "jet.png", tmp_path / "jet.json"
    for path in (file, record):
        path.write_text("{}")

    def read():
        if spoil == "broken" and not file.read_text():
            raise ToolkitError("does not match its record")
        return "jet"

    held = {"key": "ab"}
    assert find_made("ab", read, lambda made: held["key"], file, record) == "jet"
    file.write_text("")
    held["key"] = "cd" if spoil == "another key" else "ab"
    if spoil == "missing":
        record.unlink()
    assert find_made("ab", read, lambda made: held["key"], file, record) is None
