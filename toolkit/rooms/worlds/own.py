"""Worlds by name: the built-in ones, and users' own: a mesh, or pieces of a kit that a small TOML lays out as tiles.

It is checked for what a place needs, its ground and free spots are found. Frame: as in `toolkit.rooms.worlds.world`;
the middle of the ground plan is moved to the origin, its ground to 0. The TOML:

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

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from hashlib import sha256
from itertools import islice
from pathlib import Path
from pkgutil import resolve_name
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from toolkit.core.console import notice
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import inside, read_toml
from toolkit.core.workspace import Workspace
from toolkit.objects.limits import MAX_FACES, MAX_PARTS
from toolkit.objects.load import SUFFIXES, read_mesh, turn_upright
from toolkit.objects.mesh import Material, Mesh, cast_rays, make_ray_scene, merge_meshes
from toolkit.objects.spec import axes_of_format
from toolkit.rooms.worlds.world import STANDING, SceneClass, Spot, World

MIN_ACROSS_M, MAX_ACROSS_M = 15.0, 6000.0
MIN_GROUND_SHARE = 0.6
PROBES = 48
"""Rays along each side of the ground plan that look for its ground."""
KERB_M = 0.4
SPOT_HEIGHTS_M = (0.5, 1.5, 3.0)
SPOT_DIRECTIONS = 24
MIN_SPOT_M, MAX_SPOT_M = 2.0, 30.0
MAX_SPOTS = 12
NAMED = {
    "road": SceneClass.ROAD,
    "base": SceneClass.PAVEMENT,
    "building": SceneClass.BUILDING,
    "car": SceneClass.VEHICLE,
    "bush": SceneClass.TREE,
    "tree": SceneClass.TREE,
}
"""Class of a piece by the start of its name; anything else is street furniture."""
WORLDS = {
    "city": "toolkit.rooms.worlds.content.city:build_city",
    "grass": "toolkit.rooms.worlds.content.countryside:build_grass",
    "apron": "toolkit.rooms.worlds.content.countryside:build_apron",
    "harbour": "toolkit.rooms.worlds.content.harbour:build_harbour",
}
"""Name -> the function that builds it from a seed, looked up when it is first asked for."""


def load_mesh_world(path: Path, scale: float = 1.0, seed: int = 0) -> World:
    """A world from a mesh file (GLB, glTF, OBJ, PLY, STL or OFF), in metres once multiplied by `scale`.

    Raises:
        ToolkitError: as `read_mesh`; it has no texture and no colours; its extent fits no place in metres: the message
            names the factor; there is no ground under most of it; there is no free spot.
    """
    path = Path(path)
    mesh = read_mesh(path)
    mesh = turn_upright(mesh, *axes_of_format(path.name))
    return world_from_mesh(
        replace(mesh, vertices=(mesh.vertices * scale).astype(np.float32)), str(path), path.stem, seed
    )


def world_from_mesh(mesh: Mesh, source: str, name: str, seed: int, face_class: np.ndarray | None = None) -> World:
    """Check a mesh in metres, z up, and make a world of it; classes of faces that are no ground may be given."""
    _check_paint(mesh, source)
    _check_extent(mesh, source)
    mesh = share_materials(mesh)
    # centred first: classes and places are found about the middle of the ground
    mesh, ground_z = _centre(mesh, source)
    found = classify_ground(mesh, ground_z)
    if face_class is not None:
        known = face_class != SceneClass.OTHER
        # the ground is found by its shape; a file's own class counts for it only where it says road
        found = np.where(known & ((found != SceneClass.GROUND) | (face_class == SceneClass.ROAD)), face_class, found)
    core = mesh.bounds[:, :2].copy()
    world = World(name, seed, mesh, found.astype(np.uint8), (), None, core)
    spots = find_spots(world, seed)
    if not spots:
        raise ToolkitError(
            f"{source}: no place on its ground is free for {MIN_SPOT_M:g} m around: clear one, or check the scale"
        )
    return replace(world, spots=spots)


def _check_paint(mesh: Mesh, source: str) -> None:
    if all(material.name == "plain" and material.texture.size <= 48 for material in mesh.materials):
        raise ToolkitError(
            f"{source}: a world needs textures or colours, but this has none: export it with its materials "
            "(an OBJ needs its .mtl and pictures beside it)"
        )


def _check_extent(mesh: Mesh, source: str) -> None:
    across = float(max(mesh.size_mm[:2]))  # its unit is the metre here
    if MIN_ACROSS_M <= across <= MAX_ACROSS_M:
        return
    size = f"{across:,.0f}" if across > 100 else f"{across:.3g}"
    unit = "in millimetres? try {scale} 0.001" if across > 300_000 else "in centimetres? try {scale} 0.01"
    why = unit if across > MAX_ACROSS_M else "a model, or in another unit? give the {scale} that makes it metres"
    raise FieldError(
        f"{source}: the world is {size} m across, expected {MIN_ACROSS_M:g} to {MAX_ACROSS_M:g}: is it {why}", {}
    )


def share_materials(mesh: Mesh) -> Mesh:
    """The same mesh with a shared material for all that look alike; exporters repeat them for every part."""
    seen: dict[tuple[str, float, float], int] = {}
    kept: list[Material] = []
    index = []
    hashes: dict[int, str] = {}
    for material in mesh.materials:
        # the picture's bytes, hashed once for each texture object, decide what looks alike
        sheet = hashes.setdefault(
            id(material.texture), sha256(np.ascontiguousarray(material.texture).tobytes()).hexdigest()
        )
        key = f"{sheet}{material.texture.shape}", material.roughness, material.metallic
        if key not in seen:
            seen[key] = len(kept)
            kept.append(material)
        index.append(seen[key])
    return replace(mesh, materials=tuple(kept), face_material=np.array(index, np.int32)[mesh.face_material])


def _probe(mesh: Mesh, upwards: bool) -> tuple[np.ndarray, np.ndarray]:
    """Heights (p, p) that a grid of vertical rays meets first, NaN where none, and their (x, y)."""
    low, high = mesh.bounds
    x, y = (np.linspace(low[k], high[k], PROBES + 2)[1:-1] for k in (0, 1))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), -1)
    rays = np.zeros((*grid.shape[:2], 6), np.float32)
    rays[..., :2] = grid
    rays[..., 2] = low[2] - 1 if upwards else high[2] + 1
    rays[..., 5] = 1 if upwards else -1
    way = cast_rays(make_ray_scene(mesh), rays)
    z = rays[..., 2] + way * rays[..., 5]
    return np.where(np.isfinite(way), z, np.nan), grid


def _centre(mesh: Mesh, source: str) -> tuple[Mesh, np.ndarray]:
    """Middle to the origin, median ground to 0; with the lowest surface (p, p) on a grid over its plan."""
    # from below: trees and bridges hide the ground from above
    lowest, _ = _probe(mesh, upwards=True)
    share = float(np.isfinite(lowest).mean())
    if share < MIN_GROUND_SHARE:
        raise ToolkitError(
            f"{source}: no ground: only {share:.0%} of its plan has anything under it, expected at least "
            f"{MIN_GROUND_SHARE:.0%}: add a plane to stand on"
        )
    low, high = mesh.bounds
    upper = _upper_ground(mesh, lowest)
    shift = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, float(np.nanmedian(upper))])
    return replace(mesh, vertices=(mesh.vertices - shift).astype(np.float32)), upper - shift[2]


def _upper_ground(mesh: Mesh, lowest: np.ndarray) -> np.ndarray:
    """(p, p) height of the lowest surface that faces up: what stands on a slab stands on its upper side."""
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    up = normal[:, 2] > 0.6 * np.linalg.norm(normal, axis=1)
    if not up.any():
        return lowest
    shell = replace(mesh, faces=mesh.faces[up], face_material=mesh.face_material[up])
    low, high = mesh.bounds
    outline = np.array([[low[0], low[1], low[2]], [high[0], high[1], high[2]]], np.float32)
    used = np.concatenate([shell.vertices, outline])  # the grid of probes stays where it was
    heights, _ = _probe(replace(shell, vertices=used), upwards=True)
    return np.where(np.isfinite(heights), heights, lowest)


def classify_ground(mesh: Mesh, ground_z: np.ndarray) -> np.ndarray:
    """(m,) ground for what faces up about as low as anything near it, roofs above it, buildings else."""
    # a face looks up if its normal is within 53 degrees of the vertical
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    up = normal[:, 2] > 0.6 * np.linalg.norm(normal, axis=1)
    centre = corners.mean(axis=1)
    # the probe's cell that each face lies in
    low, high = mesh.bounds
    cell = (centre[:, :2] - low[:2]) / np.maximum(high[:2] - low[:2], 1e-6) * (PROBES + 1) - 1
    index = np.clip(np.round(cell).astype(int), 0, PROBES - 1)
    padded = np.pad(np.where(np.isnan(ground_z), np.inf, ground_z), 1, constant_values=np.inf)
    # the lowest of nine cells: a house that fills its own has ground beside it
    near = np.min([padded[i : i + PROBES, j : j + PROBES] for i in range(3) for j in range(3)], axis=0)
    # height above the lowest ground nearby
    height = centre[:, 2] - near[index[:, 0], index[:, 1]]
    ground = up & (height < KERB_M)
    return np.where(ground, SceneClass.GROUND, np.where(up, SceneClass.ROOF, SceneClass.BUILDING))


def find_spots(world: World, seed: int) -> tuple[Spot, ...]:
    """Up to `MAX_SPOTS` free places on the ground, the widest first, none in another's circle."""
    rng = np.random.default_rng([seed, 40])
    low, high = world.core
    candidates = rng.uniform(low, high, (600, 2))
    z = world.ground_height(candidates)
    candidates, z = candidates[np.isfinite(z)], z[np.isfinite(z)]
    if not len(candidates):
        return ()
    angle = np.linspace(0, 2 * np.pi, SPOT_DIRECTIONS, endpoint=False)
    ways = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(SPOT_DIRECTIONS)])
    scene = make_ray_scene(world.mesh)
    origin = np.column_stack([candidates, z])
    free = np.full(len(origin), MAX_SPOT_M)
    for height in SPOT_HEIGHTS_M:
        rays = np.zeros((len(origin), SPOT_DIRECTIONS, 6), np.float32)
        rays[..., :3] = (origin + [0, 0, height])[:, None]
        rays[..., 3:] = ways
        free = np.minimum(free, cast_rays(scene, rays).min(axis=1))
    # open sky is asked for: no arcade or bridge above
    above = np.column_stack([origin + [0, 0, SPOT_HEIGHTS_M[0]], np.tile([0.0, 0.0, 1.0], (len(origin), 1))])
    covered = np.isfinite(cast_rays(scene, above))
    # where the world ends nothing is met, and no ray would say so
    edge = np.minimum(candidates - low, high - candidates).min(axis=1)
    free = np.where(covered, 0.0, np.minimum(np.minimum(free, edge), _gap_to_corners(world, candidates)))
    spots: list[Spot] = []
    # the widest first; equal ones in the order of their draw, on every machine
    for k in np.argsort(-free, kind="stable"):
        if free[k] < MIN_SPOT_M or len(spots) == MAX_SPOTS:
            break
        x, y = (float(v) for v in np.round(candidates[k], 3))
        if all(np.hypot(x - s.position[0], y - s.position[1]) > s.free_radius_m for s in spots):
            # nine tenths of what was measured, down to whole centimetres
            radius = float(np.floor(free[k] * 90) / 100)
            spots.append(
                Spot(f"ground-{len(spots) + 1}", "ground", (x, y, round(float(z[k]), 3)), radius, 0.0, "ground")
            )
    return tuple(spots)


