"""Limits on meshes, checked on a file's own counts before anything is built."""

from pathlib import Path

from toolkit.core.errors import ToolkitError

MAX_FACES = 4_000_000
"""More take over 2 GB to load, for detail that no picture shows."""
MAX_PARTS = 20_000
"""Each takes half a millisecond."""
MAX_CORNERS = 4_096
"""Largest number of corners of a polygon. A finer circle is a mistake, and its slivers slow each ray down."""
SIMPLER = "simplify it (Blender: Decimate; MeshLab: Quadric Edge Collapse Decimation)"


def check_faces(path: Path, count: int) -> None:
    """A `ToolkitError` for more than `MAX_FACES`."""
    if count > MAX_FACES:
        raise ToolkitError(f"{path}: {count:,} faces, more than {MAX_FACES:,}: {SIMPLER}")


def check_parts(path: Path, count: int) -> None:
    """A `ToolkitError` for more than `MAX_PARTS`."""
    if count > MAX_PARTS:
        raise ToolkitError(f"{path}: {count:,} parts, more than {MAX_PARTS:,}: join them before the export")


def check_corners(path: Path, count: int) -> None:
    """A `ToolkitError` for a polygon of more corners than `MAX_CORNERS`."""
    if count > MAX_CORNERS:
        raise ToolkitError(
            f"{path}: a face of {count:,} corners, more than {MAX_CORNERS:,}: triangulate it (Blender: Triangulate)"
        )
