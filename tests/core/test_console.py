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


@pytest.fixture
def clock(monkeypatch):
    """The time, [s], which tests move."""
    now = [100.0]
    monkeypatch.setattr("toolkit.core.console.monotonic", lambda: now[0])
    return now


def test_where_stderr_is_no_terminal_a_line_comes_after_ten_seconds_and_then_more_rarely(capsys, clock):
    with progress("Training", 50, done=10) as bar:
        for _ in range(40):
            clock[0] += 1
            bar.advance()
    assert capsys.readouterr().err.splitlines() == [
        "Training: 40 to do, 10 done before",
        "Training: 20 of 50, 1/s, 30 s left", "Training: 40 of 50, 1/s, 10 s left",
    ]  # fmt: skip


def test_a_log_of_an_hour_has_few_lines_and_five_minutes_at_most_between_two(capsys, clock):
    with progress("Training", 3600) as bar:
        for _ in range(3600):
            clock[0] += 1
            bar.advance()
    _, *lines = capsys.readouterr().err.splitlines()
    done = [int(line.split()[1]) for line in lines]
    assert len(done) < 20
    assert max(after - before for before, after in zip(done, [*done[1:], 3600], strict=True)) <= 300


def test_one_thing_alone_is_not_counted_and_what_comes_before_the_first_is_not_in_the_rate(capsys, clock):
    with progress("Validating", 1) as bar:
        clock[0] += 60
        bar.advance()
    with progress("Drawing", 3) as bar:
        bar.advance(0, note="compiling")
        clock[0] += 60
        bar.advance()
        clock[0] += 20
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
