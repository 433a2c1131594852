"""Rules of the challenge, a benchmark of boosters that others can enter: objects, judges, sizes, and options."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from toolkit.core.config import Config, Flag
from toolkit.core.text import FileName

VERSION = 1
"""Version of the rules, poses and judges; scores of different versions are never compared."""
Division = Literal["closed", "open"]
Budget = Literal["patch", "wrap", "texture"]
VARIANT: Mapping[Budget, str] = {"patch": "patched", "wrap": "wrapped", "texture": "textured"}
CLOSED_OBJECTS = ("coffeepot", "eggnog", "racer", "warplane")
JUDGES: Mapping[str, str] = {
    "resnet50": "0676ba61", "mobilenet_v2": "b0353104", "efficientnet_b0": "7f5810bc", "convnext_tiny": "983f1562",
    "regnet_y_800mf": "1b27b58c", "swin_t": "704ceda3",
}  # fmt: skip
"""Judges of the closed division, with the first digits of their hash: torchvision's first ImageNet weights."""
LARGEST_PATCH = 1 / 3
"""Side of a patch as a share of the object's longest side."""
POSES = 18
"""Poses of the plan; as many more are drawn for each version, so that nobody trains on the judged poses."""
DRAWN_SEED = 20_260_000 + VERSION
NO_CONTROLS = ("camouflage",)
"""Controls of the kit that are newer than these rules."""


class EntryConfig(Config):
    """Division and budget of an entry."""

    budget: Annotated[Budget, Flag()] = Field("patch", description="Kind of booster.")
    division: Annotated[Division, Flag()] = Field("closed", description="Four built-in objects, or your own objects.")
    objects: Annotated[tuple[FileName, ...], Flag("--object", metavar="NAME", typed=tuple[str, ...])] = Field(
        (), description="Object of the open division; repeat for more."
    )
