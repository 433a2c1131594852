"""In which order variants are shown: bare object, booster, then the controls."""

from toolkit.captures.variants import CONTROLS, VARIANTS

PATCHED, WRONG, ALONE = "patched", "wrong-patch", "patch-alone"
RIVALS = tuple(name for name in CONTROLS if name != ALONE)
"""Controls that are stuck on the object where the patch was."""


def rank_variant(variant: str) -> tuple[int, str]:
    """Sort key: `unpatched`, `patched`, other boosters by name, then the controls as `capture-sim` lists them."""
    if variant in CONTROLS:
        return len(VARIANTS) + CONTROLS.index(variant), variant
    return (VARIANTS.index(variant) if variant in VARIANTS else len(VARIANTS) - 1), variant
