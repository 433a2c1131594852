"""In which order variants are shown: bare object, boosters, then the controls; and what they are called in words."""

from toolkit.captures.variants import CONTROLS, CONTROLS_OF, VARIANTS

PATCHED, TEXTURED, WRONG, ALONE = "patched", "textured", "wrong-patch", "patch-alone"
NOUNS = {PATCHED: "patch", TEXTURED: "texture"}
RIVALS = {booster: tuple(name for name in names if name != ALONE) for booster, names in CONTROLS_OF.items()}
"""By booster, the controls that are on the object where the booster was."""
OWNERS = {control: booster for booster, names in CONTROLS_OF.items() for control in names}
"""By control, the booster that it belongs to."""


def rank_variant(variant: str) -> tuple[int, str]:
    """Sort key: `unpatched`, `patched`, `textured`, other boosters by name, controls as `CONTROLS` has them."""
    if variant in CONTROLS:
        return len(VARIANTS) + CONTROLS.index(variant), variant
    return (VARIANTS.index(variant) if variant in VARIANTS else len(VARIANTS) - 1), variant


def name_booster(variant: str) -> str:
    """`the patch`, `the texture`, or the variant in quotes."""
    return f"the {NOUNS[variant]}" if variant in NOUNS else f"'{variant}'"
