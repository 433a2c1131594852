"""An object at its real size in a world: where it may stand, and all that a renderer needs of it there.

Frame: as in `toolkit.rooms.worlds.world`, metres; the object's own as on the table, its base's centre at the origin.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.workspace import Workspace
from toolkit.objects.load import load_object, scale_to_world
from toolkit.objects.mesh import Mesh, cast_rays
from toolkit.rig.scene import Scene, Stand
from toolkit.rig.variants import apply_booster, find_booster
from toolkit.rooms.worlds.conditions import DRY, ObjectInWorld
from toolkit.rooms.worlds.sky import Sky
from toolkit.rooms.worlds.world import Spot, World

FAN_HEIGHTS_M = (0.5, 1.5, 3.0, 5.0)
FAN_DIRECTIONS = 96
ABOVE_M = 1.0
"""Rays that look for what an object stands on start so far above its spot: below awnings, above kerbs."""
CONTACT = 1e-3
"""An object stands on its vertices within this share of its length above its base."""
KERB_M = 0.3
BOX_RAYS = 24
"""Along each side of an object's box."""


@dataclass(frozen=True)
class Placed:
    """An object in its place, ready to be rendered: see `toolkit.rooms.worlds.picture.make_renderer`."""

    mesh: Mesh  # at its real size, metres, in its own frame
    stand: Stand  # where it stands in the world, and how it is turned
    scene: Scene  # world and sky around it
    spot: Spot  # that it stands on

    @property
    def centre(self) -> np.ndarray:
        """(3,) middle of its bounding box, in the world: what cameras look at."""
        return self.stand.to_world(self.mesh.bounds.mean(axis=0)[None])[0]

    @property
    def box(self) -> np.ndarray:
        """(8, 3) corners of its bounding box, in the world."""
        low, high = self.mesh.bounds
        corners = [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        return self.stand.to_world(np.array(corners))

    @property
    def in_world(self) -> Mesh:
        """The mesh in the world's frame."""
        return self.stand.put(self.mesh)

    def with_mesh(self, mesh: Mesh) -> "Placed":
        """Another variant of the object, at its real size, in the same place: pairs share place and light."""
        return replace(self, mesh=mesh)


def find_radius(mesh: Mesh) -> float:
    """How far an object reaches around the middle of its base, in the mesh's unit."""
    return float(np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1]).max())


def make_scene(world: World, sky: Sky) -> Scene:
    """World and sky, as renderers take them; what stands there is lit once for all objects in it."""
    return Scene(
        f"{world.name} {sky.name}", sky.sun, sky.panorama, sky.exposure, surroundings=world.mesh, lamps=sky.lamps
    )


def find_spot(world: World, name: str) -> Spot:
    """Return the spot of that name; raise a `ToolkitError` for an unknown name."""
    spots = {spot.name: spot for spot in world.spots}
    if name not in spots:
        raise one_of(f"place in the world {world.name}", name, list(spots))
    return spots[name]


def choose_places(
    world: World, radius_m: float, count: int, seed: int = 0, kinds: Collection[str] = DRY
) -> tuple[Spot, ...]:
    """Draw places that are free of walls and everything else for `radius_m` around.

    Streets, crossings, squares, roofs, water and so on take turns, in an order drawn by the seed, so that few places
    are not all of the same kind. The first of more places are those of fewer.

    Args:
        kinds: what the object may stand on: ground, roof, water.

    Raises:
        ToolkitError: the object is larger than every place, or there are fewer places for it than are asked for.
    """
    spots = [spot for spot in world.spots if spot.kind in kinds]
    wide = [spot for spot in spots if spot.free_radius_m >= radius_m]
    # rays are cast for wide ones alone: the stored radius is the cheaper test, and comes first
    free = [spot for spot in wide if is_clear(world, spot, radius_m)]
    if len(free) < count:
        raise _too_few(world, radius_m, count, spots, len(free))
    # the draw that orders the places does not depend on how many are wanted
    rng = np.random.default_rng([seed, 50])
    shuffled = [free[k] for k in rng.permutation(len(free))]
    turns: dict[str, int] = {}
    rank = []
    for spot in shuffled:
        turns[spot.place] = turns.get(spot.place, -1) + 1
        # its turn among its kind: kinds follow each other
        rank.append(turns[spot.place])
    order = sorted(range(len(shuffled)), key=rank.__getitem__)  # stable: by turn, then as drawn
    return tuple(shuffled[k] for k in order[:count])


def _too_few(world: World, radius_m: float, count: int, spots: Sequence[Spot], found: int) -> ToolkitError:
    need = f"an object that reaches {radius_m:.3g} m around its middle"
    if found:
        which = "place" if found == 1 else "places"
        return ToolkitError(
            f"{world.name} has {found} {which} for {need}, {count} are asked for: ask for {found}, or take a smaller "
            "object"
        )
    if not spots:
        return ToolkitError(f"{world.name} has no free place for {need}: clear one, or take another world")
    widest = max(spots, key=lambda spot: spot.free_radius_m)
    return ToolkitError(
        f"{world.name} has no place for {need}: the widest, '{widest.name}', is free for {widest.free_radius_m:.3g} m: "
        "make the object smaller, or take another world"
    )


