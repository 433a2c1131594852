"""Views in a world to train on: random places, turns, skies and cameras, ahead of who uses them.

None is a view of an evaluation's grid. Its cameras are a lattice that looks at the object's middle. Here position,
roll, field of view and aim are drawn from continuous ranges, and so are the object's place and turn. By default the
world is another world. In the evaluated world, the places that an evaluation draws by default are left
out while there are others.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.mesh import Mesh
from toolkit.rig.camera import Camera, project
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.renderer import Renderer
from toolkit.rig.scene import Scene, Stand
from toolkit.rig.views import DETAIL, HELD_OUT, ViewSettings, random_pose
from toolkit.rooms.worlds.own import open_world
from toolkit.rooms.worlds.place import choose_places, find_radius, is_clear, place_object
from toolkit.rooms.worlds.sky import Sky, make_sky
from toolkit.rooms.worlds.world import Spot, World

EVALUATED_SEED, EVALUATED_PLACES = 0, 5
"""Number of the world that an evaluation uses, and of the places it draws there."""
HELD_OUT_EVERY = 4
"""One place of so many is held out."""
FOV_DEG = (40.0, 60.0)
PLACES_TRIED, VIEWS_TRIED = 20, 40
LEAST_SEEN = 0.2
"""Share of its outline's area, most of which is air, that is seen of an object; what hides more is not trained on."""
GLANCE_PX = 48


@dataclass(frozen=True)
class WorldSetting:
    """A world under one sky or several; a block of views has one place and one sky. See `toolkit.rig.views.Setting`."""

    world: World  # in metres, as are the meshes that stand in it
    skies: tuple[Sky, ...]  # at least one; light on the world is worked out once for each
    detail: BakeDetail = DETAIL  # how finely light on the object is worked out
    _known: dict[float, list[Spot]] = field(default_factory=dict, repr=False)

    def set_up(self, mesh: Mesh, draws: Draws) -> tuple[Scene, Stand]:
        """A place that is free for a mesh, anywhere on a spot and turned at will.

        Raises:
            ToolkitError: the mesh is larger than every place, or something stands wherever it was put.
        """
        # places to train on and held-out places are kept apart by the phase of the draw
        rng, radius = draws.of("setting"), find_radius(mesh)
        spots = self.divide(mesh)[draws.phase == HELD_OUT]
        sky = self.skies[rng.integers(len(self.skies))]
        error = None
        for _ in range(PLACES_TRIED):
            spot = spots[rng.integers(len(spots))]
            # the root spreads places evenly over the circle
            shift, angle = (spot.free_radius_m - radius) * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
            x, y, z = spot.position
            place = (float(x + shift * np.cos(angle)), float(y + shift * np.sin(angle)), z)
            # the object's turn is random, not that of the spot
            moved = replace(spot, position=place, free_radius_m=radius, yaw_deg=float(rng.uniform(0, 360)))
            try:
                placed = place_object(mesh, self.world, moved, sky)
            except ToolkitError as refused:
                error = refused
                continue
            return placed.scene, placed.stand
        assert error is not None
        raise error

    def aim(
        self, renderer: Renderer, stand: Stand, rng: np.random.Generator, settings: ViewSettings
    ) -> tuple[Camera, np.ndarray]:
        """A camera from which the object is seen, drawn again where walls, trees or the ground hide it.

        Raises:
            ToolkitError: it is hidden from wherever the camera was put.
        """
        # the pose is drawn in the object's frame, then moved to where it stands
        points = renderer.outline - stand.place
        for _ in range(VIEWS_TRIED):
            fov_deg = float(rng.uniform(*FOV_DEG))
            camera = Camera.from_fov(settings.image_px, settings.image_px, fov_deg)
            pose = random_pose(rng, points, camera, settings.ranges)
            pose[:3, 3] += stand.place
            # a glance of few pixels decides, before the full render
            if _is_seen(renderer, Camera.from_fov(GLANCE_PX, GLANCE_PX, fov_deg), pose):
                return camera, pose
        place = ", ".join(f"{value:.1f}" for value in stand.place)
        raise ToolkitError(
            f"{self.world.name}: at ({place}) m the object was hidden from {VIEWS_TRIED} random cameras: let them "
            "stand higher, or nearer, or take another world"
        )

    def divide(self, mesh: Mesh) -> tuple[list[Spot], list[Spot]]:
        """Spots that are free for a mesh: those to train on, and those held out, the same if there is a single spot.

        Raises:
            ToolkitError: the mesh is larger than every place.
        """
        radius = find_radius(mesh)
        if radius not in self._known:
            self._known[radius] = self._find_spots(radius)
        spots = self._known[radius]
        # by their order in the world, which is the same in every run: a place never changes sides
        held_out = spots[::HELD_OUT_EVERY] if len(spots) > 1 else spots
        return [spot for spot in spots if spot not in held_out] or spots, held_out

    def record(self, meshes: Sequence[Mesh]) -> dict[str, Any]:
        """The places and skies of the training views, for a booster's record."""
        trained, held_out = (
            sorted({spot.name for mesh in meshes for spot in self.divide(mesh)[part]}) for part in (0, 1)
        )
        return {
            "name": self.world.name, "seed": self.world.seed, "sha256": self.world.sha256,
            "skies": [sky.name for sky in self.skies], "places": trained, "held_out_places": held_out,
        }  # fmt: skip

    def describe(self, meshes: Sequence[Mesh]) -> str:
        """`city 1, noon/1; on crossing-2, street-1; held out: park`."""
        seen = self.record(meshes)
        places, held_out, skies = (", ".join(seen[name]) for name in ("places", "held_out_places", "skies"))
        return f"{self.world.name} {self.world.seed}, {skies}; on {places}; held out: {held_out}"

    def _find_spots(self, radius_m: float) -> list[Spot]:
        spots = [
            spot for spot in self.world.spots
            if spot.free_radius_m >= radius_m and is_clear(self.world, spot, radius_m)
        ]  # fmt: skip
        if not spots:
            choose_places(self.world, radius_m, 1)  # says how large they are
        if self.world.seed == EVALUATED_SEED and len(spots) > EVALUATED_PLACES:
            evaluated = choose_places(self.world, radius_m, EVALUATED_PLACES, EVALUATED_SEED)
            spots = [spot for spot in spots if spot not in evaluated]
        return spots


def _is_seen(renderer: Renderer, camera: Camera, T_world_camera: np.ndarray) -> bool:
    """Whether a fair share of the object's outline shows it."""
    from scipy.spatial import ConvexHull

    pixels, depth = project(camera, T_world_camera, renderer.outline)
    if (depth <= 0).any():
        return False
    outline_px = float(ConvexHull(pixels).volume)  # of flat points: the area
    seen_px = int((renderer.buffers(camera, T_world_camera)["mesh"] == 0).sum())
    return seen_px >= LEAST_SEEN * outline_px


def open_setting(space: Workspace, world: str, times: Sequence[str], *, seed: int, scale: float) -> WorldSetting:
    """A world at some times of day; see `toolkit.rooms.worlds.own.open_world`.

    Raises:
        ToolkitError: there is no such world or time, or a file cannot be used.
    """
    skies = tuple(make_sky(time, seed) for time in times)
    return WorldSetting(open_world(space, world, seed, scale), skies)
