"""The table of kinds of boosters. Commands know the kinds in it alone."""

from toolkit.core.rooms import find_offers
from toolkit.rig.applied.base import BoosterKind
from toolkit.rig.applied.patch import PATCH
from toolkit.rig.applied.texture import TEXTURE

KINDS: list[BoosterKind] = [PATCH, TEXTURE, *find_offers("variant:")]
"""In the order of tables and pages; those of rooms come last."""


def register(kind: BoosterKind) -> None:
    """Add a kind of booster, before `toolkit.rig.variants` is imported, which makes its lists from the table."""
    KINDS.append(kind)
