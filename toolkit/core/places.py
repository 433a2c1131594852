"""Recognise a workspace, and refuse to write through links in it."""

import os
from pathlib import Path

from toolkit.core.errors import ToolkitError

MARKER = "toolkit.toml"


def is_workspace(folder: Path) -> bool:
    """Return whether a folder has `toolkit.toml`, or is an older workspace: with `rig/`, without source code."""
    if (folder / MARKER).is_file():
        return True
    rig = folder / "rig"
    if not rig.is_dir() or (folder / "__init__.py").exists() or (rig / "__init__.py").exists():
        return False
    return (rig / "objects").is_dir() or not any(rig.glob("*.py"))  # a folder `rig` of tests is no workspace


def check_links(folder: Path) -> None:
    """Raise a `ToolkitError` if a link below a workspace leads to `folder`, which is about to be changed.

    The links of a workspace from somebody else could lead anywhere. Links to a workspace, and outside of a workspace,
    are the user's own and are followed.
    """
    place = Path(folder).absolute()
    # part by part, as each link on the way counts by itself
    real = Path(place.anchor)
    for part in place.parts[1:]:
        below = real.parent if part == ".." else real / part
        if os.path.islink(below):  # noqa: PTH114 -- a null byte or a long name is no link, where `is_symlink` raises
            if any(map(is_workspace, (real, *real.parents))):
                raise ToolkitError(
                    f"{below} is a link: nothing is written or deleted through a link in a workspace: "
                    "put a folder in its place, or move the whole workspace to where there is room"
                )
            below = Path(os.path.realpath(below))  # links in a circle do not raise
        real = below
