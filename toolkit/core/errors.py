"""The errors that a user can mend."""


class ToolkitError(Exception):
    """What the user gave cannot be used: one line that says what, where, what was expected and what to do.

    The command line prints the message without a traceback and exits with code 2.
    """


def one_of(kind: str, found: str, expected: list[str]) -> ToolkitError:
    """The error for a name that is not in a list: says what was found and names the nearest known ones."""
    from difflib import get_close_matches

    near = get_close_matches(found, expected, n=3)
    hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(expected)}"
    return ToolkitError(f"no {kind} called '{found}': {hint}")
