"""Random instances of everyday objects, to train a classifier on: `make_everyday(label, seed)` makes one."""

from collections.abc import Callable

import numpy as np

from toolkit.content.everyday import aircraft as airliners
from toolkit.content.everyday import aircraft as warplanes
from toolkit.content.everyday import bottles, variants
from toolkit.content.everyday import household as furniture
from toolkit.content.everyday import household as things
from toolkit.content.everyday import tools_and_toys as tools
from toolkit.content.everyday import tools_and_toys as toys
from toolkit.content.everyday import vehicles as cars
from toolkit.content.everyday import vehicles as racers
from toolkit.content.everyday import vessels as containers
from toolkit.content.everyday import vessels as pots
from toolkit.core.errors import one_of
from toolkit.objects.mesh import Mesh

Maker = Callable[[np.random.Generator], Mesh]
SHIPPED_SHARE = 0.35
"""Of the instances of a kind that the package ships an object of: stretched and repainted ones of that object."""


def _with_shipped(name: str, other_builds: Maker) -> Maker:
    """A maker of variants of the shipped object and, more often, of other builds of its kind."""

    def make(rng: np.random.Generator) -> Mesh:
        return variants.vary_shipped(name, rng) if rng.random() < SHIPPED_SHARE else other_builds(rng)

    return make


MAKERS: dict[str, Maker] = {
    "racer": _with_shipped("racer", racers.make_racer),
    "warplane": _with_shipped("warplane", warplanes.make_warplane),
    "coffeepot": _with_shipped("coffeepot", pots.make_coffeepot),
    "eggnog": _with_shipped("eggnog", bottles.make_eggnog),
    "airliner": airliners.make_airliner, "bookcase": furniture.make_bookcase, "bucket": containers.make_bucket,
    "candle": things.make_candle, "chair": furniture.make_chair, "coffee mug": containers.make_coffee_mug,
    "dice": toys.make_dice, "dining table": furniture.make_dining_table, "drum": toys.make_drum,
    "dumbbell": tools.make_dumbbell, "frying pan": containers.make_frying_pan, "go-kart": cars.make_gokart,
    "hammer": tools.make_hammer, "hourglass": things.make_hourglass, "laptop": furniture.make_laptop,
    "milk can": bottles.make_milk_can, "minivan": cars.make_minivan, "mushroom": things.make_mushroom,
    "pitcher": pots.make_pitcher, "pop bottle": bottles.make_pop_bottle, "pot": containers.make_pot,
    "screwdriver": tools.make_screwdriver, "soccer ball": toys.make_soccer_ball,
    "space shuttle": airliners.make_space_shuttle, "table lamp": furniture.make_table_lamp, "teapot": pots.make_teapot,
    "toilet tissue": containers.make_toilet_tissue, "tractor": cars.make_tractor,
    "traffic cone": things.make_traffic_cone, "umbrella": things.make_umbrella, "vase": containers.make_vase,
    "wine bottle": bottles.make_wine_bottle,
}  # fmt: skip
"""Label -> maker of one random instance, millimetres, z up, its base's centre at the origin, 270 mm long.

Labels that ImageNet has are spelled as there (`pot` is its `pot, flowerpot`).
"""


def make_everyday(label: str, seed: tuple[int, ...] | int) -> Mesh:
    """One random instance of a kind; the same seed makes the same bytes.

    Raises:
        ToolkitError: an unknown label; names the nearest known ones.
    """
    if label not in MAKERS:
        raise one_of("everyday object", label, list(MAKERS))
    return MAKERS[label](np.random.default_rng(seed))
