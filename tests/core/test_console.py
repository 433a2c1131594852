"""Quiet is a state of the console, which nobody passes on."""

import pytest
from typer.testing import CliRunner

from toolkit.cli.app import make_single
from toolkit.core.console import notice, progress, quietly


def say_all() -> None:
    notice("a notice [with brackets]")
    with progress("Working", 3) as bar:
        bar.advance()


def test_notices_and_progress_are_on_stderr_unless_quiet(capsys):
    say_all()
    told = capsys.readouterr()
    assert told.out == "" and told.err.splitlines() == ["a notice [with brackets]", "Working: 3 to do"]
    with quietly():
        say_all()
        with quietly(False):
            say_all()
    assert capsys.readouterr() == ("", "")
    say_all()
    assert "a notice" in capsys.readouterr().err


def test_where_stderr_is_no_terminal_a_line_comes_every_ten_seconds(capsys, monkeypatch):
    now = [100.0]
    monkeypatch.setattr("toolkit.core.console.monotonic", lambda: now[0])
    with progress("Training", 50, done=10) as bar:
        for _ in range(40):
            now[0] += 0.8
            bar.advance()
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "Training: 40 to do, 10 done before"
    assert lines[1:] == [
        "Training: 23 of 50, 1.25/s, 22 s left", "Training: 36 of 50, 1.25/s, 11 s left",
        "Training: 49 of 50, 1.25/s, 1 s left",
    ]  # fmt: skip


def test_one_thing_alone_is_not_counted_and_what_comes_before_the_first_is_not_in_the_rate(capsys, monkeypatch):
    now = [100.0]
    monkeypatch.setattr("toolkit.core.console.monotonic", lambda: now[0])
    with progress("Validating", 1) as bar:
        now[0] += 60
        bar.advance()
    with progress("Drawing", 3) as bar:
        bar.advance(0, note="compiling")
        now[0] += 60
        bar.advance()
        now[0] += 20
        bar.advance()
    assert capsys.readouterr().err.splitlines() == [
        "Validating …", "Drawing: 3 to do", "Drawing: 1 of 3", "Drawing: 2 of 3, 0.05/s, 20 s left",
    ]  # fmt: skip


def test_quiet_ends_with_an_error(capsys):
    with pytest.raises(ValueError), quietly():
        raise ValueError
    say_all()
    assert "a notice" in capsys.readouterr().err


def test_the_option_holds_until_its_command_has_ended():
    def work() -> None:
        say_all()

    app = make_single(work)
    told = [CliRunner().invoke(app, arguments).stderr for arguments in ([], ["--quiet"], ["-q"], [])]
    assert [("a notice" in text) for text in told] == [True, False, False, True]
