"""Corruptions asked for in words."""

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.corruptions.catalogue import COMMON, CORRUPTIONS, name_corruptions, parse_corruptions


def test_names_with_severities():
    assert parse_corruptions(["fog:3"]) == (("fog", 3),)
    assert parse_corruptions(["fog:4-5", "snow:1"]) == (("fog", 4), ("fog", 5), ("snow", 1))
    assert parse_corruptions(["fog"]) == tuple(("fog", severity) for severity in (1, 2, 3, 4, 5))
    assert parse_corruptions([]) == ()


def test_families_and_each_once():
    noise = ("gaussian_noise", "shot_noise", "impulse_noise")
    assert parse_corruptions(["noise:2"]) == tuple((name, 2) for name in noise)
    assert parse_corruptions(["shot_noise:2", "noise:2"])[0] == ("shot_noise", 2)
    assert len(parse_corruptions(["shot_noise:2", "noise:2"])) == 3
    assert parse_corruptions(["common:5"]) == tuple((name, 5) for name in COMMON)
    assert len(parse_corruptions(["all"])) == 5 * len(CORRUPTIONS)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("fgo:3", "no corruption called 'fgo': did you mean fog"),
        ("", "no corruption called ''"),
        *((f"fog:{wrong}", f"corruption 'fog:{wrong}': severity '{wrong}'") for wrong in ("0", "6", "", "3-1", "x")),
        ("fog:1:2", "severity '1:2': expected one of 1"),
        ("fog:٣", "severity '٣'"),
    ],
)
def test_what_there_is_not(word, message):
    with pytest.raises(ToolkitError, match=message):
        parse_corruptions([word])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["common"], "common:1-5"),
        (["all:3"], "all:3"),
        (["noise:1-2", "fog:3"], "noise:1-2, fog:3"),
        (["fog:1", "fog:3"], "fog:1, fog:3"),
        (["fog", "snow"], "fog:1-5, snow:1-5"),
    ],
)
def test_corruptions_are_named_by_words_that_ask_for_them(words, said):
    corruptions = parse_corruptions(words)
    assert name_corruptions(corruptions) == said
    assert set(parse_corruptions(said.split(", "))) == set(corruptions)
