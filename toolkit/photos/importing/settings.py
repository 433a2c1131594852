"""What `toolkit import` was asked to do, and whether that goes together."""

import re
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.workspace import Workspace
from toolkit.rig.variants import VARIANTS

MATCHES = ("auto", "board", "name", "order", "render")
FOLDER_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


@dataclass(frozen=True)
class ImportSettings:
    """How to import.

    Attributes:
        object, variant: what all photographs show; None: their folders, names or the shot list say it.
        pose: of the one photograph that is given.
        match: what tells the pose: auto, board, name, order or render.
        first_shot: number in the shot list of the first photograph's shot, where a part of the list was shot.
        link: hard links where possible, instead of copies.
        replace: a later photograph takes the place of one that is there; the old one is kept aside.
        every_s: of a video, one frame in each so many seconds; None: one per moment of stillness.
        source: folder below captures/.
    """

    object: str | None = None
    variant: str | None = None
    pose: int | None = None
    match: str = "auto"
    first_shot: int | None = None
    link: bool = False
    replace: bool = False
    every_s: float | None = None
    source: str = "real"


def check_settings(workspace: Workspace, settings: ImportSettings) -> list[str]:
    """Check names and that the settings go together; returns notes for the user.

    Raises:
        ToolkitError: an unknown object or way of matching, a variant that is a misspelling of a known one, or settings
            that contradict each other.
    """
    if settings.match not in MATCHES:
        raise one_of("way of matching", settings.match, list(MATCHES))
    if not FOLDER_NAME.fullmatch(settings.source):
        raise ToolkitError(
            f"--source {settings.source}: expected the name of one folder below {workspace.captures_dir}"
        )
    if settings.object is not None:
        workspace.object_spec(settings.object)
    if settings.pose is not None and not (settings.object and settings.variant):
        raise ToolkitError("--pose names the pose of one photograph: say --object and --variant with it")
    if settings.first_shot is not None and (settings.object or settings.variant):
        raise ToolkitError("--first-shot counts in the whole shot list: leave --object and --variant out")
    variant = settings.variant
    if variant is None or variant in VARIANTS:
        return []
    if not FOLDER_NAME.fullmatch(variant):
        raise ToolkitError(f"--variant {variant!r}: expected a name of letters, digits, '-', '_' and '.'")
    known = [*VARIANTS, *workspace.patches(), *workspace.textures()]
    if variant not in known and get_close_matches(variant, known, n=1, cutoff=0.8):
        raise one_of("variant", variant, known)
    return [f"variant '{variant}' is none that the kit knows: nothing is recorded of what is on the object"]


def refuse_captures(workspace: Workspace, paths: list[Path]) -> None:
    """Check that no photograph would be imported from the captures themselves.

    Raises:
        ToolkitError: a path lies in the workspace's captures/, or holds it.
    """
    captures = workspace.captures_dir.resolve()
    for path in paths:
        real = Path(path).resolve()
        if real.is_relative_to(captures) or captures.is_relative_to(real):
            raise ToolkitError(
                f"{path} is, holds or lies in {captures}: name the folder that the camera's photos are in"
            )
