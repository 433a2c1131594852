"""Pictures of a world with or without an object in it: rendered once, seen in clear air and through weather."""

from collections.abc import Mapping, Sequence

import numpy as np

from toolkit.objects.mesh import Material, Mesh
from toolkit.rig.camera import Camera
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.scene import Stand
from toolkit.rig.shading import develop_light, draw_grain
from toolkit.worlds.conditions import CLEAR
from toolkit.worlds.depth_view import DepthView
from toolkit.worlds.depth_weather import add_weather, make_weather, weather_rng
from toolkit.worlds.place import Placed, make_scene
from toolkit.worlds.sky import Sky
from toolkit.worlds.world import STANDING, SceneClass, Spot, World

BURIED_M = 50.0
SPECK_M = 0.01
LAND = [int(one) for one in STANDING if one != SceneClass.WATER]
"""Classes that rain makes darker; on water no snow lies either."""


def leave_empty(world: World, sky: Sky) -> Placed:
    """A world without an object: a speck of one lies far below its ground, where no camera sees it."""
    place = (0.0, 0.0, float(world.bounds[0, 2]) - BURIED_M)
    spot = Spot("nowhere", "nowhere", place, 0.0, 0.0, "ground")
    return Placed(make_speck(), Stand(place), make_scene(world, sky), spot)


def make_speck() -> Mesh:
    """One grey triangle of a centimetre, in place of an object."""
    corners = np.array([[0, 0, 0], [SPECK_M, 0, 0], [0, SPECK_M, 0]], np.float32)
    up, grey = np.tile(np.array([[0, 0, 1]], np.float32), (3, 1)), np.full((4, 4, 3), 128, np.uint8)
    return Mesh(corners, up, np.zeros((3, 2), np.float32), np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32),
                (Material("speck", grey),))  # fmt: skip


def make_renderer(placed: Placed) -> RaycastRenderer:
    """The renderer of an object in its place."""
    return RaycastRenderer(placed.mesh, placed.scene, stand=placed.stand)


def see_through(
    renderer: RaycastRenderer,
    world: World,
    sky: Sky,
    view: tuple[Camera, np.ndarray],
    weathers: Sequence[tuple[str, int]],
    seed: tuple[int, int] = (0, 0),
) -> list[np.ndarray]:
    """(h, w, 3) uint8 sRGB pictures of one view, one for each weather, from one render.

    Args:
        renderer: of the world, with an object or none.
        world, sky: that it renders.
        view: camera and `T_world_camera`.
        weathers: names with severities, see `parse_weathers`.
        seed: of grain and weather: that of the run, and number of the view.
    """
    light, found = renderer.render_with_depth(*view)
    return develop_through(light, find_depths(world, sky, view, found, weathers), sky, weathers, seed)


def develop_through(
    light: np.ndarray, through: DepthView, sky: Sky, weathers: Sequence[tuple[str, int]], seed: tuple[int, int] = (0, 0)
) -> list[np.ndarray]:
    """(h, w, 3) uint8 sRGB pictures of linear light (h, w, 3), one through each weather; grain and lens are the same.

    Args:
        light: of a render in clear air.
        through: how far away everything in it is, see `find_depths`.
        sky: gives the air's light.
        weathers, seed: as in `see_through`.
    """
    pictures, grain = [], draw_grain(light.shape, seed)
    for weather in weathers:
        seen = light
        if weather != CLEAR:
            seen = add_weather(light, through, make_weather(*weather), sky.airlight, weather_rng(*seed, *weather))
        pictures.append(develop_light(seen, grain))
    return pictures


def find_depths(
    world: World, sky: Sky, view: tuple[Camera, np.ndarray], found: Mapping[str, np.ndarray],
    weathers: Sequence[tuple[str, int]],
) -> DepthView:  # fmt: skip
    """What weathers need to know of a view: depth, for rain and snow the ground, for snow which way surfaces face.

    Rain makes no water darker and no snow lies on it; nor does snow lie on the object.

    Args:
        world, sky: that were rendered.
        view: camera and `T_world_camera`.
        found: buffers of the same view, see `RaycastRenderer.render_with_depth`.
        weathers: which.
    """
    names = {name for name, _ in weathers}
    ground = normals = None
    around = found["mesh"] == 1
    faces = found["face"][around]
    if names & {"rain", "snow"}:
        ground = np.zeros(around.shape, bool)
        ground[around] = np.isin(world.face_class[faces], LAND)
    if "snow" in names:
        corners = world.mesh.vertices[world.mesh.faces[faces]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = np.zeros((*around.shape, 3), np.float32)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        normals[around] = np.where((world.face_class[faces] == SceneClass.WATER)[:, None], 0, normal)
    return DepthView(found["depth"], *view, ground=ground, normals=normals, white=sky.white)
