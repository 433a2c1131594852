"""How much a mesh may ask for: what a file announces is looked at before anything is built of it."""

from pathlib import Path

from toolkit.core.errors import ToolkitError

MAX_FACES = 4_000_000
"""More take over 2 GB to load, for detail that no picture shows."""
MAX_PARTS = 20_000
"""Each takes half a millisecond."""
SIMPLER = "simplify it (Blender: Decimate; MeshLab: Quadric Edge Collapse Decimation)"


def check_faces(path: Path, count: int) -> None:
    """A `ToolkitError` for more than `MAX_FACES`."""
    if count > MAX_FACES:
        raise ToolkitError(f"{path}: {count:,} faces, more than {MAX_FACES:,}: {SIMPLER}")


def check_parts(path: Path, count: int) -> None:
    """A `ToolkitError` for more than `MAX_PARTS`."""
    if count > MAX_PARTS:
        raise ToolkitError(f"{path}: {count:,} parts, more than {MAX_PARTS:,}: join them before the export")
