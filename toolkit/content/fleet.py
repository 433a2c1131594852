"""A city's vehicles: every make once, and how often each is met parked and on the move."""

from dataclasses import dataclass

from toolkit.content.large_vehicles import bus, lorry, tram, van
from toolkit.content.pieces import Looks
from toolkit.content.vehicles import CAB_YELLOW, CAR_COLOURS, HATCH, MINIVAN, SEDAN, SUV, WAGON, Vehicle, car

RED, BLUE, GREEN, WHITE = (186, 28, 34), (30, 80, 160), (34, 104, 70), (236, 236, 232)


@dataclass(frozen=True)
class Fleet:
    """Vehicles by what they do.

    Attributes:
        private, cabs, vans, buses, trams, lorries: each at least one.
    """

    private: tuple[Vehicle, ...]
    cabs: tuple[Vehicle, ...]
    vans: tuple[Vehicle, ...]
    buses: tuple[Vehicle, ...]
    trams: tuple[Vehicle, ...]
    lorries: tuple[Vehicle, ...]

    def parked(self) -> list[tuple[tuple[Vehicle, ...], float]]:
        """What stands along a kerb, with its share."""
        return [(self.private, 0.72), (self.cabs, 0.16), (self.vans, 0.08), (self.lorries, 0.04)]

    def moving(self) -> list[tuple[tuple[Vehicle, ...], float]]:
        """What drives, with its share."""
        return [(self.private, 0.4), (self.cabs, 0.38), (self.vans, 0.07), (self.buses, 0.11), (self.lorries, 0.04)]


def build_fleet(looks: Looks) -> Fleet:
    """All makes in their colours."""
    makes = [
        (SEDAN, (0, 1, 3, 4, 5)), (HATCH, (4, 9, 11, 2)), (WAGON, (5, 7, 8)), (SUV, (1, 0, 6, 10)), (MINIVAN, (3, 5)),
    ]  # fmt: skip
    names = {id(SEDAN): "sedan", id(HATCH): "hatch", id(WAGON): "wagon", id(SUV): "suv", id(MINIVAN): "minivan"}
    private = [car(body, CAR_COLOURS[k], looks, f"{names[id(body)]}-{k}") for body, colours in makes for k in colours]
    private.append(car(SEDAN, (28, 29, 32), looks, "police", "police"))
    cabs = (car(SEDAN, CAB_YELLOW, looks, "cab", "cab"), car(MINIVAN, CAB_YELLOW, looks, "cab-van", "cab"))
    vans = (
        van(WHITE, "PARCELS", looks, "van-white"),
        van((120, 76, 34), "UNITED POST", looks, "van-brown"),
        van(WHITE, "AMBULANCE", looks, "ambulance"),
        van(BLUE, "PLUMBER", looks, "van-blue"),
    )
    buses = (
        bus(looks, "bus-blue", BLUE, "42 CENTRAL"),
        bus(looks, "trolley-red", RED, "7 HARBOUR", trolley=True),
        bus(looks, "trolley-green", GREEN, "12 MARKET", trolley=True),
        bus(looks, "school", (246, 178, 16), "SCHOOL BUS"),
    )
    trams = (tram(looks, "tram-red", RED, "9 MARKET"), tram(looks, "tram-green", GREEN, "3 RIVER"))
    lorries = (
        lorry(looks, "lorry-red", RED, (238, 236, 228), "MOVERS"),
        lorry(looks, "lorry-blue", BLUE, (40, 90, 160), "FRESH FISH"),
        lorry(looks, "lorry-green", GREEN, (34, 104, 70), "CITY REFUSE"),
    )
    return Fleet(tuple(private), cabs, vans, buses, trams, lorries)
