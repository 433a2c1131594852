"""Which ImageNet classes are a city's: what the empty city is measured against.

The list was fixed before the first measurement and is not widened afterwards. A class is on it if the thing stands in a
street, or is a building that is seen from a street. What a bare facade may be taken for (window screen, window shade,
prison, shoji, crossword puzzle …) is left out on purpose, and so are landscapes, boats and aircraft.
"""

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
"""73 of torchvision's ImageNet category names."""


def urban_indices(labels: list[str]) -> frozenset[int]:
    """Indices of the urban classes among a network's labels; of the two cranes the later is the machine."""
    last = {label: index for index, label in enumerate(labels)}
    return frozenset(last[name] for name in URBAN_CLASSES)
