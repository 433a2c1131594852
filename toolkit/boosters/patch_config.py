"""The settings of a patch's training, its recipes, and how a config is made of them."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_serializer

from toolkit.boosters.pixel_config import (
    AUGMENTATION,
    CORRUPTED_HELP,
    HELD_OUT,
    STEPS,
    TRANSFER,
    WORLD_FILL,
    CameraParts,
    DataConfig,
    MeetsCorruptions,
    PixelConfig,
    find_recipe,
    make_camera,
    record_transforms,
)
from toolkit.boosters.transforms import OF_NETWORKS, Placer
from toolkit.boosters.transforms.placement import WHERE, AffineRanges, MixedPlacement, PoseRanges
from toolkit.boosters.transforms.printing import LightRanges, PrintProcess, ProfiledPrint, TapeGlare, use_profile
from toolkit.boosters.transforms.show import Appearance
from toolkit.boosters.transforms.transfer import Cutout
from toolkit.core.config import Flag, Later, Range, Rising
from toolkit.core.errors import FieldError
from toolkit.core.lazy import torch
from toolkit.core.work import Work
from toolkit.objects.spec import Margin, ObjectSpec, printed_size_mm

METHOD = "unadversarial patch, sign of the gradient"
PATCHES = Work("patch", 9, old_at=0)
LOSSES, RIG = "Losses", "Mounted on the rig's object"
SMALLEST_PX = 8


class PatchConfig(PixelConfig):
    """Every setting of a patch's training. Transforms that are None do not act."""

    stages = ("print", "paper", "photo", *OF_NETWORKS)
    size_px: Annotated[int, Field(ge=SMALLEST_PX), Flag()] = Field(
        100, exclude=True, description="Side of the patch, pixels."
    )
    size_mm: Annotated[float | None, Later, Field(ge=1, le=10_000), Flag(metavar="MM")] = Field(
        None,
        description="Side of the printed patch, mm, to train for. Default: the object's spec, else 0.88 mm a pixel.",
    )
    margin: Annotated[Margin, Later, Flag(metavar="white|bleed")] = Field(
        "white",
        description="Train for this paper around the patch, 5 mm wide: white, or bleed, which continues the print. Use "
        "clear tape with bleed.",
    )
    epochs: Annotated[int | None, Field(ge=1), Flag(group=STEPS)] = Field(
        None, description="In place of {steps}: how often each image is seen."
    )
    affine: AffineRanges | Placer = AffineRanges()
    pose: Annotated[PoseRanges | None, Flag("--vary-pose/--no-vary-pose", group=WHERE)] = Field(
        None, description="Place half of the patches as a camera sees them on an object."
    )
    light: Annotated[LightRanges | None, Flag("--vary-light/--no-vary-light", group=AUGMENTATION)] = Field(
        LightRanges(), description="Vary exposure, contrast and tint of the patch."
    )
    print_process: Annotated[PrintProcess | ProfiledPrint | None, Flag(group=AUGMENTATION)] = Field(
        None, description="Show the patch in the inks of a desktop printer."
    )
    cutout: Annotated[Cutout | None, Later, Flag("--cutout", group=TRANSFER)] = Field(
        None, description="Hide a square of the patch, a sixth of it, in nine of ten steps."
    )
    glare: Annotated[TapeGlare | None, Flag(group=AUGMENTATION)] = Field(
        None, description="Show shine, and strips of tape over the patch."
    )
    camera: Annotated[CameraParts | None, Flag(group=AUGMENTATION, make=make_camera)] = Field(
        None, description="Add a camera's blur, sensor noise and JPEG."
    )
    tv_weight: Annotated[float, Field(ge=0), Flag(group=LOSSES)] = Field(
        0.0, description="Weight of the patch's total variation."
    )
    printability_weight: Annotated[float, Field(ge=0), Flag(group=LOSSES)] = Field(
        0.0, description="Weight of the distance between its colours and what inks can print."
    )
    mounted_share: Annotated[float, Field(ge=0, le=1), Flag(group=RIG)] = Field(
        0.0, description="Share of each batch that shows the sheet on the object; 0 without --data rig."
    )
    mounted_views: Annotated[int, Field(ge=2), Flag(group=RIG)] = Field(
        480, description="Views with the sheet on the object, a fifth of them held out."
    )
    mounted_fill: Annotated[Range, Rising(0.05, 1), Flag(group=RIG)] = Field(
        (0.2, 0.95), description="Share of the frame that the object fills in these views."
    )
    without_effect: dict[str, float] = Field({}, description="Named by the recipe's source; it has no effect.")
    corrupted: MeetsCorruptions = Field(None, description=CORRUPTED_HELP)

    @field_serializer("camera")
    def _name_transforms(self, camera: CameraParts | None) -> dict[str, Any] | None:
        return record_transforms(camera or ())

    @field_serializer("mounted_views", "mounted_fill")
    def _only_mounted(self, value: object) -> object:
        return value if self.mounted_share else None

    def record(self) -> dict[str, Any]:
        """Every hyper-parameter, as recorded beside the patch."""
        return {"method": METHOD, "recipe": self.recipe, "epochs": self.epochs, **super().record()}

    def count_steps(self, images: int) -> "PatchConfig":
        """The same with the steps that its epochs make of so many training images."""
        if self.epochs is None:
            return self
        return self.with_overrides(steps=self.epochs * math.ceil(images / self.batch))

    def appearance(self) -> Appearance:
        """The transforms that act, in order."""
        return Appearance(
            self.affine if self.pose is None else MixedPlacement(self.pose, self.affine),
            on_print=self.transforms("print"), on_paper=self.transforms("paper"), on_photo=self.transforms("photo"),
        )  # fmt: skip

    def penalty(self) -> "Callable[[torch.Tensor], torch.Tensor] | None":
        """Θ -> the weighted losses of the patch itself, a scalar; None where both weigh nothing."""
        # a weight of 0 leaves its loss out, which costs time
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


