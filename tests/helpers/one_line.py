"""What is refused says why in one line."""

from collections.abc import Callable

import pytest

from toolkit.core.errors import ToolkitError


def error_of(call: Callable[[], object]) -> str:
    """The message of the `ToolkitError` that the call ends in."""
    with pytest.raises(ToolkitError) as caught:
        call()
    assert "\n" not in str(caught.value)
    return str(caught.value)
