"""Errors that a user can correct."""

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from toolkit.core.text import shorten

LONGEST_SHOWN = 120
FIELD_PATH = re.compile(r"\{([a-z_][a-z0-9_.]*)\}")


class ToolkitError(Exception):
    """Bad input: a single line with what, where, what was expected and what to do.

    The command line prints the message without a traceback and exits with code 2.
    """


def one_of(kind: str, found: str, expected: list[str]) -> ToolkitError:
    """Return the error for an unknown name, with the nearest known names."""
    from difflib import get_close_matches

    found = shorten(found, LONGEST_SHOWN)
    near = get_close_matches(found, expected, n=3)
    hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(expected)}"
    return ToolkitError(f"no {kind} called '{found}': {hint}")


class FieldError(ToolkitError):
    """A setting that cannot be used; it names fields, and the command line writes them as flags.

    Attributes:
        expected: values that the fields can hold. Other fields are written as `{path}`, such as `{pose.length_mm}`.
        found: value of each field by its path; empty if a value is missing.
    """

    def __init__(self, expected: str, found: Mapping[str, object]) -> None:
        self.expected, self.found = expected, dict(found)
        super().__init__(self.spell(str))

    def spell(self, name_of: Callable[[str], str], show: "Callable[[str, object], str] | None" = None) -> str:
        """Return the message with the name of every field.

        Args:
            name_of: path -> name.
            show: (name, value) -> text; by default `name value`.
        """
        show = show or (lambda name, value: f"{name} {show_value(value)}")
        given = " ".join(show(name_of(path), value) for path, value in self.found.items())
        expected = FIELD_PATH.sub(lambda path: name_of(path[1]), self.expected)
        return f"{given}: {expected}" if given else expected

    def within(self, parent: str) -> "FieldError":
        """Return the error for the config that holds these fields below `parent`."""
        expected = FIELD_PATH.sub(rf"{{{parent}.\1}}", self.expected)
        return FieldError(expected, {f"{parent}.{path}": value for path, value in self.found.items()})


def show_value(value: object) -> str:
    """Return a setting's value in words: `0.2 0.42` for a range, `on` for True, `fog:3` for a name with a severity."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple) and [type(item) for item in value] == [str, int]:
        return f"{value[0]}:{value[1]}" if value[1] else str(value[0])
    if isinstance(value, tuple | list):
        return " ".join(show_value(item) for item in value)
    return shorten(str(value), LONGEST_SHOWN)


@contextmanager
def foreign_code(explain: Callable[[Exception], Exception]) -> Iterator[None]:
    """Within, other people's code reads other people's files: decoders, converters, graphs.

    On damaged or hostile input it may raise any exception, so all are replaced by the result of `explain`. A
    `ToolkitError` passes.
    """
    try:
        yield
    except ToolkitError:
        raise
    except Exception as error:
        raise explain(error) from None


def describe_failure(error: BaseException, longest: int = 200) -> str:
    """Return an exception of other code as a single line: its kind and the first letters of its message."""
    return f"{error.__class__.__name__}: {' '.join(str(error).split())[:longest]}"