RECIPES: dict[str, PatchConfig] = {
    "default": PatchConfig(
        recipe="default", about="smoothed descent, with print, tape, light and camera simulated",
        steps=600, batch=16, lr=0.05, schedule="cosine", smoothing_px=2.0, start_contrast=0.2,
        pose=PoseRanges(), light=LightRanges(), print_process=PrintProcess(), glare=TapeGlare(), camera=make_camera(),
        mounted_share=0.875,
    ),
    "paper": PatchConfig(
        recipe="paper", about="Algorithm 1 as published: random affine alone (paper C.2)",
        steps=None, epochs=30, batch=512, lr=0.1, schedule="constant", smoothing_px=0.0, start_contrast=1.0, light=None,
        without_effect={"momentum": 0.9, "weight_decay": 1e-4},
    ),
}  # fmt: skip
"""Appendix C.2 names momentum and weight decay. In the paper's release they act on a dummy parameter. The patch itself
moves by the sign of its gradient, as in Algorithm 1, and it does so here."""


def make_config(recipe: str, overrides: Mapping[str, Any], data: DataConfig) -> PatchConfig:
    """A recipe with overrides, fitted to its data: without the rig nothing is mounted unless it is asked for.

    Raises:
        ToolkitError: an unknown recipe, or a setting that is out of its range.
    """
    base, fitted = find_recipe(RECIPES, recipe, overrides), dict(overrides)
    lengths = {name: fitted[name] for name in ("steps", "epochs") if fitted.get(name) is not None}
    if len(lengths) == 2:
        raise FieldError("expected one of the two", lengths)
    # the request replaces the recipe's own setting
    if lengths:
        base = base.model_copy(update={"steps": None, "epochs": None})
    if fitted.get("world") is not None:
        base = base.model_copy(update={"mounted_fill": WORLD_FILL})
    if fitted.get("mounted_share") is None and data.rig_source is None:
        fitted["mounted_share"] = 0.0
    # poses draw a sheet of millimetres, so they must know its printed size
    pose_acts = fitted.get("pose", base.pose) not in (None, False)
    # the spec's sizes are hints, not settings: what was asked for goes before them
    spec_mm, spec_length_mm = fitted.pop("spec.size_mm", None), fitted.pop("spec.length_mm", None)
    stated_mm = fitted.get("size_mm") or spec_mm
    size_mm = stated_mm or printed_size_mm(fitted.get("size_px", base.size_px))
    if pose_acts:  # its sheet is as large as the patch is printed, and a large patch lies on a large object
        length_mm = fitted.pop("pose.length_mm", None) or (spec_length_mm and max(spec_length_mm, size_mm))
        length_mm = length_mm or max((base.pose or PoseRanges()).length_mm, size_mm)
        fitted |= {"pose.size_mm": size_mm, "pose.length_mm": length_mm}
    made = base.with_overrides(fitted)
    if stated_mm is None or made.print_process is None:
        return made
    return made.with_overrides({"print_process.texel_mm": stated_mm / made.size_px})  # ink bleeds by millimetres


