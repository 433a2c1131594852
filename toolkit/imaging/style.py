"""The style of every figure: one font, one palette, one name for each network and variant, one way to draw accuracy."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# a palette that people who see fewer colours can tell apart (Okabe and Ito 2008)
BLUE: str = "#0072b2"
ORANGE: str = "#d55e00"
GREEN: str = "#009e73"
PINK: str = "#cc79a7"
AMBER: str = "#e69f00"
SKY: str = "#56b4e9"
COLOURS = (BLUE, ORANGE, GREEN, PINK, AMBER, SKY)
UNPATCHED_COLOUR: str = "#6b6f76"
LEFT_OUT_COLOUR: str = "#d9dce1"
INK: str = "#1b1f24"
RIGHT, FIFTH, WRONG = GREEN, AMBER, ORANGE
"""Frames of images: top-1 correct, top-5 correct, wrong."""

RC: Any = {
    "font.family": ["DejaVu Sans"], "font.size": 10, "axes.titlesize": 11, "text.color": INK, "axes.labelcolor": INK,
    "axes.edgecolor": INK, "xtick.color": INK, "ytick.color": INK,
    "svg.hashsalt": "toolkit", "svg.fonttype": "path",
}  # fmt: skip
"""Settings of matplotlib; the salt keeps the bytes of an SVG the same."""
CORRECT = "correct (%), higher is better"
NETWORKS = {
    "resnet18": "ResNet-18", "resnet50": "ResNet-50", "mobilenet_v2": "MobileNetV2",
    "mobilenet_v1_0.75_192": "MobileNetV1", "tf_efficientnet_lite0": "EfficientNet-Lite0",
    "tf_efficientnet_lite1": "EfficientNet-Lite1", "tf_efficientnet_lite2": "EfficientNet-Lite2",
    "efficientnet_lite3_280": "EfficientNet-Lite3", "mobilenet_v2_slim_224": "MobileNetV2 of TF-slim",
}  # fmt: skip
"""Display names of networks that results name often."""
VARIANTS = {
    "unpatched": "unmodified", "patched": "patch", "textured": "texture", "wrapped": "wrap",
    "wrong-patch": "another class's patch", "random-patch": "noise", "grey-patch": "grey paper",
    "patch-alone": "patch without the object",
}  # fmt: skip
"""Display names of what an object wears."""


def name_network(name: str) -> str:
    """Return a network's display name, `ResNet-18` for `resnet18`; your own networks keep their name."""
    return NETWORKS.get(name.removeprefix("timm-").removeprefix("timm:"), name)


def name_variant(variant: str) -> str:
    """Return a variant's display name, `unmodified` for `unpatched`; others keep their name."""
    return VARIANTS.get(variant, variant)


def colour_of(variants: Sequence[str], variant: str) -> str:
    """Return grey for `unpatched`, and a colour in turn for each other variant."""
    if variant == "unpatched":
        return UNPATCHED_COLOUR
    others = [name for name in dict.fromkeys(variants) if name != "unpatched"]
    return COLOURS[others.index(variant) % len(COLOURS)]


def style_panel(panel: "Axes", low: float = 0, high: float = 104) -> None:
    """Per cent upwards in steps of 20, with a faint grid and no frame above and on the right."""
    panel.set_ylim(low, high)
    panel.set_yticks(range(0, 101, 20))
    panel.grid(axis="y", alpha=0.3)
    panel.spines[["top", "right"]].set_visible(False)
