"""Rooms: the parts of the kit beside its core, each a folder of `toolkit/rooms` whose `room.py` says what it adds.

The core imports no room. It asks for what rooms offer by a name, and an error says which room is missing.
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
}  # fmt: skip
"""What each room of the kit adds, its commands by their first words, so that a room that is missing can be named."""
NOTHING: Mapping[str, Any] = MappingProxyType({})


class Entry(NamedTuple):
    """A command in the list.

    Attributes:
        place: `module:function` below `toolkit.cli`, or below the room.
        about: what it does, in a few words.
        old: earlier spelling of an option -> today's. It goes on working, and no help shows it.
    """

    place: str
    about: str
    old: Mapping[str, str] = NOTHING


class Room(NamedTuple):
    """What a room adds to the core. Its places are `module:name` below the room; each loads when it is used.

    Attributes:
        needs: rooms that it imports.
        commands: heading in the help -> name -> command; they follow those that the heading has already.
        words: word that several commands begin with -> what the help says of them.
        offers: what the core asks for by this name -> its place.
    """

    needs: tuple[str, ...] = ()
    commands: Mapping[str, Mapping[str, Entry]] = NOTHING
    words: Mapping[str, str] = NOTHING
    offers: Mapping[str, str] = NOTHING


@cache
def find_rooms() -> dict[str, Room]:
    """Return the rooms that are installed together with all rooms that they need, by name."""
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
    """Import what lies at `package.module:name`."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


@cache
def list_offers() -> dict[str, str]:
    """Return what the rooms that are installed offer, by name, and the place of each."""
    return {
        what: f"{PACKAGE}.{name}.{place}" for name, room in find_rooms().items() for what, place in room.offers.items()
    }


def find_offer(what: str) -> Any:
    """Return what a room that is installed offers by this name; None if none does."""
    place = list_offers().get(what)
    return None if place is None else load(place)


def find_code(prefix: str) -> list[Path]:
    """Return the folders, directly below a room, of the modules behind the offers whose names begin with a prefix."""
    places = [
        place.removeprefix(f"{PACKAGE}.").split(".") for what, place in list_offers().items() if what.startswith(prefix)
    ]
    return sorted({FOLDER / room / folder for room, folder, *_ in places})


def ask_room(what: str) -> Any:
    """Return what a room offers by this name.

    Raises:
        ToolkitError: its room is not installed.
    """
    offer = find_offer(what)
    if offer is None:
        raise explain_missing(what) or LookupError(f"no room offers '{what}'")
    return offer


def explain_missing(what: str) -> ToolkitError | None:
    """Return the error for a command or an offer of a room of the kit that is not installed; None for any other."""
    room = next((name for name, has in SHIPPED.items() if what in has and name not in find_rooms()), None)
    if room is None:
        return None
    words = f"'{what}' belongs to the room '{room}', "
    if room in _list_rooms():
        room = next(name for name in _list_rooms()[room].needs if name not in find_rooms())
        words += f"which needs the room '{room}', "
    return ToolkitError(f"{words}which is not installed: put toolkit/rooms/{room} back, or install toolkit-boost again")
