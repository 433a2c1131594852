"""Draw the images of a landing's regressor: two pads from 5 m, on grass and on a roof, in several weathers.

Called as landing_pads.py PNG WORKSPACE PAD; PAD is one of WORKSPACE/print/pads, beside the plain one.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from toolkit.core.workspace import open_workspace
from toolkit.rooms.landing.config import CameraConfig
from toolkit.rooms.landing.episodes import place_cameras
from toolkit.rooms.landing.site import Pad, PadSite, SiteView, find_pad, find_sky, find_world, plan_places

SIDE_PX, SEED = 192, 7
SHOWN = {
    "clear, 5 m up": ("noon", ("clear", 0)), "clear, dusk": ("dusk", ("clear", 0)),
    "fog:5 (10 m)": ("noon", ("fog", 5)), "snow:2": ("noon", ("snow", 2)), "snow:3": ("noon", ("snow", 3)),
}  # fmt: skip
PLACES = (("grass", "both", 1), ("city", "pads", 3))


def main(picture: str, space: str, name: str) -> None:
    """Draw it."""
    pads = [find_pad(open_workspace(Path(space)), one) for one in ("plain", name)]
    rows = [
        np.hstack([_frame(pad.picture), *(_frame(one) for one in _photograph(pad, *place))])
        for place in PLACES
        for pad in pads
    ]
    head = np.full((28, rows[0].shape[1], 3), 255, np.uint8)
    for k, title in enumerate(("the pad", *SHOWN)):
        at = (8 + k * (SIDE_PX + 8), 20)
        cv2.putText(head, title, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (30, 30, 30), 1, cv2.LINE_AA)
    sheet = np.ascontiguousarray(np.vstack([head, *rows])[..., ::-1])
    cv2.imwrite(picture, sheet, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def _photograph(pad: Pad, world_name: str, ground: str, number: int) -> list[np.ndarray]:
    world = find_world(world_name)
    place = plan_places(world, pad.size_m, 8, SEED, ground)[number]
    photographs = []
    for time, weather in SHOWN.values():
        site = PadSite(world, place, find_sky(time), pad, CameraConfig(image_px=64))
        up = np.add(site.centre, (1.0, 0.6, 5.0))[None]
        pose = place_cameras(up, np.array([1.0]), np.array([0.0]), np.zeros((1, 2)))[0]
        photographs.append(site.photograph(SiteView(pose, 0, 5, weather)))
    return photographs


def _frame(image: np.ndarray) -> np.ndarray:
    how = cv2.INTER_AREA if image.shape[0] > SIDE_PX else cv2.INTER_NEAREST
    return np.pad(
        cv2.resize(image, (SIDE_PX, SIDE_PX), interpolation=how), ((4, 4), (4, 4), (0, 0)), constant_values=255
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
