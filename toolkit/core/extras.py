"""Packages of optional extras, loaded when they are needed."""

from importlib import import_module
from types import ModuleType

from toolkit.core.errors import ToolkitError


def import_package(name: str, extra: str, what: str, way_out: str = "") -> ModuleType:
    """Import a package of an optional extra.

    Args:
        name: name of the package.
        extra: extra of the kit that installs it.
        what: what needs it, for the message.
        way_out: what to do without it, for the message.

    Raises:
        ToolkitError: it is not installed.
    """
    # imported at its first use, so that all else works without it
    try:
        return import_module(name)
    except ImportError as error:
        raise ToolkitError(
            f"{what} needs {name}, which is not installed ({error}): pip install '.[{extra}]' in toolkit's folder"
            + (f", or {way_out}" if way_out else "")
        ) from None
