"""The record log: appended line by line, and whole whatever stopped the writer."""

import errno
import json
import os
import signal
import subprocess
import sys

import pytest
from pydantic import BaseModel, Field

from toolkit.core.errors import ToolkitError
from toolkit.core.records import RecordLog


class Row(BaseModel):
    name: str
    value: float = Field(0.0, ge=0)


ROWS = [Row(name="a", value=0.1), Row(name='grö"ße\n\u2028', value=2), Row(name="x" * 300_000)]


@pytest.fixture(params=[False, True], ids=["spaced", "compact"])
def log(request, tmp_path):
    return RecordLog(tmp_path / "below" / "rows.jsonl", Row, compact=request.param)


def test_what_is_appended_is_read_back_in_order(log):
    assert list(log.read()) == []
    log.append(*ROWS[:2])
    log.append(ROWS[2])
    assert list(log.read()) == ROWS
    assert [json.loads(line)["name"] for line in log.file.read_bytes().split(b"\n")[:-1]] == [row.name for row in ROWS]


def test_the_two_ways_to_write_a_line(tmp_path):
    row = Row(name="grö", value=2)
    for compact, line in ((False, '{"name": "grö", "value": 2.0}\n'), (True, '{"name":"grö","value":2.0}\n')):
        log = RecordLog(tmp_path / f"{compact}.jsonl", Row, compact=compact)
        log.append(row)
        assert log.file.read_bytes() == line.encode()


def test_a_file_cut_anywhere_is_read_and_goes_on(log):
    log.append(ROWS[0], ROWS[1])
    whole = log.file.read_bytes()
    first = whole.index(b"\n")
    for length in range(len(whole) + 1):
        log.file.write_bytes(whole[:length])
        kept = ROWS[: (length >= first) + (length >= len(whole) - 1)]
        assert list(log.read()) == kept, length
        log.append(Row(name="next"))
        assert list(log.read()) == [*kept, Row(name="next")], length


def test_a_long_line_that_is_cut_is_dropped_whole(log):
    log.append(*ROWS)
    log.file.write_bytes(log.file.read_bytes()[:-200_000])
    log.append(ROWS[0])
    assert list(log.read()) == [ROWS[0], ROWS[1], ROWS[0]]


def test_the_last_of_each_key_wins(log):
    log.append(Row(name="a"), Row(name="b"), Row(name="a", value=7))
    found = log.read_last(lambda row: row.name)
    assert list(found) == ["a", "b"] and found["a"].value == 7


@pytest.mark.parametrize(
    ("line", "why"),
    [('{"name": 3}', "field 'name'"), ('{"name": "a", "value": -1}', "field 'value'"), ("no json", "Invalid JSON")],
)
def test_a_broken_line_is_named_where_it_is_needed_and_else_passed_over(tmp_path, line, why):
    file = tmp_path / "rows.jsonl"
    file.write_text(f'{{"name": "a"}}\n{line}\n{{"name": "c"}}\n')
    with pytest.raises(ToolkitError, match=rf"rows\.jsonl: line 2 is broken \({why}.*: delete that line$"):
        list(RecordLog(file, Row).read())
    assert [row.name for row in RecordLog(file, Row, required=False).read()] == ["a", "c"]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EACCES])
def test_a_full_disk_is_one_line_and_costs_no_record(log, monkeypatch, code):
    log.append(ROWS[0])

    def fail(_):
        raise OSError(code, os.strerror(code))

    with monkeypatch.context() as patched:
        patched.setattr("toolkit.core.records.os.fsync", fail)
        with pytest.raises(ToolkitError, match=r"cannot write .*rows\.jsonl") as caught:
            log.append(ROWS[1])
    assert "\n" not in str(caught.value)
    log.append(ROWS[1])
    assert ROWS[0] in list(log.read()) and ROWS[1] in list(log.read())


def test_a_writer_that_is_killed_leaves_whole_records(tmp_path):
    file = tmp_path / "rows.jsonl"
    code = (
        "import sys; from pydantic import BaseModel; from toolkit.core.records import RecordLog\n"
        "class Row(BaseModel):\n    name: str\n"
        "log, i = RecordLog(sys.argv[1], Row), 0\n"
        "while True:\n    log.append(Row(name=f'{i} ' + 'x' * 5000)); i += 1; print(i, flush=True)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(file)], stdout=subprocess.PIPE, text=True) as writer:
        for line in writer.stdout:
            if int(line) == 20:
                writer.send_signal(signal.SIGKILL)
                break
        told = [line, *writer.stdout]
    log = RecordLog(file, Row)
    names = [row.name.split()[0] for row in log.read()]
    assert names == [str(i) for i in range(len(names))] and len(names) >= int(told[-1])
    log.append(Row(name="last"))
    assert [row.name for row in log.read()][len(names) :] == ["last"]
