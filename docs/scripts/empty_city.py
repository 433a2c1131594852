"""Does the empty city distract as a street does? Called as empty_city.py [--views 500] [--out FILE].

View i is drawn from (seed, i) alone: a place anywhere in the city's core with over a metre of room, a height of 1.5 to
30 m above the ground (even in its logarithm), any direction, a pitch from 15° down to 5° up. The network answers, and
its top-5 is compared with the classes of a city, which were listed before the first measurement.
"""

import argparse
import json
from collections import Counter
from pathlib import Path

import numpy as np

from toolkit.core.console import progress
from toolkit.core.draws import Draws
from toolkit.core.files import write_json
from toolkit.core.statistics import wilson_interval
from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier
from toolkit.models.predict import predict
from toolkit.rig.camera import Camera, look_at, orbit_direction
from toolkit.rig.shading import tone_map
from toolkit.rooms.worlds.own import build_world
from toolkit.rooms.worlds.picture import leave_empty, make_renderer
from toolkit.rooms.worlds.sky import make_sky
from toolkit.rooms.worlds.viewpoints import clearance
from toolkit.rooms.worlds.world import World

HEIGHTS_M, PITCHES_DEG, ROOM_M, FOV_DEG = (1.5, 30.0), (-15.0, 5.0), 1.0, 60.0
BATCH = 20
STREET = (
    "street sign", "traffic light", "parking meter", "pay-phone", "mailbox", "ashcan", "park bench", "flagpole",
    "fountain", "manhole cover", "pole", "gas pump", "cash machine", "turnstile", "pedestal", "spotlight",
)  # fmt: skip
VEHICLES = (
    "cab", "minivan", "limousine", "beach wagon", "sports car", "convertible", "jeep", "pickup", "police van",
    "ambulance", "fire engine", "garbage truck", "tow truck", "moving van", "trailer truck", "minibus", "school bus",
    "trolleybus", "streetcar", "passenger car", "electric locomotive", "recreational vehicle", "motor scooter",
    "moped", "mountain bike", "bicycle-built-for-two", "jinrikisha", "car wheel", "car mirror", "grille",
)  # fmt: skip
BUILDINGS = (
    "church", "bell cote", "dome", "monastery", "mosque", "palace", "library", "cinema", "restaurant", "bakery",
    "barbershop", "bookshop", "butcher shop", "confectionery", "grocery store", "shoe shop", "tobacco shop",
    "toyshop", "planetarium", "triumphal arch", "obelisk", "viaduct", "steel arch bridge", "suspension bridge",
    "tile roof", "water tower", "crane",
)  # fmt: skip
URBAN_CLASSES = STREET + VEHICLES + BUILDINGS
"""73 of torchvision's ImageNet category names: what stands in a street, or is a building that is seen from a street.

The list was fixed before the first measurement and is not widened afterwards. What a bare facade may be taken for
(window screen, window shade, prison, shoji, crossword puzzle …) is left out on purpose, and so are landscapes, boats
and aircraft.
"""


def urban_indices(labels: list[str]) -> frozenset[int]:
    """Indices of the urban classes among a network's labels; of the two cranes the later is the machine."""
    last = {label: index for index, label in enumerate(labels)}
    return frozenset(last[name] for name in URBAN_CLASSES)


def draw_view(world: World, seed: int, item: int) -> np.ndarray:
    """(4, 4) `T_world_camera` of view `item`."""
    rng = Draws(seed, item, "empty").of("view")
    while True:
        at = rng.uniform(*world.core)
        height = float(np.exp(rng.uniform(*np.log(HEIGHTS_M))))
        towards = orbit_direction(rng.uniform(0, 360), rng.uniform(*PITCHES_DEG))
        place = np.append(at, float(world.ground_height(at[None])[0]) + height)
        if not np.isfinite(place).all() or world.inside_building(place[None])[0]:
            continue
        if clearance(world, place[None])[0] > ROOM_M:
            return look_at(place, place + towards)


def measure(world: World, classifier: Classifier, views: int, time: str = "afternoon", seed: int = 0) -> dict:
    """How often an urban class is in the top-5, how many different answers there are, and which."""
    renderer, urban = make_renderer(leave_empty(world, make_sky(time))), urban_indices(classifier.labels)
    side = classifier.preprocessing.crop_px
    camera, hits, answers = Camera.from_fov(side, side, FOV_DEG), 0, Counter()
    with progress("views of the empty city", views) as bar:
        for start in range(0, views, BATCH):
            items = range(start, min(start + BATCH, views))
            poses = [(camera, draw_view(world, seed, item)) for item in items]
            pictures = [tone_map(x, (seed, k)) for k, x in zip(items, renderer.render_many(poses), strict=True)]
            top = predict(pictures, classifier).topk(5).indices.tolist()
            hits += sum(bool(urban & set(five)) for five in top)
            answers.update(classifier.labels[five[0]] for five in top)
            bar.advance(len(top))
    low, high = wilson_interval(hits, views)
    return {
        "world": f"{world.name}/{world.seed}", "world_sha256": world.sha256, "time": time, "views": views, "seed": seed,
        "network": classifier.arch, "urban_top5": hits, "urban_share": round(hits / views, 4),
        "ci95": [round(low, 4), round(high, 4)], "answers": len(answers), "most_frequent": answers.most_common(12),
    }  # fmt: skip


def main() -> None:
    """Measure and print."""
    typed = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    typed.add_argument("--views", type=int, default=500)
    typed.add_argument("--model", default="resnet18")
    typed.add_argument("--time", default="afternoon")
    typed.add_argument("--out", type=Path)
    given = typed.parse_args()
    found = measure(build_world("city"), load_classifier(given.model), given.views, given.time)
    if given.out:
        write_json(given.out, found)
    print(json.dumps(found, indent=2))  # noqa: T201


if __name__ == "__main__":
    main()
