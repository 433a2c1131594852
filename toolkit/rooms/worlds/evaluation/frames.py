"""Pictures of an object in its place from the grid's cameras: a render for all weathers, and the answers to them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from toolkit.core.threads import map_ahead
from toolkit.core.work import Work
from toolkit.models.predict import RankedAnswer, read_answer
from toolkit.objects.mesh import Mesh
from toolkit.rig.camera import Camera
from toolkit.rig.renderer import Renderer
from toolkit.rig.renderers import RAYCAST
from toolkit.rooms.worlds.depth_weather import make_weather
from toolkit.rooms.worlds.evaluation.cameras import GridCamera
from toolkit.rooms.worlds.picture import develop_through, find_depths, make_renderer
from toolkit.rooms.worlds.place import Placed
from toolkit.rooms.worlds.sky import Sky
from toolkit.rooms.worlds.world import World

FRAMES = Work("world frame", 1, old_at=0)
if TYPE_CHECKING:
    import torch

WeatherKey = tuple[str, int]
"""Name and severity."""
OBJECT_ID, BOOSTER_ID, SKY_ID = 100, 101, 255
"""In segmentations, beside the numbers of `SceneClass`: the object, what boosts it, and the sky."""


class FrameAnswers(BaseModel):
    """Line of `answers.jsonl`: the answers to a frame in some weathers.

    Attributes:
        frame: hash of the frame in clear conditions, its grain and the network.
        answers: by what `name_weather` calls the weather.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    frame: str = Field(pattern=r"^[0-9a-f]{64}$")
    answers: dict[str, RankedAnswer]

    def entries(self) -> list[tuple["AnswerKey", RankedAnswer]]:
        """Each answer with its key."""
        return [((self.frame, name), answer) for name, answer in self.answers.items()]


@dataclass(frozen=True)
class ViewAnswers:
    """Answers to every camera's picture of a variant in a weather, in the order of the cameras."""

    top1_index: np.ndarray  # (n,) int, first guess
    top1_prob: np.ndarray  # top1_prob, true_prob: (n,) its probability and the truth's
    true_prob: np.ndarray
    true_rank: np.ndarray  # (n,) int, place of the truth among the guesses, from 1

    @classmethod
    def of(cls, rows: Iterable[RankedAnswer]) -> "ViewAnswers":
        """From single answers."""
        columns = list(zip(*rows, strict=True))
        return cls(*(np.array(column) for column in columns))

    def right(self, guesses: int) -> np.ndarray:
        """(n,) bool: whether the truth is among so many first guesses."""
        return self.true_rank <= guesses


def name_weather(weather: WeatherKey) -> str:
    """`fog 3: visibility 40 m, extinction 74.9 /km`: another ladder makes other pictures."""
    return f"{weather[0]} {weather[1]}: {make_weather(*weather).describe()}"


def make_answer(logits: "torch.Tensor", true_index: int) -> RankedAnswer:
    """From (classes,) logits; six digits of a probability are kept."""
    found = read_answer(logits, true_index)
    # rounded before they are kept, so that an answer is the same from the log as from the network
    top1, true = (float(f"{prob:.6g}") for prob in (found.top1_prob, found.true_prob))
    return found._replace(top1_prob=top1, true_prob=true)


AnswerKey = tuple[str, str]
"""Hash of a frame, and what `name_weather` calls the weather."""


class PictureTask(NamedTuple):
    """A frame to render."""

    frame: str  # hash of its inputs
    place: int  # place, variant: number of the place, name of the variant
    variant: str
    item: int  # number of the camera in the whole run, of which its random draws depend
    camera: GridCamera  # from where
    weathers: tuple[WeatherKey, ...]  # that it is wanted in
    is_kept: bool  # whether depth and classes are wanted too


@dataclass(frozen=True)
class Frame:
    """A finished frame."""

    task: PictureTask  # what was asked for
    pictures: tuple[np.ndarray, ...]  # (h, w, 3) uint8 sRGB for each of the task's weathers
    depth_m: np.ndarray | None = None  # (h, w) float32 along each ray, inf for the sky; None unless kept
    classes: np.ndarray | None = None  # (h, w) uint8 `SceneClass`, or a number from above; None unless kept


@dataclass(frozen=True)
class WorldVariant:
    """The object in a variant, at its real size."""

    mesh: Mesh  # metres, in the object's frame
    boosted: np.ndarray  # (m,) bool, faces that a patch, a texture or a control covers

    @classmethod
    def of(cls, mesh: Mesh, bare: Mesh) -> "WorldVariant":
        """A variant of an unmodified mesh: faces with a new picture are boosted."""
        # by identity: a variant has the unmodified mesh's textures, and new textures beside them
        own = {id(material.texture) for material in bare.materials}
        new = np.array([id(material.texture) not in own for material in mesh.materials])
        return cls(mesh, new[mesh.face_material])


@dataclass(frozen=True, eq=False)
class Stage:
    """Inputs of all frames of a run; equal only to itself."""

    world: World  # world, sky: around the object
    sky: Sky
    camera: Camera  # of all pictures
    seed: int  # of grain and weather
    places: tuple[Placed, ...]  # the unmodified object in its places
    variants: dict[str, WorldVariant]  # by name
    renderer: str = RAYCAST  # what draws the pictures


class FrameSource(Protocol):
    """Who makes the pictures of a grid; workers get a copy."""

    def frames(self, tasks: Sequence[PictureTask]) -> Iterator[Frame]:
        """The frames of tasks, in order, each in all of its weathers."""
        ...


def render_frames(stage: Stage, tasks: Sequence[PictureTask]) -> Iterator[Frame]:
    """The frames of tasks, in order, on all cores; a few are made ahead, whatever their number.

    Tasks of a place and variant should follow each other: their light is worked out once.
    """

    def prepare() -> Iterator[tuple[PictureTask, Renderer]]:
        for task in tasks:
            yield task, open_renderer(stage, task.place, task.variant)

    return map_ahead(lambda pair: render_frame(stage, *pair), prepare())


@lru_cache(maxsize=1)
def open_renderer(stage: Stage, place: int, variant: str) -> Renderer:
    """The renderer of a variant in its place; the last is kept."""
    return make_renderer(stage.places[place].with_mesh(stage.variants[variant].mesh), stage.renderer)


def render_frame(stage: Stage, task: PictureTask, renderer: Renderer) -> Frame:
    """Render, and lay every weather over the linear light before it is developed."""
    view = stage.camera, task.camera.T_world_camera
    # a render serves all weathers, which depend on its depth alone
    light, found = renderer.render_with_depth(*view)
    through = find_depths(stage.world, stage.sky, view, found, task.weathers)
    pictures = tuple(develop_through(light, through, stage.sky, task.weathers, (stage.seed, task.item)))
    if not task.is_kept:
        return Frame(task, pictures)
    return Frame(task, pictures, found["depth"], classify_pixels(stage, task.variant, found))


def classify_pixels(stage: Stage, variant: str, found: dict[str, np.ndarray]) -> np.ndarray:
    """(h, w) uint8 what each pixel's middle shows: a `SceneClass`, `OBJECT_ID`, `BOOSTER_ID` or `SKY_ID`."""
    classes = np.full(found["mesh"].shape, SKY_ID, np.uint8)
    # the renderer's mesh 0 is the object, mesh 1 what stands around it
    around, own = found["mesh"] == 1, found["mesh"] == 0
    classes[around] = stage.world.face_class[found["face"][around]]
    boosted = stage.variants[variant].boosted[found["face"][own]]
    classes[own] = np.where(boosted, BOOSTER_ID, OBJECT_ID)
    return classes
