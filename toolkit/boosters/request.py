"""What `toolkit train-patch` is asked for, and the hash that says whether two requests are the same run."""

import json
import re
from dataclasses import asdict, dataclass, field
from typing import Any

from toolkit.boosters.affine import AffineRanges
from toolkit.boosters.appearance import Appearance
from toolkit.boosters.data import DataRequest
from toolkit.boosters.light import LightRanges
from toolkit.boosters.training import Descent, Target
from toolkit.errors import ToolkitError
from toolkit.files import sha256_bytes

SMALLEST_PX = 8
METHOD = "unadversarial patch, sign of the gradient"
METHOD_VERSION = 2
"""Raised when the same request gives other numbers: an older checkpoint is then another run's."""


@dataclass(frozen=True)
class PatchRequest:
    """One patch to train.

    Attributes:
        class_name: a label of the networks, an index, or a WordNet id.
        data: which images.
        size_px: n, side of the patch.
        descent: steps, batch, learning rate, seed.
        placement: where the patch lies in an image.
        light: how it is lit; None leaves its colours alone.
        name: of its files; by default from the label.
        mounted_share: of each batch, that shows the rig's object with the sheet mounted on it.
        mounted_views: how many such views are rendered, a fifth of them held out.
    """

    class_name: str
    data: DataRequest
    size_px: int = 100
    descent: Descent = field(default_factory=Descent)
    placement: AffineRanges = field(default_factory=AffineRanges)
    light: LightRanges | None = field(default_factory=LightRanges)
    name: str | None = None
    mounted_share: float = 0.0
    mounted_views: int = 144

    def __post_init__(self) -> None:
        if not 0 <= self.mounted_share <= 1:
            raise ToolkitError(f"--mounted-share {self.mounted_share:g}: expected 0 to 1")
        if self.mounted_views < 2:
            raise ToolkitError(f"--mounted-views {self.mounted_views}: expected at least 2")

    def appearance(self) -> Appearance:
        """The parts that act, in order."""
        return Appearance(self.placement, on_paper=() if self.light is None else (self.light,))

    def settings(self) -> dict[str, Any]:
        """Every hyper-parameter, as recorded beside the patch."""
        light = None if self.light is None else asdict(self.light)
        return {"method": METHOD, **asdict(self.descent), "affine": asdict(self.placement), "light": light} | (
            {"mounted_share": self.mounted_share, "mounted_views": self.mounted_views} if self.mounted_share else {}
        )


def name_files(request: PatchRequest, label: str, index: int) -> str:
    """The patch's file name without suffix.

    Raises:
        ToolkitError: the name that was asked for cannot be a file's everywhere.
    """
    if request.name is not None:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", request.name):
            raise ToolkitError(f"--name '{request.name}': expected letters, digits, '-' and '_', without a suffix")
        return request.name
    return re.sub(r"[^A-Za-z0-9]+", "_", label).strip("_") or f"class_{index}"


def check_size(size_px: int, image_px: int) -> None:
    """A patch must have some texels, and no more than the network's image has pixels."""
    if not SMALLEST_PX <= size_px <= image_px:
        raise ToolkitError(
            f"--size-px {size_px}: expected {SMALLEST_PX} to {image_px}, the side of the network's image in pixels"
        )


def hash_inputs(request: PatchRequest, name: str, targets: list[Target], data_sha256: str) -> str:
    """Hash of all that decides the patch's pixels, so that a checkpoint is never continued under other settings."""
    networks = [[t.classifier.arch, t.classifier.weights.sha256, t.class_index] for t in targets]
    inputs = [METHOD_VERSION, name, networks, data_sha256, request.size_px, request.settings()]
    return sha256_bytes(json.dumps(inputs, sort_keys=True).encode())