def _gap_to_corners(world: World, places: np.ndarray) -> np.ndarray:
    """(n,) distance from places (n, 2) to the next corner of what stands there: posts slip between rays."""
    from scipy.spatial import cKDTree

    things = ~np.isin(world.face_class, [int(kind) for kind in STANDING])
    corners = world.mesh.vertices[np.unique(world.mesh.faces[things])]
    low = corners[:, 2] <= world.ground_height(corners) + KERB_M
    if low.all():
        return np.full(len(places), np.inf)
    return cKDTree(corners[~low, :2]).query(places)[0]


ClassName = Literal[
    "other", "ground", "road", "pavement", "grass", "water", "building", "vehicle", "tree", "furniture", "sign"
]


class KitPiece(BaseModel):
    """A piece in a cell.

    Attributes:
        piece: file name without its ending.
        yaw: rotation, degrees counter-clockwise from above.
        at: shift (right, up) from the middle of the cell, and height, in the pieces' units.
        class_name: class of the piece; by default from its name.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, allow_inf_nan=False)
    piece: str
    yaw: float = 0.0
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    class_name: ClassName | None = Field(None, alias="class")


class KitLayout(BaseModel):
    """A kit's TOML; see the module.

    Attributes:
        pieces: folder of the meshes, inside the folder of the TOML.
        scale: metres per unit of the pieces.
        tile: side of a cell in the pieces' units.
        rows: a character per cell, from north to south; a space is an empty cell.
        legend: pieces for each character.
        place: more pieces, with `at` in metres from the middle of the grid.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    pieces: str
    scale: float = Field(gt=0)
    tile: float = Field(gt=0)
    rows: list[str] = Field(min_length=1)
    legend: dict[str, list[KitPiece]]
    place: list[KitPiece] = []


