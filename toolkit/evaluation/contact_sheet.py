"""Which images stand side by side in the report."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

from toolkit.evaluation.flips import FlipList
from toolkit.evaluation.order import rank_variant
from toolkit.evaluation.poses import read_direction
from toolkit.evaluation.predict import Prediction

MAX_PICTURES = 600
MANY_SHEETS, FEW_CARDS = 12, 3


@dataclass(frozen=True)
class Card:
    """One pose in every variant, or one image that has no pose.

    Attributes:
        title: `pose 3`, or the file's name.
        place: azimuth and elevation in words, empty where unknown.
        cells: the images, in the order of `rank_variant`.
    """

    title: str
    place: str
    cells: tuple[Prediction, ...]


@dataclass(frozen=True)
class Sheet:
    """One object of one source (or many small ones): the cards that are shown, and how many there are."""

    source: str
    object: str
    true_label: str
    cards: tuple[Card, ...]
    n_cards: int


def lay_out(predictions: Sequence[Prediction], max_pictures: int = MAX_PICTURES) -> tuple[list[Sheet], int]:
    """Contact sheets by source and object, evenly thinned to about `max_pictures` images.

    Returns:
        The sheets, and the number of objects that found no room.
    """
    members: dict[tuple[str, str], list[Prediction]] = defaultdict(list)
    for one in predictions:
        members[(one.capture.source, one.capture.object)].append(one)
    keys = sorted(members)
    cards = {key: _deal(members[key]) for key in keys}
    widest = max((len(card.cells) for deck in cards.values() for card in deck), default=1)
    shown = keys if len(predictions) <= max_pictures else _thin(keys, max(1, max_pictures // widest))
    sheets = []
    for key in shown:
        deck = cards[key]
        room = len(deck) if len(predictions) <= max_pictures else max(1, max_pictures // (widest * len(shown)))
        source, name = key
        sheets.append(Sheet(source, name, members[key][0].true_label, tuple(_thin(deck, room)), len(deck)))
    return _gather(sheets), len(keys) - len(shown)


def lay_out_flips(flips: FlipList) -> list[Card]:
    """A card for each flip that is shown, the image before and the image after."""
    cards = []
    for match in flips.shown:
        capture = match.after.capture
        title = f"{capture.source} · {capture.object} · pose {capture.pose_id}"
        cards.append(Card(title, say_place(match.after), (match.before, match.after)))
    return cards


def say_place(one: Prediction) -> str:
    """`60° around, 40° up`, or nothing where the pose is unknown."""
    direction = read_direction(one.capture)
    return "" if direction is None else f"{direction[0]:.0f}° around, {direction[1]:.0f}° up"


def _deal(members: list[Prediction]) -> list[Card]:
    poses: dict[int, dict[str, Prediction]] = defaultdict(dict)
    loose: list[Prediction] = []
    for one in members:
        first = poses[one.capture.pose_id].get(one.capture.variant) if one.capture.pose_id is not None else None
        if one.capture.pose_id is None or (first is not None and (first.is_read or not one.is_read)):
            loose.append(one)
            continue
        if first is not None:
            loose.append(first)
        poses[one.capture.pose_id][one.capture.variant] = one
    cards = []
    for pose_id in sorted(poses):
        cells = sorted(poses[pose_id].values(), key=lambda one: rank_variant(one.capture.variant))
        cards.append(Card(f"pose {pose_id}", say_place(cells[0]), tuple(cells)))
    return cards + [Card(one.capture.path.rsplit("/", 1)[-1], say_place(one), (one,)) for one in loose]


def _gather(sheets: list[Sheet]) -> list[Sheet]:
    """One sheet per source where there are many objects with an image or two each, as in an ImageFolder."""
    if len(sheets) <= MANY_SHEETS or sum(len(sheet.cards) for sheet in sheets) > FEW_CARDS * len(sheets):
        return sheets
    gathered = []
    for source in dict.fromkeys(sheet.source for sheet in sheets):
        own = [sheet for sheet in sheets if sheet.source == source]
        cards = tuple(
            replace(card, title=f"{sheet.true_label} · {card.title}") for sheet in own for card in sheet.cards
        )
        name = f"{len(own)} objects"
        gathered.append(Sheet(source, name, name, cards, sum(sheet.n_cards for sheet in own)))
    return gathered


def _thin(items: Sequence, room: int) -> list:
    if len(items) <= room:
        return list(items)
    return [items[index * len(items) // room] for index in range(room)]
