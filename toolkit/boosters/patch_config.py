"""What `toolkit train-patch` is asked for, and the hash that says whether two requests are the same run."""

import json
import math
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

from toolkit.boosters.data import DataRequest
from toolkit.boosters.parts.affine import AffineRanges
from toolkit.boosters.parts.base import Appearance, Placement, Range
from toolkit.boosters.parts.blur import CameraBlur
from toolkit.boosters.parts.corruption import Corrupted
from toolkit.boosters.parts.glare import TapeGlare
from toolkit.boosters.parts.jpeg import JpegFile
from toolkit.boosters.parts.light import LightRanges
from toolkit.boosters.parts.pose import MixedPlacement, PoseRanges
from toolkit.boosters.parts.print_process import PrintProcess, ProfiledPrint
from toolkit.boosters.parts.sensor_noise import SensorNoise
from toolkit.boosters.patch_steps import Descent, Target
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.imaging.printer import nearest_printable
from toolkit.rig.views import NEAR_VIEWS

if TYPE_CHECKING:
    import torch


def total_variation(patch: "torch.Tensor") -> "torch.Tensor":
    """Mean absolute difference of neighbouring texels of (3, n, n), right and below; a scalar, differentiable."""
    down, right = patch.diff(dim=1).abs(), patch.diff(dim=2).abs()
    return (down.sum() + right.sum()) / (down.numel() + right.numel())


def non_printability(patch: "torch.Tensor") -> "torch.Tensor":
    """Mean distance of the texels of (3, n, n) in [0, 1] to the nearest printable colour; a scalar, differentiable.

    The gradient of the distance to a convex set points away from the nearest place in it, so that this place may be
    found apart from autograd.
    """
    import torch

    colours = patch.flatten(1).T
    nearest = nearest_printable(colours.detach().double().cpu().numpy())
    apart = colours - torch.as_tensor(nearest, dtype=patch.dtype, device=patch.device)
    squared = apart.square().mean(dim=1)
    # inside, the root's infinite slope at 0 must not meet the gradient
    return torch.where(squared > 1e-12, squared.clamp_min(1e-12).sqrt(), torch.zeros_like(squared)).mean()


CameraParts = tuple[CameraBlur, SensorNoise, JpegFile]
SMALLEST_PX = 8
METHOD = "unadversarial patch, sign of the gradient"
METHOD_VERSION = 4
"""Raised when the same request gives other numbers: an older checkpoint is then another run's."""