def load_kit(path: Path, seed: int = 0) -> World:
    """Lay a kit out and make a world of it.

    Raises:
        ToolkitError: a wrong field, a character without legend, a missing piece, or as `world_from_mesh`.
    """
    path = Path(path)
    layout = read_toml(path, KitLayout)
    # every piece's class goes with its faces: names say more than the shape
    meshes, classes, n_faces = [], [], 0
    kit: dict[str, Mesh] = {}
    # no more than needed to see that they are too many
    tiles = list(islice(_lay(layout, path), MAX_PARTS + 1))
    if not tiles:
        raise ToolkitError(f"{path}: field 'rows': every cell is empty: name letters of the legend")
    if len(tiles) > MAX_PARTS:
        raise ToolkitError(f"{path}: more than {MAX_PARTS:,} pieces: make the grid smaller")
    for tile, x, y, z in tiles:
        if tile.piece not in kit:
            kit[tile.piece] = _read_piece(inside(path.parent, layout.pieces), tile.piece, path)
        # each piece is read once, then turned and moved to its cells
        mesh = _turn(kit[tile.piece], tile.yaw)
        n_faces += len(mesh.faces)
        if n_faces > MAX_FACES:
            raise ToolkitError(f"{path}: more than {MAX_FACES:,} faces in all: make the grid smaller")
        shift = np.array([x, y, z])
        meshes.append(replace(mesh, vertices=(mesh.vertices * layout.scale + shift).astype(np.float32)))
        classes.append(np.full(len(mesh.faces), _class_of(tile), np.uint8))
    return world_from_mesh(merge_meshes(meshes), str(path), path.stem, seed, np.concatenate(classes))


