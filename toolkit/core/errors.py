"""The errors that a user can put right."""

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from toolkit.core.text import shorten

LONGEST_SHOWN = 120
FIELD_PATH = re.compile(r"\{([a-z_][a-z0-9_.]*)\}")


class ToolkitError(Exception):
    """What the user gave cannot be used: a single line that says what, where, what was expected and what to do.

    The command line prints the message without a traceback and exits with code 2.
    """


def one_of(kind: str, found: str, expected: list[str]) -> ToolkitError:
    """The error for a name that is not in a list: says what was found and names the nearest known names."""
    from difflib import get_close_matches

    found = shorten(found, LONGEST_SHOWN)
    near = get_close_matches(found, expected, n=3)
    hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(expected)}"
    return ToolkitError(f"no {kind} called '{found}': {hint}")


class FieldError(ToolkitError):
    """A setting that cannot be used; it names fields, and the command line alone turns them into flags.

    Attributes:
        expected: what the fields can hold. Other fields are named in it as `{path}`, such as `{pose.length_mm}`.
        found: the value of each field, by its path. Empty where a value is missing: `expected` then says all.
    """

    def __init__(self, expected: str, found: Mapping[str, object]) -> None:
        self.expected, self.found = expected, dict(found)
        super().__init__(self.spell(str))

    def spell(self, name_of: Callable[[str], str], show: "Callable[[str, object], str] | None" = None) -> str:
        """The message with every field's path replaced by what `name_of` makes of it.

        Args:
            name_of: path -> name.
            show: (name, value) -> both as they are written; by default `name value`.
        """
        show = show or (lambda name, value: f"{name} {show_value(value)}")
        given = " ".join(show(name_of(path), value) for path, value in self.found.items())
        expected = FIELD_PATH.sub(lambda path: name_of(path[1]), self.expected)
        return f"{given}: {expected}" if given else expected

    def within(self, parent: str) -> "FieldError":
        """The same error as seen from the config that holds these fields below `parent`."""
        expected = FIELD_PATH.sub(rf"{{{parent}.\1}}", self.expected)
        return FieldError(expected, {f"{parent}.{path}": value for path, value in self.found.items()})


def show_value(value: object) -> str:
    """A setting's value in words: `0.2 0.42` for a range, `on` for True, `fog:3` for a name with a severity."""
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
    """Within, other people's code reads what other people made: decoders, converters, unpicklers, graphs.

    On damaged or hostile input, such code raises nearly every built-in exception, so all are caught. A `ToolkitError`
    passes as it is.

    Args:
        explain: returns the error to raise for the caught one.
    """
    try:
        yield
    except ToolkitError:
        raise
    except Exception as error:
        raise explain(error) from None


def describe_failure(error: BaseException, longest: int = 200) -> str:
    """What code that is not ours raised, as a single line: its kind and what it says, cut off after so many letters."""
    return f"{error.__class__.__name__}: {' '.join(str(error).split())[:longest]}"