@dataclass(frozen=True)
class PatchRequest:
    """One patch to train. Parts that are None do not act.

    Attributes:
        class_name: a label of the networks, an index, or a WordNet id.
        data: which images.
        size_px: n, side of the patch.
        descent: steps, batch, learning rate, seed.
        placement: where the patch lies in an image.
        light: how it is lit.
        name: of its files; by default from the label.
        mounted_share: of each batch, that shows the rig's object with the sheet mounted on it.
        mounted_views: how many such views are rendered, a fifth of them held out.
        mounted_fill: share of the frame that the object reaches in them, lowest and highest.
        pose: how a camera sees it on an object, for a share of the images.
        print_process: what the printer makes of it: a range of printers, or one that was measured.
        glare: what its tape does.
        camera: what is done to the photograph, in this order.
        corrupted: what spoils some photographs after the camera.
        tv_weight, printability_weight: of the patch's own losses, see `toolkit.boosters.patch_config`.
        epochs: how often each training image is seen; decides the steps once the images are known.
        recipe: whose settings these are, flags apart.
        without_effect: settings that the recipe's source names and that move nothing; recorded and said.
    """

    class_name: str
    data: DataRequest
    size_px: int = 100
    descent: Descent = field(default_factory=Descent)
    placement: Placement = field(default_factory=AffineRanges)
    light: LightRanges | None = field(default_factory=LightRanges)
    name: str | None = None
    mounted_share: float = 0.0
    mounted_views: int = 240
    mounted_fill: Range = NEAR_VIEWS.fill
    pose: PoseRanges | None = None
    print_process: PrintProcess | ProfiledPrint | None = None
    glare: TapeGlare | None = None
    camera: CameraParts | None = None
    tv_weight: float = 0.0
    printability_weight: float = 0.0
    epochs: int | None = None
    recipe: str = "custom"
    without_effect: dict[str, float] = field(default_factory=dict)
    corrupted: Corrupted | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.mounted_share <= 1:
            raise ToolkitError(f"--mounted-share {self.mounted_share:g}: expected 0 to 1")
        if self.mounted_views < 2:
            raise ToolkitError(f"--mounted-views {self.mounted_views}: expected at least 2")
        low, high = self.mounted_fill
        if not 0.05 <= low <= high <= 1:
            raise ToolkitError(
                f"--mounted-fill {low:g} {high:g}: expected two shares of the frame, 0.05 to 1, lowest first"
            )
        if self.epochs is not None and self.epochs < 1:
            raise ToolkitError(f"--epochs {self.epochs}: expected at least 1")
        for flag, weight in (("--tv-weight", self.tv_weight), ("--printability-weight", self.printability_weight)):
            if not 0 <= weight < math.inf:
                raise ToolkitError(f"{flag} {weight:g}: expected 0 or more")

    def count_steps(self, images: int) -> "PatchRequest":
        """The same request with the steps that its epochs make of so many training images."""
        if self.epochs is None:
            return self
        steps = self.epochs * math.ceil(images / self.descent.batch)
        return replace(self, descent=replace(self.descent, steps=steps))

    def appearance(self) -> Appearance:
        """The parts that act, in order."""
        return Appearance(
            self.placement if self.pose is None else MixedPlacement(self.pose, self.placement),
            on_print=() if self.print_process is None else (self.print_process,),
            on_paper=tuple(part for part in (self.light, self.glare) if part is not None),
            on_photo=(*(self.camera or ()), *(() if self.corrupted is None else (self.corrupted,))),
        )

    def penalty(self) -> "Callable[[torch.Tensor], torch.Tensor] | None":
        """Θ -> the weighted losses of the patch itself, a scalar; None where both weigh nothing."""
        if not (self.tv_weight or self.printability_weight):
            return None

        def weigh(patch: "torch.Tensor") -> "torch.Tensor":
            loss = patch.new_zeros(())
            if self.tv_weight:
                loss = loss + self.tv_weight * total_variation(patch)
            if self.printability_weight:
                loss = loss + self.printability_weight * non_printability(patch)
            return loss

        return weigh

    def settings(self) -> dict[str, Any]:
        """Every hyper-parameter, as recorded beside the patch."""
        parts = {
            "affine": self.placement,
            "pose": self.pose,
            "light": self.light,
            "print_process": self.print_process,
            "glare": self.glare,
        }
        camera = {type(part).__name__: asdict(part) for part in self.camera or ()}
        return {
            "method": METHOD,
            "recipe": self.recipe,
            "epochs": self.epochs,
            **asdict(self.descent),
            **{name: None if part is None else asdict(part) for name, part in parts.items()},  # type: ignore[arg-type]
            "camera": camera or None,
            "tv_weight": self.tv_weight,
            "printability_weight": self.printability_weight,
            "mounted_share": self.mounted_share,
            "mounted_views": self.mounted_views if self.mounted_share else None,
            "mounted_fill": self.mounted_fill if self.mounted_share else None,
            "without_effect": self.without_effect,
            # a request from before there was this part keeps its hash
            **({} if self.corrupted is None else {"corrupted": asdict(self.corrupted)}),
        }


def name_files(name: str | None, label: str, index: int) -> str:
    """A booster's file name without suffix: the one that was asked for, else from its class.

    Raises:
        ToolkitError: the name that was asked for cannot be a file's everywhere.
    """
    if name is not None:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
            raise ToolkitError(f"--name '{name}': expected letters, digits, '-' and '_', without a suffix")
        return name
    return re.sub(r"[^A-Za-z0-9]+", "_", label).strip("_") or f"class_{index}"


def check_size(size_px: int, image_px: int, flag: str = "--size-px") -> None:
    """A patch must have some texels, and no more than the network's image has pixels."""
    if not SMALLEST_PX <= size_px <= image_px:
        raise ToolkitError(
            f"{flag} {size_px}: expected {SMALLEST_PX} to {image_px}, the side of the network's image in pixels"
        )


def hash_inputs(request: PatchRequest, name: str, targets: list[Target], data_sha256: str) -> str:
    """Hash of all that decides the patch's pixels, so that a checkpoint is never continued under other settings."""
    networks = [[t.classifier.arch, t.classifier.weights.sha256, t.class_index] for t in targets]
    inputs = [METHOD_VERSION, name, networks, data_sha256, request.size_px, request.settings()]
    return sha256_bytes(json.dumps(inputs, sort_keys=True).encode())