def _lay(layout: KitLayout, path: Path) -> Iterator[tuple[KitPiece, float, float, float]]:
    """Every tile with its place in metres."""
    # the pieces' units become metres here
    side, depth = layout.tile * layout.scale, len(layout.rows)
    width = max(len(row) for row in layout.rows)
    for j, row in enumerate(layout.rows):
        for i, letter in enumerate(row):
            if letter == " ":
                continue
            if letter not in layout.legend:
                raise ToolkitError(
                    f"{path}: field 'rows': row {j + 1} has '{letter}', the legend has "
                    f"{', '.join(sorted(layout.legend))}"
                )
            # rows from the north, the layout's middle at the origin
            x, y = (i - (width - 1) / 2) * side, ((depth - 1) / 2 - j) * side
            for tile in layout.legend[letter]:
                right, up, height = (layout.scale * v for v in tile.at)
                yield tile, x + right, y + up, height
    # pieces that do not stand on the grid are given in metres already
    yield from ((tile, *tile.at) for tile in layout.place)


def _read_piece(folder: Path, name: str, path: Path) -> Mesh:
    """A piece, z up, in its own units."""
    if not folder.is_dir():
        raise ToolkitError(f"{path}: field 'pieces': no folder {folder}")
    for suffix in SUFFIXES:
        file = inside(folder, f"{name}{suffix}")
        if file.is_file():
            return turn_upright(read_mesh(file), *axes_of_format(file.name))
    known = sorted({file.stem for file in folder.iterdir() if file.suffix in SUFFIXES})
    raise ToolkitError(f"{path}: {one_of('piece', name, known)}")


