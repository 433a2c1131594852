"""A user's world of kit pieces: a folder of meshes laid out by a small TOML, as one lays tiles.

pieces = "kaykit-city"      # the folder, beside this file
scale = 4.5                 # from the pieces' units to metres
tile = 2.0                  # side of a cell, in the pieces' units
rows = ["HRH", "BXB"]       # from north to south
[legend]
R = [{ piece = "road_straight", yaw = 90 }]
H = [{ piece = "building_A", class = "building" }]
[[place]]                   # what does not stand on the grid, in metres from its middle
piece = "car_taxi"
at = [3.0, -2.0, 0.1]
yaw = 90
"""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import inside, read_toml
from toolkit.objects.load import SUFFIXES, read_mesh, turn_upright
from toolkit.objects.mesh import Mesh, merge_meshes
from toolkit.objects.spec import axes_of_format
from toolkit.worlds.classes import SceneClass
from toolkit.worlds.own import MAX_PARTS, world_from_mesh
from toolkit.worlds.world import World

ClassName = Literal[
    "other", "ground", "road", "pavement", "grass", "water", "building", "vehicle", "tree", "furniture", "sign"
]
NAMED = {
    "road": SceneClass.ROAD,
    "base": SceneClass.PAVEMENT,
    "building": SceneClass.BUILDING,
    "car": SceneClass.VEHICLE,
    "bush": SceneClass.TREE,
    "tree": SceneClass.TREE,
}
"""What a piece is by how its name begins; anything else is street furniture."""


class Tile(BaseModel):
    """A piece in a cell.

    Attributes:
        piece: name of its file without the ending.
        yaw: degrees counter-clockwise from above.
        at: (right, up) from the middle of the cell and height, in the pieces' units.
        class_name: what it is; by default by its name.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, allow_inf_nan=False)
    piece: str
    yaw: float = 0.0
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    class_name: ClassName | None = Field(None, alias="class")


class KitLayout(BaseModel):
    """A kit's TOML; see the module.

    Attributes:
        pieces: folder of the meshes, in the folder of the TOML.
        scale: metres per unit of the pieces.
        tile: side of a cell in the pieces' units.
        rows: one character per cell, from north to south; a space is an empty cell.
        legend: what each character stands for.
        place: further pieces, `at` in metres from the middle of the grid.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    pieces: str
    scale: float = Field(gt=0)
    tile: float = Field(gt=0)
    rows: list[str] = Field(min_length=1)
    legend: dict[str, list[Tile]]
    place: list[Tile] = []


def load_kit(path: Path, seed: int = 0) -> World:
    """Lay a kit out and make a world of it.

    Raises:
        ToolkitError: a wrong field, a character without legend, a missing piece, or as `world_from_mesh`.
    """
    path = Path(path)
    layout = read_toml(path, KitLayout)
    meshes, classes = [], []
    kit: dict[str, Mesh] = {}
    tiles = _lay(layout, path)
    if not tiles:
        raise ToolkitError(f"{path}: field 'rows': no piece lies on any cell: use the legend's letters")
    if len(tiles) > MAX_PARTS:
        raise ToolkitError(f"{path}: {len(tiles)} pieces, expected at most {MAX_PARTS}: make the grid smaller")
    for tile, x, y, z in tiles:
        if tile.piece not in kit:
            kit[tile.piece] = _read_piece(inside(path.parent, layout.pieces), tile.piece, path)
        mesh = _turn(kit[tile.piece], tile.yaw)
        shift = np.array([x, y, z])
        meshes.append(replace(mesh, vertices=(mesh.vertices * layout.scale + shift).astype(np.float32)))
        classes.append(np.full(len(mesh.faces), _class_of(tile), np.uint8))
    return world_from_mesh(merge_meshes(meshes), str(path), path.stem, seed, np.concatenate(classes))


def _lay(layout: KitLayout, path: Path) -> list[tuple[Tile, float, float, float]]:
    """Every tile with its place in metres."""
    side, depth = layout.tile * layout.scale, len(layout.rows)
    width = max(len(row) for row in layout.rows)
    laid = []
    for j, row in enumerate(layout.rows):
        for i, letter in enumerate(row):
            if letter == " ":
                continue
            if letter not in layout.legend:
                raise ToolkitError(
                    f"{path}: field 'rows': row {j + 1} has '{letter}', the legend has "
                    f"{', '.join(sorted(layout.legend))}"
                )
            x, y = (i - (width - 1) / 2) * side, ((depth - 1) / 2 - j) * side
            for tile in layout.legend[letter]:
                right, up, height = (layout.scale * v for v in tile.at)
                laid.append((tile, x + right, y + up, height))
    return [*laid, *((tile, *tile.at) for tile in layout.place)]


def _read_piece(folder: Path, name: str, path: Path) -> Mesh:
    """A piece, z up, in its own units."""
    if not folder.is_dir():
        raise ToolkitError(f"{path}: field 'pieces': no folder {folder}")
    for suffix in SUFFIXES:
        file = inside(folder, f"{name}{suffix}")
        if file.is_file():
            return turn_upright(read_mesh(file, max_parts=MAX_PARTS), *axes_of_format(file.name))
    known = sorted({file.stem for file in folder.iterdir() if file.suffix in SUFFIXES})
    raise ToolkitError(f"{path}: {one_of('piece', name, known)}")


def _turn(mesh: Mesh, yaw_deg: float) -> Mesh:
    """Turned about z, counter-clockwise from above."""
    cosine, sine = np.round(np.cos(np.radians(yaw_deg)), 9), np.round(np.sin(np.radians(yaw_deg)), 9)
    R = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    return replace(mesh, vertices=mesh.vertices @ R.T, normals=(mesh.normals @ R.T).astype(np.float32))


def _class_of(tile: Tile) -> SceneClass:
    if tile.class_name is not None:
        return SceneClass[tile.class_name.upper()]
    return next((kind for start, kind in NAMED.items() if tile.piece.startswith(start)), SceneClass.FURNITURE)
