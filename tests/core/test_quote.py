"""Paths in the commands that the kit proposes."""

import shlex

import pytest

from toolkit.core.text import quote


@pytest.mark.parametrize("path", ["captures", "my captures/real", "it's $HOME", "a;b", "ü/x (1)"])
def test_a_quoted_path_is_one_word_of_a_shell(path):
    assert shlex.split(f"toolkit eval {quote(path)}") == ["toolkit", "eval", path]


def test_a_plain_path_stays_as_it_is():
    assert quote("captures/sim") == "captures/sim"


def test_init_proposes_a_command_that_can_be_pasted(tmp_path, type_toolkit):
    code, out, _ = type_toolkit("init", str(tmp_path / "my space"))
    assert code == 0
    line = next(line for line in out.splitlines() if line.startswith("next: cd "))
    assert shlex.split(line)[1:3] == ["cd", str(tmp_path / "my space")]
