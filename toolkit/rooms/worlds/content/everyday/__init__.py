"""Random instances of everyday objects, to train a classifier on: `make_everyday(label, seed)` makes an instance."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np

from toolkit.core.errors import one_of
from toolkit.objects.load import build_mesh
from toolkit.objects.mesh import Mesh, place_on_table
from toolkit.rooms.worlds.content.drawing import Rng
from toolkit.rooms.worlds.content.everyday import household, vehicles, vessels
from toolkit.rooms.worlds.content.modelling import LENGTH_MM

ATLAS_PX = 512
"""Side that the shipped atlas is reduced to."""
HUE_TURN_DEG = {"racer": (30, 180), "warplane": (30, 180), "coffeepot": (30, 180), "eggnog": (12, 50)}
"""By how much the hues of a shipped object turn; a drink keeps a colour that a person would drink."""
Maker = Callable[[Rng], Mesh]
SHIPPED_SHARE = 0.35
"""Share of stretched and repainted shipped objects among the instances of a kind that the package ships."""


def vary_shipped(name: str, rng: Rng) -> Mesh:
    """A shipped object stretched by 0.8-1.25 per axis, its hues turned or its paint mixed with another colour."""
    mesh = _small_shipped(name)
    # factors even on a logarithmic scale: as often larger as smaller
    stretch = np.exp(rng.uniform(np.log(0.8), np.log(1.25), 3)).astype(np.float32)
    # normals go with the inverse of the stretch
    normals = mesh.normals / stretch
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    repainted = _repaint(mesh.materials[0].texture, HUE_TURN_DEG[name], rng)
    # gloss is varied as well
    materials = tuple(
        replace(
            material, texture=repainted, roughness=float(np.clip(material.roughness * rng.draw(0.7, 1.5), 0.05, 0.95))
        )
        for material in mesh.materials
    )
    changed = replace(mesh, vertices=mesh.vertices * stretch, normals=normals, materials=materials)
    return place_on_table(changed, LENGTH_MM)


def _repaint(texture: np.ndarray, turn_deg: tuple[float, float], rng: Rng) -> np.ndarray:
    """Turn all hues within `turn_deg` either way, at times mix in a colour, and change lightness and contrast."""
    # what is grey stays grey: a rotation about the grey axis of RGB
    turn = np.radians(rng.draw(*turn_deg)) * (1 if rng.chance(0.5) else -1)
    axis = np.full(3, 1 / np.sqrt(3))
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    matrix = np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross
    # half of them are mixed with another colour as well
    shift = np.zeros(3)
    if rng.chance(0.5):
        share = rng.draw(0.15, 0.5)
        matrix, shift = matrix * (1 - share), share * np.array(rng.colour("bright", "ceramic", "car"))
    gain = rng.draw(0.75, 1.2)
    return cv2.transform(texture, np.c_[matrix * gain, shift * gain + rng.draw(-12, 24)])


@lru_cache(maxsize=4)
def _small_shipped(name: str) -> Mesh:
    mesh = build_mesh(name)
    texture = cv2.resize(mesh.materials[0].texture, (ATLAS_PX, ATLAS_PX), interpolation=cv2.INTER_AREA)
    return replace(mesh, materials=tuple(replace(material, texture=texture) for material in mesh.materials))


def _with_shipped(name: str, other_builds: Maker) -> Maker:
    """A maker of variants of the shipped object and, more often, of other builds of its kind."""

    def make(rng: Rng) -> Mesh:
        return vary_shipped(name, rng) if rng.random() < SHIPPED_SHARE else other_builds(rng)

    return make


MAKERS: dict[str, Maker] = {
    "racer": _with_shipped("racer", vehicles.make_racer),
    "warplane": _with_shipped("warplane", vehicles.make_warplane),
    "coffeepot": _with_shipped("coffeepot", vessels.make_coffeepot),
    "eggnog": _with_shipped("eggnog", vessels.make_eggnog),
    "airliner": vehicles.make_airliner, "bookcase": household.make_bookcase, "bucket": vessels.make_bucket,
    "candle": household.make_candle, "chair": household.make_chair, "coffee mug": vessels.make_coffee_mug,
    "dice": household.make_dice, "dining table": household.make_dining_table, "drum": household.make_drum,
    "dumbbell": household.make_dumbbell, "frying pan": vessels.make_frying_pan, "go-kart": vehicles.make_gokart,
    "hammer": household.make_hammer, "hourglass": household.make_hourglass, "laptop": household.make_laptop,
    "milk can": vessels.make_milk_can, "minivan": vehicles.make_minivan, "mushroom": household.make_mushroom,
    "pitcher": vessels.make_pitcher, "pop bottle": vessels.make_pop_bottle, "pot": vessels.make_pot,
    "screwdriver": household.make_screwdriver, "soccer ball": household.make_soccer_ball,
    "space shuttle": vehicles.make_space_shuttle, "table lamp": household.make_table_lamp,
    "teapot": vessels.make_teapot, "toilet tissue": vessels.make_toilet_tissue, "tractor": vehicles.make_tractor,
    "traffic cone": household.make_traffic_cone, "umbrella": household.make_umbrella, "vase": vessels.make_vase,
    "wine bottle": vessels.make_wine_bottle,
}  # fmt: skip
"""Label -> maker of one random instance, millimetres, z up, its base's centre at the origin, 270 mm long.

Labels that ImageNet has are spelled as there (`pot` is its `pot, flowerpot`).
"""


def make_everyday(label: str, seed: tuple[int, ...] | int) -> Mesh:
    """A random instance of a kind; the same seed makes the same bytes.

    Raises:
        ToolkitError: an unknown label; names the nearest known ones.
    """
    if label not in MAKERS:
        raise one_of("everyday object", label, list(MAKERS))
    return MAKERS[label](Rng(seed))