def _turn(mesh: Mesh, yaw_deg: float) -> Mesh:
    """Turned about z, counter-clockwise from above."""
    cosine, sine = np.round(np.cos(np.radians(yaw_deg)), 9), np.round(np.sin(np.radians(yaw_deg)), 9)
    R = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    return replace(mesh, vertices=mesh.vertices @ R.T, normals=(mesh.normals @ R.T).astype(np.float32))


def _class_of(tile: KitPiece) -> SceneClass:
    if tile.class_name is not None:
        return SceneClass[tile.class_name.upper()]
    return next((kind for start, kind in NAMED.items() if tile.piece.startswith(start)), SceneClass.FURNITURE)


@lru_cache(maxsize=2)
def build_world(name: str, seed: int = 0) -> World:
    """Return a world of `WORLDS`; the latest are kept; raises a `ToolkitError` if there is no such world."""
    if name not in WORLDS:
        raise one_of("world", name, list(WORLDS))
    world: World = resolve_name(WORLDS[name])(seed)
    return world


def load_world(path: Path, scale: float = 1.0, seed: int = 0) -> World:
    """A user's own world: a mesh file, or a TOML that lays out the pieces of a kit.

    Args:
        path: GLB, glTF, OBJ, PLY, STL or OFF; or a TOML, see `toolkit.rooms.worlds.own`.
        scale: from the mesh's units to metres; a TOML states its own.
        seed: of the spots that are looked for.

    Raises:
        ToolkitError: the file cannot be used as a world; the message says why and what to do.
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        return load_mesh_world(path, scale, seed)
    # a scale on the command line and another in the file could only contradict each other
    if scale != 1.0:
        raise ToolkitError(f"{path}: a kit's scale stands in its file, found another scale: correct 'scale' there")
    return load_kit(path, seed)


def list_own_worlds(space: Workspace) -> dict[str, Path]:
    """A workspace's own worlds by name: `rig/worlds/NAME.toml`, or a mesh; of two files of the same name the TOML."""
    files = [file for suffix in (*SUFFIXES, ".toml") for file in sorted(space.worlds_dir.glob(f"*{suffix}"))]
    return {file.stem: file for file in files if file.is_file()}


def list_names(space: Workspace) -> list[str]:
    """Return the names of all worlds, built in and the workspace's own, for the shell."""
    return sorted({*WORLDS, *list_own_worlds(space)})


def open_world(space: Workspace, world: str, seed: int = 0, scale: float = 1.0) -> World:
    """A world by its name, built in or the workspace's own, or by the path of a file.

    Args:
        space: whose worlds are known; its own win.
        seed: of a built-in world, or of the free spots of another.
        scale: from a mesh file's units to metres.

    Raises:
        ToolkitError: there is no such world, or its file cannot be used as a world.
    """
    # a path, or a name in the workspace, comes before the built-in worlds
    own = list_own_worlds(space)
    file = own.get(world) or Path(world)
    if world in own or file.suffix.lower() in (*SUFFIXES, ".toml"):
        return load_world(file if file.is_file() else space.root / file, scale, seed)
    if scale != 1.0:
        raise FieldError(f"the world {world} is in metres: a scale is for your own mesh", {"scale": scale})
    if world == "studio":
        raise ToolkitError("the studio is a table top, no world: see it with 'toolkit plan' and 'toolkit capture-sim'")
    if world not in WORLDS:
        raise one_of("world", world, [*WORLDS, *own])
    if world == "city":
        notice("building the city: some seconds")
    return build_world(world, seed)
