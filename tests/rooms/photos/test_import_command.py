"""`toolkit import`: exit codes, what is printed, what is asked, and that it goes on after a kill."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from import_bench import take
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.rooms.photos.commands import ask_person


def call(*arguments, code=0, typed=None):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments], input=typed)
    assert result.exit_code == code, (result.output, result.exception)
    return result


@pytest.mark.slow
def test_an_import_prints_what_came_what_is_missing_and_what_is_next(space, tmp_path):
    photos = tmp_path / "photos [bold]"
    take(photos / "pose_1.jpg", 1)
    result = call("import", photos, "--object", "crate", "--variant", "patched", "--quiet")
    assert "imported 1 photograph" in result.stdout and f"next: toolkit eval {space.captures_dir}" in result.stdout
    rows = [line.split() for line in result.stdout.splitlines() if "crate" in line and "patched" in line]
    words = {row[3]: row for row in rows if len(row) > 3}
    assert "1 of 2" in " ".join(words["patched"]) and "0 of 2" in " ".join(words["unpatched"])
    again = call("import", photos, "--object", "crate", "--variant", "patched", "--quiet")
    assert "imported 0 photographs, 1 imported before" in again.stdout
    assert "not imported again: pose_1.jpg: imported before, as crate/patched/pose_01.jpg" in again.stderr


def test_a_partly_bad_folder_is_exit_code_1_and_json_lists_everything(space, tmp_path):
    take(tmp_path / "photos" / "pose_1.jpg", 1)
    (tmp_path / "photos" / "pose_2.jpg").write_bytes(b"")
    result = call("import", tmp_path / "photos", "--object", "crate", "--variant", "unpatched", "--json", code=1)
    found = json.loads(result.stdout)
    assert found["folder"] == str(space.captures_dir / "real")
    assert [record["path"] for record in found["imported"]] == ["crate/unpatched/pose_01.jpg"]
    assert found["refused"] == [{"path": "pose_2.jpg", "reason": "the file is empty"}]
    missing = {row["variant"]: row["missing"] for row in found["coverage"]}
    assert missing == {"unpatched": [2], "patched": [1, 2]}


@pytest.mark.slow
def test_bad_input_is_one_line_and_exit_code_2(space, tmp_path):
    script = "import sys; sys.argv[0] = 'toolkit'; from toolkit.cli import main; main()"
    for arguments, words in (
        (["none"], "none does not exist"),
        ([str(tmp_path)], "name the folder with the camera's photos"),
    ):
        call_ = [sys.executable, "-c", script, "import", *arguments, "--object", "crate", "--variant", "patched"]
        result = subprocess.run(call_, capture_output=True, text=True, cwd=space.root)
        assert result.returncode == 2 and words in result.stderr and "Traceback" not in result.stderr
        assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.slow
def test_a_doubt_is_asked_only_where_asking_was_wanted(space, tmp_path, monkeypatch):
    take(tmp_path / "photos" / "a_pose_1.jpg", 1), take(tmp_path / "photos" / "b_pose_1.jpg", 2)
    options = ("--object", "crate", "--variant", "patched")
    silent = call("import", tmp_path / "photos", *options, code=1)
    assert "shown as well by" in silent.stderr and "Which" not in silent.output
    asked = call("import", tmp_path / "photos", *options, "--ask", code=1, typed="7\n2\n")
    assert "Which counts?" in asked.output and "'7' is none of them" in asked.output
    assert (space.captures_dir / "real/crate/patched/pose_01.jpg").read_bytes() == (
        tmp_path / "photos" / "b_pose_1.jpg"
    ).read_bytes()


@pytest.mark.parametrize(("typed", "answer"), [("2", "2"), ("s", None), ("", None), ("N", None), (" 1 ", "1")])
def test_an_answer_is_one_of_those_or_none(monkeypatch, typed, answer):
    monkeypatch.setattr("typer.prompt", lambda *_, default, **__: typed or default)
    assert ask_person("Which?", ["1", "2"]) == answer


@pytest.mark.slow
def test_a_kill_in_the_middle_is_gone_on_from(space, tmp_path):
    """A real SIGKILL while photographs are copied: what is there is whole, and the same command ends the work."""
    plan = json.loads(space.plan_file.read_text())
    poses = plan["objects"]["crate"]
    plan["objects"]["crate"] = [{**poses[i % 2], "id": i + 1} for i in range(30)]
    space.plan_file.write_text(json.dumps(plan))
    for i in range(30):
        take(tmp_path / "photos" / f"pose_{i + 1}.png", i)
    options = ["import", str(tmp_path / "photos"), "--object", "crate", "--variant", "unpatched", "--quiet"]
    script = "from toolkit.cli import main; main()"
    manifest = space.captures_dir / "real" / "manifest.jsonl"
    with subprocess.Popen(
        [sys.executable, "-c", script, *options], cwd=space.root, stdout=subprocess.DEVNULL
    ) as process:
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline and process.poll() is None:
            if manifest.is_file() and manifest.read_bytes().count(b"\n") >= 3:
                os.kill(process.pid, signal.SIGKILL)
                break
            time.sleep(0.001)
        process.wait()
    before = manifest.read_bytes().count(b"\n")
    assert before >= 3
    found = json.loads(call(*options[:-1], "--json").stdout)
    assert len(found["imported"]) + len(found["before"]) == 30 and len(found["before"]) in (before, before - 1)
    names = sorted(file.name for file in (manifest.parent / "crate" / "unpatched").glob("pose_*.png"))
    assert names == sorted(f"pose_{i + 1:02d}.png" for i in range(30))
