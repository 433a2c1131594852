"""The table of kinds of boosters. Commands know the kinds in it alone."""

from toolkit.rig.applied.base import BoosterKind
from toolkit.rig.applied.patch import PATCH
from toolkit.rig.applied.texture import TEXTURE
from toolkit.rig.applied.wrap import WRAP

KINDS: list[BoosterKind] = [PATCH, TEXTURE, WRAP]
"""In the order of tables and pages."""


def register(kind: BoosterKind) -> None:
    """Add a kind of booster, before `toolkit.rig.variants` is imported, which makes its lists from the table."""
    KINDS.append(kind)
