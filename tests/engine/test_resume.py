"""The one loop: what is there is not done again, what fails is listed, and a run that cannot work ends."""

import engine_work
import pytest
from pydantic import BaseModel

from toolkit.core.errors import ToolkitError
from toolkit.engine.local import InProcess, LocalPool
from toolkit.engine.units import Unit, WorkLog, cut_groups, run_resumable


class Row(BaseModel):
    name: str
    value: int


def open_cache(folder, wanted):
    return WorkLog(folder / "rows.jsonl", Row, lambda row: [(row.name, row.value)], wanted)


def run(folder, errors=(), wanted="abcdef", engine=None, keep=None):
    """A run whose units fail with `errors`, one each from the first one on, and give their number else."""
    wanted = {name: at for at, name in enumerate(wanted)}
    cache = open_cache(folder, wanted)
    missing = cache.find_missing(wanted)
    wrong = dict(zip(missing, errors, strict=False))
    units = (
        Unit((name,), engine_work.fail_at, (at, at if name in wrong else None, wrong.get(name)), name)
        for name, at in missing.items()
    )
    keep = keep or (lambda name, at, result: cache.add(Row(name=name, value=result)))
    return run_resumable("counting", wanted, missing, units, keep, engine or InProcess(), folder), cache.known


@pytest.mark.parametrize("engine", [InProcess(), LocalPool(1)], ids=["here", "pool"])
def test_what_fails_is_listed_and_tried_again_and_the_rest_is_kept(tmp_path, engine):
    with engine:
        ran, known = run(tmp_path, [ToolkitError("torn")], engine=engine)
    assert (ran.made, ran.kept, ran.failed) == (5, 0, (("a", "torn"),)) and "a" not in known
    ran, known = run(tmp_path)
    assert (ran.made, ran.kept, ran.failed) == (1, 5, ()) and known == dict(zip("abcdef", range(6), strict=True))


@pytest.mark.parametrize("engine", [InProcess(), LocalPool(1)], ids=["here", "pool"])
def test_the_traceback_of_an_error_that_nobody_foresaw_is_kept_and_its_file_is_named(tmp_path, engine):
    with engine:
        ran, _ = run(tmp_path, [KeyError("x"), ToolkitError("torn"), ZeroDivisionError()], engine=engine)
    file = tmp_path / "failures.log"
    assert [reason.endswith(f"(traceback in {file})") for _, reason in ran.failed] == [True, False, True]
    assert ran.failed[0][1].startswith("KeyError in engine_work.py, line ")
    first, second = file.read_text().split("\n\n")
    assert first.startswith("a\nTraceback ") and "in fail_at" in first and first.endswith("KeyError: 'x'")
    assert run(tmp_path)[0].failed == () and not file.exists(), "the next run mends it"
    assert second.startswith("c\nTraceback ") and "ZeroDivisionError" in second and "torn" not in first + second


def test_a_run_without_such_an_error_writes_no_log(tmp_path):
    run(tmp_path, [ToolkitError("torn")])
    assert not (tmp_path / "failures.log").exists()


def test_units_of_what_is_there_are_not_even_made(tmp_path):
    run(tmp_path)
    units = (pytest.fail("made") for _ in "a")
    ran = run_resumable("counting", {"a": 0}, {}, units, pytest.fail, InProcess(), tmp_path)
    assert (ran.made, ran.kept) == (0, 1)


def test_a_run_whose_first_units_fail_alike_ends(tmp_path):
    with pytest.raises(ToolkitError, match="damaged"):
        run(tmp_path, [ToolkitError("damaged")] * 3)
    assert run(tmp_path, [ToolkitError(f"damaged {at}") for at in range(3)])[0].made == 3
    assert run(tmp_path, [ToolkitError("damaged")] * 2)[0].made == 1


def test_a_run_that_did_nothing_is_an_error_unless_there_is_some_from_before(tmp_path):
    with pytest.raises(ToolkitError, match="torn"):
        run(tmp_path, [ToolkitError("torn")] * 2, "ab")
    run(tmp_path, (), "a")
    assert run(tmp_path, [ToolkitError("torn")] * 2, "ab")[0].failed == (("b", "torn"),)


def test_an_interrupted_run_keeps_what_came_before(tmp_path):
    cache = open_cache(tmp_path, "abcdef")

    def stop(name, at, result):
        if name == "c":
            raise KeyboardInterrupt
        cache.add(Row(name=name, value=result))

    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, keep=stop)
    assert (run(tmp_path)[0].made, run(tmp_path)[0].kept) == (4, 6)


def test_an_engine_that_raises_ends_with_the_first_error(tmp_path):
    with pytest.raises(KeyError):
        run(tmp_path, [KeyError("x")], engine=InProcess(raises=True))


def test_a_log_is_read_by_key_wherever_that_stands_in_its_line(tmp_path):
    """As a run of another version, or a hand, may have written it."""
    lines = ['{"value": 1, "name": "a"}', '  {"name":"b","value":2}', '{"name": "b", "value": 3}', "torn"]
    (tmp_path / "rows.jsonl").write_text("\n".join([*lines, '{"name": "x", "value": 9}', ""]))
    assert open_cache(tmp_path, "abc").known == {"a": 1, "b": 3}


def test_groups_are_cut_where_they_change_and_where_they_are_full():
    items = dict(zip("abcdef", "xxxyyx", strict=True))
    found = [("".join(keys), "".join(own)) for keys, own in cut_groups(items, str, 2)]
    assert found == [("ab", "xx"), ("c", "x"), ("de", "yy"), ("f", "x")]
