"""Severities 1 (slight) to 5 (severe), as they are written: `fog:3`, `snow:1-5`."""

import re
from collections.abc import Iterable, Sequence

from toolkit.core.errors import ToolkitError

SEVERITIES = (1, 2, 3, 4, 5)
SEVERITY_WORDS = re.compile(r"([1-5])(?:-([1-5]))?")


def parse_severities(kind: str, word: str, default: Sequence[int] = SEVERITIES) -> Sequence[int]:
    """The severities in a word such as `fog:3` or `fog:1-3`.

    Args:
        kind: what errors call it, such as `corruption`.
        word: a name, with or without severities.
        default: of a word that has none.

    Raises:
        ToolkitError: what stands behind the colon is no severity.
    """
    _, colon, after = word.partition(":")
    if not colon:
        return default
    match = SEVERITY_WORDS.fullmatch(after)
    first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
    if first > last:
        raise ToolkitError(
            f"{kind} '{word}': severity '{after}': expected one of 1 (slight) to 5 (severe) or a range such as 1-3"
        )
    return range(first, last + 1)


def list_spans(numbers: Iterable[int]) -> list[str]:
    """`1-3`, `7` of 1, 2, 3, 7 in any order."""
    spans: list[list[int]] = []
    for number in sorted(numbers):
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return [str(first) if first == last else f"{first}-{last}" for first, last in spans]
