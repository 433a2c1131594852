"""Values of options and arguments that the shell offers: the words of a choice, and names in the workspace."""

import inspect
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, get_args

from typer.models import ArgumentInfo, OptionInfo

from toolkit.core.errors import ToolkitError
from toolkit.core.files import walk_folders
from toolkit.core.rooms import find_offer
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.rig.variants import VARIANTS


def offer_values(command: Callable[..., Any]) -> None:
    """Let the parameters of a command function offer their values."""
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        for mark in get_args(parameter.annotation)[1:]:
            if isinstance(mark, OptionInfo | ArgumentInfo):
                mark.autocompletion = _find_values(parameter.name, mark)


def _find_values(name: str, mark: OptionInfo | ArgumentInfo) -> Callable[..., list[str]] | None:
    choices = (mark.metavar or "").split("|")
    words = [word for word in choices if re.fullmatch(r"[a-z][a-z0-9-]*", word)]
    if len(choices) > 1 and words:
        return _make_offer(lambda space: words)
    flags = {*(getattr(mark, "param_decls", None) or ()), getattr(mark, "default", None)}
    for known, kind, list_names in SOURCES:
        if isinstance(mark, kind) and (known in flags or known == name):
            return _make_offer(list_names)
    # rooms offer more values, such as the names of worlds
    offers = (find_offer(f"values of {str(flag).lstrip('-')}") for flag in (name, *flags))
    return next((_make_offer(list_names) for list_names in offers if list_names), None)


def _make_offer(list_names: Callable[[Workspace], Sequence[str]]) -> Callable[[str], list[str]]:
    def offer(incomplete: str) -> list[str]:
        with suppress(ToolkitError, OSError):  # a shell has no use for a message
            return [name for name in list_names(open_workspace()) if name.startswith(incomplete)]
        return []

    return offer


def _list_runs(space: Workspace) -> list[str]:
    found = (folder for folder, _, names in walk_folders(space.eval_dir) if "summary.json" in names)
    return sorted(folder.relative_to(space.eval_dir).as_posix() for folder in found)


def _list_models(space: Workspace) -> list[str]:
    from toolkit.models.find import BUNDLED_DIR, list_own

    # only the default of torchvision's networks, whose list would take seconds
    bundled = (file.stem for file in BUNDLED_DIR.glob("*.safetensors"))
    return sorted({"resnet18", *bundled, *list_own(space.classifiers_dir)})


SOURCES: tuple[tuple[str, type[OptionInfo | ArgumentInfo], Callable[[Workspace], Sequence[str]]], ...] = (
    ("--object", OptionInfo, lambda space: sorted(space.object_specs())),
    ("--patches", OptionInfo, Workspace.patch_sets),
    ("model", OptionInfo, _list_models),
    ("--variant", OptionInfo, lambda space: [*VARIANTS, *sorted(space.patches()), *sorted(space.textures())]),
    ("first", ArgumentInfo, _list_runs),
    ("second", ArgumentInfo, _list_runs),
    ("names", ArgumentInfo, _list_runs),
)
"""A flag, or the name of an argument's parameter, and a function that lists its values."""
