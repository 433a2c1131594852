"""A room that is not there: the road runs without it, and what belongs to it says so in a line."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tiny_network import tiny_classifier, write_photos

import toolkit
from toolkit.boosters.patch_config import RECIPES as PATCH_RECIPES
from toolkit.core import rooms
from toolkit.core.errors import ToolkitError
from toolkit.core.rooms import SHIPPED, find_rooms, load
from toolkit.core.workspace import make_workspace
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.ground_truth import read_labelled_captures
from toolkit.objects.records import write_patch

PACKAGE = Path(toolkit.__file__).parent
ROOMS = sorted(SHIPPED)
MISSING = "put toolkit/rooms/{0} back, or install toolkit-boost again"
HIDE = """
import sys
class Hidden:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "toolkit.rooms.{room}":
            raise ModuleNotFoundError(f"No module named '{{name}}'", name=name)
sys.meta_path.insert(0, Hidden)
from toolkit.cli import main
for line in sys.stdin.read().splitlines():
    sys.argv = ["toolkit", *line.split()]
    try:
        main()
    except SystemExit as ended:
        print(f"\\n= {{ended.code}} {{line}}", file=sys.stderr, flush=True)
"""
BOX = """
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8
"""
ROAD = (
    "init .", "add box.obj --class dice --length-mm 60", "plan --object box --resolution 64 64 --count 2",
    "capture-sim --object box", "print --object box", "eval --model rig18", "runs", "objects", "doctor", "--help",
)  # fmt: skip
ASKED = {
    "benchmarks": {
        "sweep": "sweep", "challenge board x": "challenge", "help transfer": "transfer",
        "train-classifier --data rig --name x --patches x": "patches in training",
    },
    "landing": {"landing fly": "landing", "help landing": "landing"},
    "photos": {"studio": "studio", "import .": "import", "plan --object box --shot-list": "shot list"},
    "worlds": {
        "world list": "world", "train-texture --object box --world city --model rig18": "world",
        "train-patch --object box --weather fog:3": "weather", "capture-sim --object racer": "builtin:racer",
        "train-classifier --data everyday --name x": "everyday",
    },
    "wraps": {
        "wrap --object box": "wrap", "help train-wrap": "train-wrap", "print --wrap box": "printed wrap",
        "capture-sim --object box --variant wrapped": "variant:wrapped",
        "export --object box --variant wrapped": "variant:wrapped",
    },
}  # fmt: skip
"""What each room has, as it is typed -> how the error names it."""
BESIDE = {"wraps": ("plan --object box --shot-list", "sweep distance --object box --values 1.0 --model rig18")}
"""Commands of other rooms that run without a room."""


def run_without(room: str, lines: tuple[str, ...], folder: Path) -> tuple[dict[str, tuple[int, str]], str]:
    """Exit code and last line on stderr of each command, in a process that cannot import the room; and stdout."""
    done = subprocess.run(
        [sys.executable, "-c", HIDE.format(room=room)], input="\n".join(lines), capture_output=True, text=True,
        cwd=folder, check=True,
    )  # fmt: skip
    parts = re.split(r"^= (\d+) (.*)\n", done.stderr, flags=re.MULTILINE)
    said, codes, typed = parts[:-1:3], parts[1::3], parts[2::3]
    lasts = [(text.strip().splitlines() or [""])[-1] for text in said]
    return {line: (int(code), last) for line, code, last in zip(typed, codes, lasts, strict=True)}, done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("room", ROOMS)
def test_the_road_runs_without_a_room(tmp_path, patch_record, room):
    (tmp_path / "box.obj").write_text(BOX)
    pixels = np.random.default_rng(5).integers(0, 256, (12, 12, 3), dtype=np.uint8)
    write_patch(tmp_path / "print/patches", pixels, {**patch_record("box"), "class_name": "dice"})
    runs = (*ROAD, *BESIDE.get(room, ()))
    ended, said = run_without(room, (*runs, *ASKED[room]), tmp_path)
    # the doctor may miss weights on this machine
    assert {line: ended[line] for line in runs if ended[line][0] > (line == "doctor")} == {}
    assert len(list((tmp_path / "captures/sim/box").rglob("*.jpg"))) == 4
    assert (tmp_path / "print/box.pdf").is_file() and (tmp_path / "eval/rig18-sim/report.html").is_file()
    assert "bundled classifier" in said
    hidden = [name for entries in find_rooms()[room].commands.values() for name in entries]
    listed = said[said.index("\nThe road:") :]
    assert "\n  capture-sim " in listed and not [name for name in hidden if f"\n  {name} " in listed]
    for line, what in ASKED[room].items():
        expected = f"error: '{what}' belongs to the room '{room}', which is not installed: {MISSING.format(room)}"
        assert ended[line] == (2, expected), line


def test_a_room_without_one_that_it_needs_is_not_there_either(tmp_path):
    ended, _ = run_without("worlds", ("landing fly", "landign fly", "init d", "plan --workspace d"), tmp_path)
    needed = "error: 'landing' belongs to the room 'landing', which needs the room 'worlds', which is not installed: "
    assert ended["landing fly"] == (2, needed + MISSING.format("worlds"))
    assert ended["landign fly"][1].startswith("error: no command called 'landign': known: ")
    nothing = "error: no object can be rendered: add your own with 'toolkit add MESH --class NAME'"
    assert ended["plan --workspace d"] == (2, nothing)


@pytest.fixture
def hide(monkeypatch):
    """A function (room): it is not there for the core, until the test has ended."""

    def leave_out(hidden: str) -> None:
        kept = {name: room for name, room in rooms._list_rooms().items() if name != hidden}
        monkeypatch.setattr(rooms, "_list_rooms", lambda: kept)
        forget()

    def forget() -> None:
        rooms.find_rooms.cache_clear()
        rooms.list_offers.cache_clear()

    yield leave_out
    monkeypatch.undo()
    forget()


def test_gates_that_nobody_reads_are_a_note(tmp_path, hide):
    space = make_workspace(tmp_path / "w")
    write_photos(space.captures_dir / "real/jet/unpatched", 1)
    inputs = (space.captures_dir, space, tiny_classifier(), EvalConfig())
    hide("photos")
    assert read_labelled_captures(*inputs)[0].notes == ()
    (space.captures_dir / "real/gates.jsonl").write_text("")
    (note,) = read_labelled_captures(*inputs)[0].notes
    assert note.startswith("'failed gates' belongs to the room 'photos', which is not installed: ")
    assert note.endswith(" (real)")


def test_times_without_a_world_are_left_to_whoever_opens_it(hide):
    config = PATCH_RECIPES["default"]
    with pytest.raises(ToolkitError, match="no time of day called 'teatime'"):
        config.with_overrides(times=("teatime",))
    hide("worlds")
    assert config.with_overrides(world="city", times=("teatime",)).times == ("teatime",)
    with pytest.raises(ToolkitError, match="'weather' belongs to the room 'worlds'"):
        config.with_overrides(weather=("fog:3",))


def test_what_the_kit_knows_of_its_rooms_is_what_they_register():
    for name, room in find_rooms().items():
        words = [command.split()[0] for entries in room.commands.values() for command in entries]
        offers = [what for what in room.offers if not what.startswith("values of ")]
        assert sorted({*words, *offers}) == sorted(SHIPPED[name]), name
    assert sorted(find_rooms()) == ROOMS


@pytest.mark.parametrize("room", ROOMS)
def test_every_offer_is_there(room):
    for what, place in find_rooms()[room].offers.items():
        assert load(f"toolkit.rooms.{room}.{place}") is not None, what


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_the_rooms_that_it_says_it_needs_and_no_other(room):
    found = set()
    for file in (PACKAGE / "rooms" / room).rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [one.name for one in node.names] if isinstance(node, ast.Import) else []
            found |= {name.split(".")[2] for name in names if name.startswith("toolkit.rooms.")}
    assert found - {room} == set(find_rooms()[room].needs)


def test_the_core_names_no_module_of_a_room():
    """Not in a string either, which no linter reads; the front door alone lists what it takes from everywhere."""
    core = [file for file in PACKAGE.rglob("*.py") if file.relative_to(PACKAGE).parts[0] != "rooms"]
    named = re.compile(r"toolkit\.rooms\.\w|rooms/\w")
    assert not [file for file in core if named.search(file.read_text(encoding="utf-8"))]
