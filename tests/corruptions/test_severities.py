"""Severities as they are written; the words of corruptions and weathers are tested with them."""

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.corruptions.catalogue import SEVERITIES, parse_severities


def test_one_a_range_and_the_default():
    assert list(parse_severities("weather", "fog:2")) == [2]
    assert list(parse_severities("weather", "fog:2-4")) == [2, 3, 4]
    assert parse_severities("weather", "fog") == SEVERITIES == (1, 2, 3, 4, 5)
    assert parse_severities("weather", "fog", (0,)) == (0,)


@pytest.mark.parametrize("word", ["fog:", "fog:0", "fog:6", "fog:2-1", "fog:1-6", "fog:1:2", "fog: 1"])
def test_what_is_no_severity(word):
    with pytest.raises(ToolkitError, match=f"weather '{word}': severity '.*': expected one of 1"):
        parse_severities("weather", word)