LEAST_RENDERS = 32
# a fifth of the renders is held out, and the rest has to serve all steps
SPARE = 1 / (1 - HELD_OUT)


def limit_renders(config: PatchConfig, data: DataConfig) -> tuple[PatchConfig, DataConfig]:
    """No more images and views of the object than the steps can use, and a fifth to hold out.

    Runs that are counted in epochs use every image, and stay as they are.
    """
    if config.steps is None:
        return config, data
    # what the steps can show, and a fifth more to hold out
    shown = config.steps * config.batch
    views = max(LEAST_RENDERS, math.ceil(SPARE * shown * config.mounted_share))
    images = max(LEAST_RENDERS, math.ceil(SPARE * shown * (1 - config.mounted_share)))
    return (
        config.with_overrides(mounted_views=min(config.mounted_views, views)),
        data.with_overrides(images=min(data.images, max(images, 2 * len(data.sources)))),
    )


def size_by_spec(overrides: Mapping[str, Any], spec: ObjectSpec) -> dict[str, Any]:
    """The overrides with the sizes of the object that the patch is for, where they or its spec state the patch's.

    If there are several sheets, the first sheet's width counts: inks bleed by its millimetres on a texel.
    """
    # the size that was asked for, else that of the object's spec
    size_mm = overrides.get("size_mm") or spec.mounts[0].size_mm
    if size_mm is None:
        return dict(overrides)
    return {**overrides, "spec.size_mm": size_mm, "spec.length_mm": max(spec.length_mm, size_mm)}


def use_printer(overrides: Mapping[str, Any], file: Path, sheen: float = 0.0) -> dict[str, Any]:
    """The overrides with the printer that a profile's file describes; `sheen` as `ProfiledPrint` has it.

    Raises:
        FieldError: printing is switched off as well.
    """
    from toolkit.imaging.printer import read_print_profile

    if overrides.get("print_process") is False:
        raise FieldError("expected one of the two", {"print_process": False, "print_profile": file})
    return {**overrides, "print_process": use_profile(read_print_profile(file), sheen)}


def list_patch_inputs(config: PatchConfig, name: str, networks: list[list[object]], data_sha256: str) -> list[object]:
    """All that decides a patch's pixels: `config` with its steps counted, the files' name, `list_networks`, images."""
    return [name, networks, data_sha256, config.size_px, config.record()]


def check_size(size_px: int, image_px: int, field: str = "size_px") -> None:
    """A patch has no more texels a side than the network's image has pixels; `field` is named where it has."""
    if not SMALLEST_PX <= size_px <= image_px:
        expected = f"expected {SMALLEST_PX} to {image_px}, the side of the network's image in pixels"
        raise FieldError(expected, {field: size_px})


def total_variation(patch: "torch.Tensor") -> "torch.Tensor":
    """Mean absolute difference of neighbouring texels of (3, n, n), right and below; a scalar, differentiable."""
    # the anisotropic kind: differences right and below are added, not joined by a root
    down, right = patch.diff(dim=1).abs(), patch.diff(dim=2).abs()
    return (down.sum() + right.sum()) / (down.numel() + right.numel())


def non_printability(patch: "torch.Tensor") -> "torch.Tensor":
    """Mean distance of the texels of (3, n, n) in [0, 1] to the nearest printable colour; a scalar, differentiable.

    The gradient of the distance to a convex set points away from the nearest place in it, so that this place may be
    found apart from autograd.
    """
    from toolkit.imaging.printer import nearest_printable

    # a row for each texel
    colours = patch.flatten(1).T
    nearest = nearest_printable(colours.detach().double().cpu().numpy())
    apart = colours - torch.as_tensor(nearest, dtype=patch.dtype, device=patch.device)
    squared = apart.square().mean(dim=1)
    # inside, the root's infinite slope at 0 must not meet the gradient
    return torch.where(squared > 1e-12, squared.clamp_min(1e-12).sqrt(), torch.zeros_like(squared)).mean()
