"""Pictures of an object in its place from the grid's cameras: one render for all weathers, developed as in the rig."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np

from toolkit.experiments.worlds.answers import WeatherKey
from toolkit.experiments.worlds.cameras import GridCamera
from toolkit.objects.mesh import Mesh
from toolkit.rig.camera import Camera
from toolkit.rig.raycast import RaycastRenderer, map_frames
from toolkit.worlds.picture import develop_through, find_depths, make_renderer
from toolkit.worlds.place import Placed
from toolkit.worlds.sky import Sky
from toolkit.worlds.world import World

OBJECT_ID, BOOSTER_ID, SKY_ID = 100, 101, 255
"""In segmentations, beside the numbers of `SceneClass`: the object, what boosts it, and the sky."""


class Task(NamedTuple):
    """A frame to render.

    Attributes:
        frame: hash of its inputs.
        place, variant: number of the place, name of the variant.
        item: number of the camera in the whole run, of which its random draws depend.
        camera: from where.
        weathers: that it is wanted in.
        is_kept: whether depth and classes are wanted too.
    """

    frame: str
    place: int
    variant: str
    item: int
    camera: GridCamera
    weathers: tuple[WeatherKey, ...]
    is_kept: bool


@dataclass(frozen=True)
class Frame:
    """A finished frame.

    Attributes:
        task: what was asked for.
        pictures: (h, w, 3) uint8 sRGB for each of the task's weathers.
        depth_m: (h, w) float32 along each ray, inf for the sky; None unless kept.
        classes: (h, w) uint8 `SceneClass`, or one of the numbers above; None unless kept.
    """

    task: Task
    pictures: tuple[np.ndarray, ...]
    depth_m: np.ndarray | None = None
    classes: np.ndarray | None = None


@dataclass(frozen=True)
class Variant:
    """The object in one variant, at its real size.

    Attributes:
        mesh: metres, in the object's frame.
        boosted: (m,) bool, faces that a patch, a texture or a control covers.
    """

    mesh: Mesh
    boosted: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh, bare: Mesh) -> "Variant":
        """A variant of a bare mesh: faces with a picture that the bare one lacks are boosted."""
        own = {id(material.texture) for material in bare.materials}
        new = np.array([id(material.texture) not in own for material in mesh.materials])
        return cls(mesh, new[mesh.face_material])


@dataclass(frozen=True, eq=False)
class Stage:
    """What all frames of a run share; two are the same where they are one.

    Attributes:
        world, sky: around the object.
        camera: of all pictures.
        seed: of grain and weather.
        places: the bare object in its places.
        variants: by name.
    """

    world: World
    sky: Sky
    camera: Camera
    seed: int
    places: tuple[Placed, ...]
    variants: dict[str, Variant]


class FrameSource(Protocol):
    """Who makes the pictures of a grid; workers get a copy."""

    def frames(self, tasks: Sequence[Task]) -> Iterator[Frame]:
        """The frames of tasks, in order, each in all of its weathers."""
        ...


def render_frames(stage: Stage, tasks: Sequence[Task], threads: int | None = None) -> Iterator[Frame]:
    """The frames of tasks, in order, on all cores; a few are made ahead, whatever their number.

    Tasks of one place and variant should follow each other: their light is worked out once.
    """

    def prepare() -> Iterator[tuple[Task, RaycastRenderer]]:
        for task in tasks:
            yield task, open_renderer(stage, task.place, task.variant)

    return map_frames(lambda pair: render_frame(stage, *pair), prepare(), threads)


@lru_cache(maxsize=1)
def open_renderer(stage: Stage, place: int, variant: str) -> RaycastRenderer:
    """The renderer of a variant in its place; the last one is kept."""
    return make_renderer(stage.places[place].wear(stage.variants[variant].mesh))


def render_frame(stage: Stage, task: Task, renderer: RaycastRenderer) -> Frame:
    """Render, and lay every weather over the linear light before it is developed."""
    view = stage.camera, task.camera.T_world_camera
    light, found = renderer.render_with_depth(*view)
    through = find_depths(stage.world, stage.sky, view, found, task.weathers)
    pictures = tuple(develop_through(light, through, stage.sky, task.weathers, (stage.seed, task.item)))
    if not task.is_kept:
        return Frame(task, pictures)
    return Frame(task, pictures, found["depth"], classify_pixels(stage, task.variant, found))


def classify_pixels(stage: Stage, variant: str, found: dict[str, np.ndarray]) -> np.ndarray:
    """(h, w) uint8 what each pixel's middle shows: a `SceneClass`, `OBJECT_ID`, `BOOSTER_ID` or `SKY_ID`."""
    classes = np.full(found["mesh"].shape, SKY_ID, np.uint8)
    around, own = found["mesh"] == 1, found["mesh"] == 0
    classes[around] = stage.world.face_class[found["face"][around]]
    boosted = stage.variants[variant].boosted[found["face"][own]]
    classes[own] = np.where(boosted, BOOSTER_ID, OBJECT_ID)
    return classes
