"""Contact sheets and pose charts of the report, with thumbnails of the images."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import asin, atan2, cos, degrees, pi, radians, sin, sqrt
from typing import TypeVar

import numpy as np
from PIL import Image

from toolkit.captures.capture import Capture
from toolkit.core.child import count_cores
from toolkit.core.threads import map_ahead
from toolkit.evaluation.metrics import FlipList, rank_variant
from toolkit.evaluation.page import embed_picture
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.read_pixels import MAX_DECODERS, read_pixels
from toolkit.imaging.read import UnreadableImage, encode_image, read_image
from toolkit.models.network import Classifier

Seen = list[tuple[tuple[float, float], Prediction]]
"""(azimuth, elevation) in degrees of each image, and its prediction."""
RADIUS = 100.0
LARGEST_DOT, SMALLEST_DOT, DOT_SHARE = 11.0, 2.5, 46.0
SIDE_PX = 240
MAX_BYTES = 12_000
QUALITIES = (80, 65, 50, 35, 20)
Item = TypeVar("Item")
MAX_PICTURES = 600
MANY_SHEETS, FEW_CARDS = 12, 3


@dataclass(frozen=True)
class PoseDot:
    """A direction in which `n_right` of `n` images are correct.

    Attributes:
        x, y: place on the chart, y down, the rim at distance 100.
        wedge: SVG path of the correct slice; empty for none or all.
        azimuth_deg, elevation_deg: direction from the object to the camera.
    """

    x: float
    y: float
    wedge: str
    azimuth_deg: float
    elevation_deg: float
    n: int
    n_right: int


@dataclass(frozen=True)
class PoseChart:
    """Chart of a source and variant.

    Attributes:
        rings: (radius, label) of circles of equal elevation; the centre looks straight down.
    """

    source: str
    variant: str
    rings: tuple[tuple[float, str], ...]
    dots: tuple[PoseDot, ...]
    dot_radius: float


def read_direction(capture: Capture) -> tuple[float, float] | None:
    """Return (azimuth, elevation) in degrees of the camera by its optical axis; None if the pose is unknown.

    Azimuth 0 looks at the front (+x), counter-clockwise from above.
    """
    T_world_camera = capture.T_world_camera
    if T_world_camera is None:
        return None
    # the third column is the viewing direction; the camera lies backwards from there
    x, y, z = (-T_world_camera[row][2] for row in range(3))
    length = sqrt(x * x + y * y + z * z)
    # a column of a rotation has length 1
    if not 0.5 < length < 2:
        return None
    azimuth = degrees(atan2(y, x)) % 360
    # an azimuth of 359.96 would be shown as 360.0
    return (0.0 if azimuth > 359.95 else azimuth), degrees(asin(max(-1.0, min(1.0, z / length))))


def chart_poses(predictions: Sequence[Prediction]) -> list[PoseChart]:
    """Return a chart for each source and variant with a known pose; `unpatched` first."""
    found: dict[tuple[str, str], Seen] = defaultdict(list)
    for prediction in predictions:
        direction = read_direction(prediction.capture)
        if direction is not None and prediction.is_read:
            found[(prediction.capture.source, prediction.capture.variant)].append((direction, prediction))
    lowest: dict[str, float] = defaultdict(float)
    for (source, _), seen in found.items():
        # the same rim for all variants of a source, so that their charts can be compared
        lowest[source] = min(lowest[source], *(direction[1] for direction, _ in seen))
    keys = sorted(found, key=lambda key: (key[0], rank_variant(key[1])))
    return [_chart(*key, found[key], lowest[key[0]]) for key in keys]


def _chart(source: str, variant: str, seen: Seen, lowest: float) -> PoseChart:
    # the rim is the next ring of 30° below the lowest camera
    rim_deg = 30.0 * (lowest // 30)
    by_place: dict[tuple[int, int], Seen] = defaultdict(list)
    for direction, prediction in seen:
        # to a degree: objects that share a plan share their dots
        by_place[(round(direction[0]) % 360, round(direction[1]))].append((direction, prediction))
    # by the root of their number: dots share the disc's area
    dot_radius = min(LARGEST_DOT, max(SMALLEST_DOT, DOT_SHARE / sqrt(len(by_place))))
    scale = RADIUS / (90 - rim_deg)
    rings = tuple((scale * (90 - ring_deg), f"{ring_deg:.0f}°") for ring_deg in np.arange(rim_deg, 90.0, 30.0).tolist())
    dots = []
    for place in sorted(by_place):
        azimuth, elevation = by_place[place][0][0]
        rights = [prediction.correct_top1 for _, prediction in by_place[place]]
        # seen from above with the object's front towards the reader: azimuth 0 points down, 90 (its left) to the right
        r = scale * (90 - elevation)
        x, y = r * sin(radians(azimuth)), r * cos(radians(azimuth))
        n, n_right = len(rights), sum(rights)
        dots.append(PoseDot(x, y, _wedge(x, y, dot_radius, n_right / n), azimuth, elevation, n=n, n_right=n_right))
    return PoseChart(source, variant, rings, tuple(dots), dot_radius)


def _wedge(x: float, y: float, radius: float, share: float) -> str:
    if share in (0.0, 1.0):
        return ""
    # a slice of the pie from twelve o'clock, clockwise
    end_x, end_y = x + radius * sin(2 * pi * share), y - radius * cos(2 * pi * share)
    # SVG's flag for the longer of the two arcs between two points
    large = int(share > 0.5)
    return f"M{x:.2f} {y:.2f}V{y - radius:.2f}A{radius:.2f} {radius:.2f} 0 {large} 1 {end_x:.2f} {end_y:.2f}Z"


def describe_place(prediction: Prediction) -> str:
    """Return `60° around, 40° up`, or nothing if the pose is unknown."""
    direction = read_direction(prediction.capture)
    return "" if direction is None else f"{direction[0]:.0f}° around, {direction[1]:.0f}° up"


def make_thumbnails(
    captures: Iterable[Capture], classifier: Classifier | None, side_px: int = SIDE_PX
) -> dict[str, str]:
    """Return JPEG `data:` URIs of at most 12 kB by path, without images that do not decode any more.

    An image that is corrupted when it is read is shown as the network sees it; without a network it is left out.
    """

    # corrupted when it is read: it is shown as the network sees it, or not at all
    def make(capture: Capture) -> str | None:
        if capture.pending_corruption is None:
            try:
                pixels: np.ndarray | str = read_image(capture.file, side_px)
            except UnreadableImage as error:
                pixels = error.reason
        elif classifier is not None:
            pixels = read_pixels(capture, classifier.preprocessing)
        else:
            return None
        return None if isinstance(pixels, str) else encode_jpeg(Image.fromarray(pixels), side_px)

    wanted = {capture.path: capture for capture in captures}
    made = map_ahead(make, wanted.values(), min(MAX_DECODERS, count_cores()))
    return {path: uri for path, uri in zip(wanted, made, strict=True) if uri}


def encode_jpeg(image: Image.Image, side_px: int = SIDE_PX) -> str:
    """Return an image as a JPEG `data:` URI of at most `side_px` and 12 kB."""
    image.thumbnail((side_px, side_px), Image.Resampling.LANCZOS)
    content = b""
    # the best quality that fits
    for quality in QUALITIES:
        content = encode_image(image, "JPEG", quality=quality, optimize=True)
        if len(content) <= MAX_BYTES:
            break
    return embed_picture(content, "jpeg")


@dataclass(frozen=True)
class Card:
    """A pose in every variant, or an image without a pose.

    Attributes:
        title: `pose 3`, or the file's name.
        place: azimuth and elevation in words, empty if unknown.
        cells: images in the order of `rank_variant`.
    """

    title: str
    place: str
    cells: tuple[Prediction, ...]


@dataclass(frozen=True)
class ContactSheet:
    """An object of a source (or many small objects): the cards to show, and the number of all cards."""

    source: str
    object: str
    true_label: str
    cards: tuple[Card, ...]
    n_cards: int


def lay_out(predictions: Sequence[Prediction], max_pictures: int = MAX_PICTURES) -> tuple[list[ContactSheet], int]:
    """Return contact sheets by source and object, thinned to `max_pictures`, and the number of hidden objects."""
    # a sheet for each source and object
    members: dict[tuple[str, str], list[Prediction]] = defaultdict(list)
    for prediction in predictions:
        members[(prediction.capture.source, prediction.capture.object)].append(prediction)
    keys = sorted(members)
    cards = {key: _deal(members[key]) for key in keys}
    widest = max((len(card.cells) for deck in cards.values() for card in deck), default=1)
    # of too many, some sheets are shown, each with some of its cards
    shown = keys if len(predictions) <= max_pictures else _thin(keys, max(1, max_pictures // widest))
    sheets = []
    for key in shown:
        deck = cards[key]
        room = len(deck) if len(predictions) <= max_pictures else max(1, max_pictures // (widest * len(shown)))
        source, name = key
        sheets.append(ContactSheet(source, name, members[key][0].true_label, tuple(_thin(deck, room)), len(deck)))
    return _gather(sheets), len(keys) - len(shown)


def lay_out_flips(flips: FlipList) -> list[Card]:
    """Return a card for each flip, with the image before and the image after."""
    cards = []
    for pair in flips.shown:
        capture = pair.second.capture
        title = f"{capture.source} · {capture.object} · pose {capture.pose_id}"
        cards.append(Card(title, describe_place(pair.second), (pair.first, pair.second)))
    return cards


def _deal(members: list[Prediction]) -> list[Card]:
    poses: dict[int, dict[str, Prediction]] = defaultdict(dict)
    loose: list[Prediction] = []
    for prediction in members:
        pose_id, variant = prediction.capture.pose_id, prediction.capture.variant
        first = None if pose_id is None else poses[pose_id].get(variant)
        # of two images of the same pose and variant, the readable image is in the card, the other gets its own card
        if pose_id is None or (first is not None and (first.is_read or not prediction.is_read)):
            loose.append(prediction)
            continue
        if first is not None:
            loose.append(first)
        poses[pose_id][variant] = prediction
    cards = []
    for pose_id in sorted(poses):
        cells = sorted(poses[pose_id].values(), key=lambda prediction: rank_variant(prediction.capture.variant))
        cards.append(Card(f"pose {pose_id}", describe_place(cells[0]), tuple(cells)))
    # images that are in no card of their pose
    names = [prediction.capture.path.rsplit("/", 1)[-1] for prediction in loose]
    return cards + [Card(name, describe_place(only), (only,)) for name, only in zip(names, loose, strict=True)]


def _gather(sheets: list[ContactSheet]) -> list[ContactSheet]:
    """Join many objects with an image or two each, as in an ImageFolder, into a sheet for each source."""
    if len(sheets) <= MANY_SHEETS or sum(len(sheet.cards) for sheet in sheets) > FEW_CARDS * len(sheets):
        return sheets
    gathered = []
    for source in dict.fromkeys(sheet.source for sheet in sheets):
        own = [sheet for sheet in sheets if sheet.source == source]
        titled = [(f"{sheet.true_label} · {card.title}", card) for sheet in own for card in sheet.cards]
        cards = tuple(replace(card, title=title) for title, card in titled)
        name = f"{len(own)} objects"
        gathered.append(ContactSheet(source, name, name, cards, sum(sheet.n_cards for sheet in own)))
    return gathered


def _thin(items: Sequence[Item], room: int) -> list[Item]:
    if len(items) <= room:
        return list(items)
    # evenly spread, with the first
    return [items[index * len(items) // room] for index in range(room)]
