"""Pictures of a world with or without an object: rendered once, seen in all weathers; a film."""

import contextlib
import secrets
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import make_folder, move_file
from toolkit.objects.mesh import Material, Mesh
from toolkit.rig import renderers
from toolkit.rig.camera import Camera
from toolkit.rig.renderer import Renderer
from toolkit.rig.scene import Stand
from toolkit.rig.shading import develop_light, draw_grain
from toolkit.rooms.worlds.conditions import CLEAR
from toolkit.rooms.worlds.depth_weather import add_weather, make_weather, weather_rng
from toolkit.rooms.worlds.particles import DepthView
from toolkit.rooms.worlds.place import Placed, make_scene
from toolkit.rooms.worlds.sky import Sky
from toolkit.rooms.worlds.world import STANDING, SceneClass, Spot, World

BURIED_M = 50.0
SPECK_M = 0.01
LAND = [int(kind) for kind in STANDING if kind != SceneClass.WATER]
"""Classes that rain makes darker; on water no snow lies either."""


def leave_empty(world: World, sky: Sky) -> Placed:
    """A world without an object: a speck lies far below its ground, where no camera sees it."""
    place = (0.0, 0.0, float(world.bounds[0, 2]) - BURIED_M)
    spot = Spot("nowhere", "nowhere", place, 0.0, 0.0, "ground")
    return Placed(make_speck(), Stand(place), make_scene(world, sky), spot)


def make_speck() -> Mesh:
    """A grey triangle of a centimetre, in place of an object."""
    corners = np.array([[0, 0, 0], [SPECK_M, 0, 0], [0, SPECK_M, 0]], np.float32)
    up, grey = np.tile(np.array([[0, 0, 1]], np.float32), (3, 1)), np.full((4, 4, 3), 128, np.uint8)
    return Mesh(corners, up, np.zeros((3, 2), np.float32), np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32),
                (Material("speck", grey),))  # fmt: skip


def make_renderer(placed: Placed, name: str = renderers.RAYCAST) -> Renderer:
    """The renderer of that name, of an object in its place."""
    return renderers.make_renderer(name, placed.mesh, placed.scene, stand=placed.stand)


def see_through(
    renderer: Renderer, world: World, sky: Sky, view: tuple[Camera, np.ndarray],
    weathers: Sequence[tuple[str, int]], seed: tuple[int, int] = (0, 0),
) -> list[np.ndarray]:  # fmt: skip
    """(h, w, 3) uint8 sRGB pictures of a view, one for each weather, from one render.

    Args:
        renderer: of the world, with an object or none.
        seed: of grain and weather: that of the run, and number of the view.
    """
    light, found = renderer.render_with_depth(*view)
    return develop_through(light, find_depths(world, sky, view, found, weathers), sky, weathers, seed)


def develop_through(
    light: np.ndarray, through: DepthView, sky: Sky, weathers: Sequence[tuple[str, int]], seed: tuple[int, int] = (0, 0)
) -> list[np.ndarray]:
    """(h, w, 3) uint8 sRGB pictures of linear light (h, w, 3), one through each weather; grain and lens are the same.

    Args:
        through: how far away everything in it is, see `find_depths`.
    """
    # the same grain for all weathers: images of a pair differ in the weather alone
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
    """Inputs of weathers for a view: depth, for rain and snow the ground, for snow the surfaces' normals.

    Rain does not darken water, and snow covers neither water nor the object.

    Args:
        found: buffers of the same view, see `Renderer.render_with_depth`.
    """
    names = {name for name, _ in weathers}
    ground = normals = None
    # mesh 1 is the world: the object takes neither snow nor wet ground
    around = found["mesh"] == 1
    faces = found["face"][around]
    if names & {"rain", "snow"}:
        ground = np.zeros(around.shape, bool)
        ground[around] = np.isin(world.face_class[faces], LAND)
    # snow needs to know which surfaces face up
    if "snow" in names:
        corners = world.mesh.vertices[world.mesh.faces[faces]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = np.zeros((*around.shape, 3), np.float32)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        normals[around] = np.where((world.face_class[faces] == SceneClass.WATER)[:, None], 0, normal)
    return DepthView(found["depth"], *view, ground=ground, normals=normals, white=sky.white)


CODECS = ("vp09", "mp4v")
"""VP9, which every browser plays; where a build of OpenCV lacks it MPEG-4 Part 2, which players play."""
FPS = 25


def write_film(path: Path, frames: Iterable[np.ndarray], size: tuple[int, int], count: int) -> Path:
    """Write an MP4; `path` holds either the old file or the whole new file.

    Args:
        path: `.mp4`.
        frames: (height, width, 3) uint8 sRGB.
        size: width and height, even.

    Raises:
        ToolkitError: this OpenCV writes no film, or the film cannot be read back whole: mostly a full disk.
    """
    make_folder(path.parent)
    # written beside the final name, then renamed: an interrupted film leaves the old file
    partial = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.partial.mp4")
    try:
        writer = _open_writer(partial, size)
        # OpenCV writes BGR
        for frame in frames:
            writer.write(np.ascontiguousarray(frame[..., ::-1]))
        writer.release()
        # OpenCV reports no failed write, so the frames are counted
        found = count_frames(partial)
        if found != count:
            raise ToolkitError(
                f"cannot write {path}: of {count} frames {found} can be read back: is the disk full? Free some space "
                "and run the same command again to resume"
            )
        return move_file(partial, path, path.parent)
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def _open_writer(path: Path, size: tuple[int, int]) -> cv2.VideoWriter:
    for codec in CODECS:
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), FPS, size)
        if writer.isOpened():
            return writer
    raise ToolkitError(
        f"cannot write a film to {path.parent}: the folder may not be written to, or this OpenCV knows neither "
        f"{' nor '.join(CODECS)}: choose another folder, or leave the film out"
    )


def count_frames(path: Path) -> int:
    """How many frames of a film can be decoded."""
    reader, found = cv2.VideoCapture(str(path)), 0
    while reader.grab():
        found += 1
    reader.release()
    return found
