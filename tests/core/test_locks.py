"""A lock per folder: one run at a time, whoever dies."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.records import LOCK, hold_folder

HOLD = """
import sys, time
from pathlib import Path
from toolkit.core.records import hold_folder
with hold_folder(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(float(sys.argv[2]))
"""


def start(folder, seconds):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder), str(seconds)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "held\n"
    return process


def test_a_second_run_waits_and_says_for_whom(tmp_path, capsys):
    first = start(tmp_path, 0.6)
    began = time.monotonic()
    with hold_folder(tmp_path):
        assert first.wait(5) == 0 and 0.2 < time.monotonic() - began < 5
    assert f"waiting until process {first.pid} (toolkit" in capsys.readouterr().err.replace("\n", " ")
    assert not list(tmp_path.iterdir()), "nothing stays behind"


def test_the_lock_names_the_command_that_holds_it(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["toolkit", "train-patch", "--object", "racer"])
    with hold_folder(tmp_path):
        assert (tmp_path / LOCK).read_text() == f"{os.getpid()} (toolkit train-patch)"


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_nobody_waits_for_the_dead(tmp_path, how):
    first = start(tmp_path, 60)
    first.send_signal(how)
    first.wait(5)
    began = time.monotonic()
    with hold_folder(tmp_path):
        assert time.monotonic() - began < 30  # of the 60 for which it would have held it
    assert not (tmp_path / LOCK).exists()


def _count(folder, rounds):
    file = folder / "count"
    for _ in range(rounds):
        with hold_folder(folder):
            count = int(file.read_text())
            time.sleep(0.001)
            file.write_text(str(count + 1))


def test_many_runs_never_meet(tmp_path):
    """Each holder removes the lock's file, while others wait for it: none slips in."""
    (tmp_path / "count").write_text("0")
    context = multiprocessing.get_context("fork")
    processes = [context.Process(target=_count, args=(tmp_path, 40)) for _ in range(5)]
    for one in processes:
        one.start()
    for one in processes:
        one.join(30)
    assert (tmp_path / "count").read_text() == "200"


def test_the_same_thread_goes_through_and_another_waits(tmp_path):
    order = []

    def other():
        with hold_folder(tmp_path):
            order.append("other")

    with hold_folder(tmp_path), hold_folder(tmp_path / "." / "x" / ".."):
        thread = threading.Thread(target=other)
        thread.start()
        time.sleep(0.1)
        order.append("mine")
    thread.join(5)
    assert order == ["mine", "other"]


def test_a_folder_that_was_made_for_nothing_goes_again(tmp_path):
    with pytest.raises(ZeroDivisionError), hold_folder(tmp_path / "new"):
        raise ZeroDivisionError
    with hold_folder(tmp_path / "kept"):
        (tmp_path / "kept" / "file").write_text("")
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


def test_a_link_in_the_locks_place_is_refused(tmp_path):
    (tmp_path / "precious").write_text("mine")
    (tmp_path / LOCK).symlink_to("precious")
    with pytest.raises(ToolkitError, match="it is a link, which is not followed"), hold_folder(tmp_path):
        pass
    assert (tmp_path / "precious").read_text() == "mine"


def test_a_second_name_of_a_file_in_the_locks_place_does_not_empty_it(tmp_path):
    (tmp_path / "plan.json").write_text("a week's work")
    (tmp_path / LOCK).hardlink_to(tmp_path / "plan.json")
    with pytest.raises(ToolkitError, match=r"\.lock: the file has a second name"), hold_folder(tmp_path):
        pass
    assert (tmp_path / "plan.json").read_text() == "a week's work"
    (tmp_path / LOCK).unlink()
    os.mkfifo(tmp_path / LOCK)
    with pytest.raises(ToolkitError, match=r"\.lock: it is a pipe or a device"), hold_folder(tmp_path):
        pass


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_may_not_be_written_is_said(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(ToolkitError, match="permission denied"), hold_folder(tmp_path):
        pass
