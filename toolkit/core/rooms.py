"""Rooms: parts beside the core, each a folder of `toolkit/rooms` whose `room.py` lists what it adds.

The core imports no room. It asks for offers of rooms by name; an error names a missing room.
"""

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from toolkit.core.errors import ToolkitError

FOLDER, PACKAGE = Path(__file__).parents[1] / "rooms", "toolkit.rooms"
SHIPPED: Mapping[str, tuple[str, ...]] = {
    "benchmarks": (
        "sweep", "train-patches", "baseline", "corrupt-eval", "transfer", "challenge", "patches in training",
    ),
    "landing": ("landing",),
    "photos": (
        "studio", "import", "check", "retexture", "calibrate", "print-profile",
        "shot list", "found patches", "failed gates",
    ),
    "worlds": (
        "world", "world-eval", "times of day", "weather", "everyday",
        "builtin:racer", "builtin:warplane", "builtin:coffeepot", "builtin:eggnog",
    ),
    "wraps": ("wrap", "train-wrap", "variant:wrapped", "printed wrap"),
}  # fmt: skip
"""Offers and first words of commands of each built-in room, so that an error can name a missing room."""
NOTHING: Mapping[str, Any] = MappingProxyType({})


class Entry(NamedTuple):
    """A command in the list.

    Attributes:
        place: `module:function` below `toolkit.cli`, or below the room.
        old: earlier spelling of an option -> present spelling; it still works, and no help shows it.
        after: command that it follows in the list; by default it is the last under its heading.
    """

    place: str
    about: str
    old: Mapping[str, str] = NOTHING
    after: str = ""


class Room(NamedTuple):
    """Additions of a room to the core. Places are `module:name` below the room; each loads when it is used.

    Attributes:
        needs: rooms that it imports.
        commands: heading in the help -> name -> command.
        words: first word of several commands -> their help.
        offers: name of an offer -> its place.
    """

    needs: tuple[str, ...] = ()
    commands: Mapping[str, Mapping[str, Entry]] = NOTHING
    words: Mapping[str, str] = NOTHING
    offers: Mapping[str, str] = NOTHING


@cache
def find_rooms() -> dict[str, Room]:
    """Return the installed rooms whose needed rooms are installed too, by name."""
    rooms = dict(_list_rooms())
    while broken := [name for name, room in rooms.items() if not rooms.keys() >= {*room.needs}]:
        for name in broken:
            del rooms[name]
    return rooms


@cache
def _list_rooms() -> dict[str, Room]:
    rooms = {}
    for name in sorted(file.parent.name for file in FOLDER.glob("*/room.py")):
        try:
            rooms[name] = import_module(f"{PACKAGE}.{name}.room").ROOM
        except ModuleNotFoundError as error:
            if error.name not in (PACKAGE, f"{PACKAGE}.{name}"):
                raise
    return rooms


def load(place: str) -> Any:
    """Import the object at `package.module:name`."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


@cache
def list_offers() -> dict[str, str]:
    """Return the place of each offer of the installed rooms, by name."""
    offers = [(name, *offer) for name, room in find_rooms().items() for offer in room.offers.items()]
    return {what: f"{PACKAGE}.{name}.{place}" for name, what, place in offers}


def find_offer(what: str) -> Any:
    """Return the offer of an installed room by its name; None if there is none."""
    place = list_offers().get(what)
    return None if place is None else load(place)


def find_offers(prefix: str) -> list[Any]:
    """Return the offers of installed rooms whose names begin with a prefix."""
    return [load(place) for what, place in list_offers().items() if what.startswith(prefix)]


def find_code(prefix: str) -> list[Path]:
    """Return the folders, directly below a room, with the modules of offers whose names begin with a prefix."""
    found = [place for what, place in list_offers().items() if what.startswith(prefix)]
    places = [place.removeprefix(f"{PACKAGE}.").split(".") for place in found]
    return sorted({FOLDER / room / folder for room, folder, *_ in places})


def ask_room(what: str) -> Any:
    """Return the offer of a room by its name; a `ToolkitError` if the room is not installed."""
    offer = find_offer(what)
    if offer is None:
        raise explain_missing(what) or LookupError(f"no room offers '{what}'")
    return offer


def explain_missing(what: str) -> ToolkitError | None:
    """Return the error for a command or offer of a built-in room that is not installed; None for any other."""
    room = next((name for name, has in SHIPPED.items() if what in has and name not in find_rooms()), None)
    if room is None:
        return None
    words = f"'{what}' belongs to the room '{room}', "
    if room in _list_rooms():
        room = next(name for name in _list_rooms()[room].needs if name not in find_rooms())
        words += f"which needs the room '{room}', "
    return ToolkitError(f"{words}which is not installed: put toolkit/rooms/{room} back, or install toolkit-boost again")
