"""Corruptions as they are asked for on a command line: `fog:3`, `noise:1-3`, `common`."""

import re
from collections.abc import Sequence

from toolkit.corruptions.corrupt import SEVERITIES
from toolkit.corruptions.sources import choose_names
from toolkit.errors import ToolkitError

SEVERITY_WORDS = re.compile(r"([1-5])(?:-([1-5]))?")


def parse_corruptions(words: Sequence[str]) -> tuple[tuple[str, int], ...]:
    """Names with severities from words such as `fog:3`, `noise:1-3` and `common`, in their order, each once.

    Args:
        words: a corruption, a family, `common` (the fifteen) or `all` (the nineteen), with `:SEVERITY` or
            `:FIRST-LAST`; without, all five.

    Returns:
        (name, severity) of each.

    Raises:
        ToolkitError: there is no such corruption or severity.
    """
    pairs = [
        (name, severity)
        for word in words
        for name in choose_names([word.partition(":")[0]])
        for severity in _parse_severities(word)
    ]
    return tuple(dict.fromkeys(pairs))


def _parse_severities(word: str) -> Sequence[int]:
    _, colon, after = word.partition(":")
    if not colon:
        return SEVERITIES
    match = SEVERITY_WORDS.fullmatch(after)
    first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
    if first > last:
        raise ToolkitError(
            f"corruption '{word}': severity '{after}': expected one of 1 (slight) to 5 (severe) or a range such as 1-3"
        )
    return range(first, last + 1)