def is_clear(world: World, spot: Spot, radius_m: float) -> bool:
    """Whether rays from above a spot's middle meet nothing within `radius_m`, at heights from 0.5 to 5 m."""
    angle = np.linspace(0, 2 * np.pi, FAN_DIRECTIONS, endpoint=False)
    rays = np.zeros((len(FAN_HEIGHTS_M), FAN_DIRECTIONS, 6), np.float32)
    rays[..., :3] = spot.position
    rays[..., 2] += np.array(FAN_HEIGHTS_M)[:, None]
    rays[..., 3], rays[..., 4] = np.cos(angle), np.sin(angle)
    return bool(cast_rays(world.shape.rays, rays.reshape(-1, 6)).min() >= radius_m)


def place_object(mesh: Mesh, world: World, spot: Spot, sky: Sky) -> Placed:
    """Stand an object on a spot, turned as the spot is, its lowest part on what is highest under it.

    Args:
        mesh: at its real size, metres, its base's centre at the origin; see `scale_to_world`.
        spot: a spot of the world; see `choose_places`.

    Raises:
        ToolkitError: the object is larger than the spot, something stands in its box, or there is nothing under it.
    """
    radius = find_radius(mesh)
    if radius > spot.free_radius_m:
        raise ToolkitError(
            f"'{spot.name}' of {world.name} is free for {spot.free_radius_m:.3g} m, the object reaches {radius:.3g} m "
            "around its middle: take another place, or make the object smaller"
        )
    level = Stand(spot.position, spot.yaw_deg)
    low = float(mesh.bounds[0, 2])
    # wheels or feet, not the belly, decide what it stands on
    carrying = mesh.vertices[mesh.vertices[:, 2] <= low + CONTACT * float(np.ptp(mesh.bounds, axis=0).max())]
    under = level.to_world(carrying.astype(np.float64))
    height = _stand_height(world, spot, under)
    # the spot's turn is the object's: along the street
    stand = Stand((spot.position[0], spot.position[1], round(height - low, 6)), spot.yaw_deg)
    placed = Placed(mesh, stand, make_scene(world, sky), spot)
    if not _has_free_box(world, placed):
        raise ToolkitError(
            f"something stands on '{spot.name}' of {world.name}, where the object would be: take another place"
        )
    return placed


def stand_object(space: Workspace, world: World, item: ObjectInWorld, sky: Sky, seed: int = 0) -> Placed:
    """Stand an object of a workspace in a world as is asked for; without a place, at a spot drawn by `seed`.

    Raises:
        ToolkitError: an unknown object, variant or place, or nowhere is room for it.
    """
    loaded = load_object(space.object_spec(item.object_name or ""))
    variant = item.variant or "unpatched"
    # radius and place are judged at the size and in the variant that will stand there
    mesh = scale_to_world(apply_booster(loaded, find_booster(space, loaded, variant)), loaded.spec, item.length_m)
    if item.place is not None:
        spot = find_spot(world, item.place)
    else:
        spot = choose_places(world, find_radius(mesh), 1, seed)[0]
    return place_object(mesh, world, spot, sky)


def _stand_height(world: World, spot: Spot, points: np.ndarray) -> float:
    """Height of what is highest under points (n, 3)."""
    rays = np.zeros((len(points), 6), np.float32)
    rays[:, :2], rays[:, 2], rays[:, 5] = points[:, :2], spot.position[2] + ABOVE_M, -1
    fall = cast_rays(world.shape.rays, rays).min()
    if not np.isfinite(fall) or fall > 2 * ABOVE_M:
        raise ToolkitError(f"there is nothing to stand on at '{spot.name}' of {world.name}: take another place")
    return spot.position[2] + ABOVE_M - float(fall)


def _has_free_box(world: World, placed: Placed) -> bool:
    """Whether rays down through an object's box meet nothing that is higher than a kerb."""
    low, high = placed.mesh.bounds.astype(np.float64)
    if high[2] - low[2] <= KERB_M:
        return True
    x, y = np.meshgrid(*(np.linspace(low[k], high[k], BOX_RAYS) for k in (0, 1)), indexing="ij")
    top = np.stack([x, y, np.full_like(x, high[2])], axis=-1).reshape(-1, 3)
    rays = np.zeros((len(top), 6), np.float32)
    rays[:, :3], rays[:, 5] = placed.stand.to_world(top), -1
    return bool(cast_rays(world.shape.rays, rays).min() >= high[2] - low[2] - KERB_M)
