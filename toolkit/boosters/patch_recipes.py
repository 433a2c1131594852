"""Recipes: all settings of a training run under one name, each of which a flag may change; and as a table."""

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from toolkit.boosters.data import DataRequest, is_rig_source
from toolkit.boosters.parts.affine import AffineRanges
from toolkit.boosters.parts.base import Range
from toolkit.boosters.parts.blur import CameraBlur
from toolkit.boosters.parts.corruption import Corrupted
from toolkit.boosters.parts.glare import TapeGlare
from toolkit.boosters.parts.jpeg import JpegFile
from toolkit.boosters.parts.light import LightRanges
from toolkit.boosters.parts.pose import PoseRanges
from toolkit.boosters.parts.print_process import PrintProcess, ProfiledPrint, use_profile
from toolkit.boosters.parts.sensor_noise import SensorNoise
from toolkit.boosters.patch_config import PatchRequest
from toolkit.boosters.patch_steps import Descent
from toolkit.core.errors import ToolkitError, one_of
from toolkit.corruptions.request import parse_corruptions
from toolkit.imaging.printer import read_print_profile
from toolkit.objects.records import printed_size_mm


@dataclass(frozen=True)
class Choices:
    """What a user may set; None leaves it to the recipe. The names are those of the flags of `toolkit train-patch`."""

    steps: int | None = None
    epochs: int | None = None
    batch: int | None = None
    lr: float | None = None
    schedule: str | None = None
    smoothing: float | None = None
    start_contrast: float | None = None
    rotation: Range | None = None
    share: Range | None = None
    foreshortening: Range | None = None
    pose: bool | None = None
    light: bool | None = None
    print_process: bool | None = None
    glare: bool | None = None
    camera: bool | None = None
    mounted_share: float | None = None
    mounted_views: int | None = None
    mounted_fill: Range | None = None
    tv_weight: float | None = None
    printability_weight: float | None = None
    length_mm: float | None = None
    print_profile: Path | None = None
    corrupt: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Recipe:
    """A preset.

    Attributes:
        about: in a few words.
        choices: a value for each that matters; what is None here is `Descent`'s or `AffineRanges`' own default.
        rig_share: mounted share where training images come from the rig.
        without_effect: see `PatchRequest`.
    """

    about: str
    choices: Choices
    rig_share: float
    without_effect: dict[str, float] = field(default_factory=dict)


PAPER = Recipe(
    about="Algorithm 1 as published: random affine alone (seed C.2)",
    choices=Choices(
        epochs=30, batch=512, lr=0.1, schedule="constant", smoothing=0.0, start_contrast=1.0,
        pose=False, light=False, print_process=False, glare=False, camera=False,
    ),
    rig_share=0.0,
    without_effect={"momentum": 0.9, "weight_decay": 1e-4},
)  # fmt: skip
"""Seed C.2 names momentum and weight decay. In the paper's release the optimiser that has them holds a dummy parameter,
while the patch itself moves by the plain sign of its gradient, as Algorithm 1 says: that is what acts here too."""

DEFAULT = Recipe(
    about="smoothed descent, and what the patch meets in the world",
    choices=Choices(
        steps=600, batch=16, lr=0.05, schedule="cosine", smoothing=2.0, start_contrast=0.2,
        pose=True, light=True, print_process=True, glare=True, camera=True,
    ),
    rig_share=0.875,
)  # fmt: skip

RECIPES = {"default": DEFAULT, "paper": PAPER}


def fill_choices(recipe: Recipe, choices: Choices) -> dict[str, Any]:
    """The user's choices, then the recipe's, by name.

    Raises:
        ToolkitError: both steps and epochs are asked for.
    """
    if choices.steps is not None and choices.epochs is not None:
        raise ToolkitError(f"--steps {choices.steps} --epochs {choices.epochs}: expected one of the two")
    preset = recipe.choices
    if choices.steps is not None or choices.epochs is not None:
        preset = replace(preset, steps=None, epochs=None)
    names = [one.name for one in fields(Choices)]
    given = {name: getattr(choices, name) for name in names}
    return {name: getattr(preset, name) if value is None else value for name, value in given.items()}


def make_request(
    recipe_name: str,
    choices: Choices,
    class_name: str,
    data: DataRequest,
    size_px: int = 100,
    seed: int = 0,
    name: str | None = None,
) -> PatchRequest:
    """The request that a recipe and a user's choices make together.

    Raises:
        ToolkitError: an unknown recipe, or a setting that is out of its range.
    """
    if recipe_name not in RECIPES:
        raise one_of("recipe", recipe_name, list(RECIPES))
    recipe = RECIPES[recipe_name]
    chosen = fill_choices(recipe, choices)
    has_rig = any(is_rig_source(source) for source in data.sources)
    names = ("tv_weight", "printability_weight", "mounted_views", "mounted_fill")
    given = {name: chosen[name] for name in names if chosen[name] is not None}
    return PatchRequest(
        class_name=class_name,
        data=data,
        size_px=size_px,
        descent=_make_descent(chosen, seed),
        placement=_make_affine(chosen),
        light=LightRanges() if chosen["light"] else None,
        name=name,
        mounted_share=_first(chosen["mounted_share"], recipe.rig_share if has_rig else 0.0),
        pose=_make_pose(chosen, size_px) if chosen["pose"] else None,
        print_process=_make_print(chosen, choices),
        glare=TapeGlare() if chosen["glare"] else None,
        camera=(CameraBlur(), SensorNoise(), JpegFile()) if chosen["camera"] else None,
        epochs=chosen["epochs"],
        recipe=recipe_name,
        without_effect=dict(recipe.without_effect),
        corrupted=Corrupted(parse_corruptions(chosen["corrupt"])) if chosen["corrupt"] else None,
        **given,
    )


def _first(value: Any, otherwise: Any) -> Any:
    return otherwise if value is None else value


def _make_descent(chosen: dict[str, Any], seed: int) -> Descent:
    steps = _first(chosen["steps"], 1)  # epochs make steps when the images have been counted
    return Descent(
        steps, chosen["batch"], chosen["lr"], chosen["schedule"], seed, chosen["smoothing"], chosen["start_contrast"]
    )


def _make_print(chosen: dict[str, Any], choices: Choices) -> PrintProcess | ProfiledPrint | None:
    file = chosen["print_profile"]
    if file is None:
        return PrintProcess() if chosen["print_process"] else None
    if choices.print_process is False:
        raise ToolkitError(f"--no-print-process --print-profile {file}: expected one of the two")
    return use_profile(read_print_profile(file))


def _make_affine(chosen: dict[str, Any]) -> AffineRanges:
    plain = AffineRanges()
    return AffineRanges(
        _first(chosen["rotation"], plain.rotation_deg),
        _first(chosen["share"], plain.share),
        _first(chosen["foreshortening"], plain.foreshortening),
    )


def _make_pose(chosen: dict[str, Any], size_px: int) -> PoseRanges:
    size_mm = printed_size_mm(size_px)
    return PoseRanges(size_mm, _first(chosen["length_mm"], max(PoseRanges().length_mm, size_mm)))


UNITS = {"deg": "°", "mm": " mm", "px": " px"}


def list_settings(request: PatchRequest, networks: list[str]) -> list[str]:
    """One line per setting or part that acts, `name  value`, and one for the parts that do not.

    Args:
        request: with its steps counted.
        networks: their names.
    """
    rows = [*_list_descent(request), ("networks", ", ".join(networks))]
    parts = {
        "affine": request.placement,
        "pose": request.pose,
        "light": request.light,
        "print": request.print_process,
        "glare": request.glare,
        **{f"camera: {type(part).__name__}": part for part in request.camera or ()},
        **({} if request.corrupted is None else {"corrupted": request.corrupted}),
    }
    rows += [(name, describe_part(part)) for name, part in parts.items() if part is not None]
    idle = [name for name, part in parts.items() if part is None]
    if request.camera is None:
        idle.append("camera")
    if request.mounted_share:
        share = f"{request.mounted_share:.0%} of each batch, {request.mounted_views} views, a fifth held out, "
        share += f"the object filling {request.mounted_fill[0]:g} to {request.mounted_fill[1]:g} of the frame"
        rows.append(("mounted", share))
    else:
        idle.append("mounted views")
    losses = [f"total variation × {request.tv_weight:g}"] if request.tv_weight else []
    losses += [f"non-printability × {request.printability_weight:g}"] if request.printability_weight else []
    rows.append(("losses", " + ".join(["cross-entropy", *losses])))
    if idle:
        rows.append(("off", ", ".join(idle)))
    if request.without_effect:
        named = ", ".join(f"{name.replace('_', ' ')} {value:g}" for name, value in request.without_effect.items())
        rows.append(("without effect", f"{named}: in the paper's release they move a dummy parameter, not the patch"))
    return align_rows(rows)


def align_rows(rows: list[tuple[str, str]]) -> list[str]:
    """`name  value` lines, the values below each other."""
    width = max(len(name) for name, _ in rows)
    return [f"  {name:<{width}}  {value}" for name, value in rows]


def describe_part(part: Any) -> str:
    """A part's fields with their ranges and units, its probabilities last."""
    if isinstance(part, ProfiledPrint | Corrupted):
        return part.describe()
    named = [(one.name, getattr(part, one.name)) for one in fields(part)]
    ranges = [_describe_field(name, value) for name, value in named if not name.endswith("probability")]
    odds = [f"{name.replace('_', ' ')} {value:g}" for name, value in named if name.endswith("probability")]
    return ", ".join(ranges + odds)


def _describe_field(name: str, value: Any) -> str:
    words, _, unit = name.rpartition("_")
    suffix = UNITS.get(unit, "")
    words = (words if suffix else name).replace("_", " ")
    if isinstance(value, tuple):
        return f"{words} {value[0]:g} to {value[1]:g}{suffix}"
    return f"{words} {value:.4g}{suffix}"


def _list_descent(request: PatchRequest) -> list[tuple[str, str]]:
    descent = request.descent
    about = f": {RECIPES[request.recipe].about}" if request.recipe in RECIPES else ""
    epochs = "" if request.epochs is None else f" ({request.epochs} epochs)"
    smoothing = f"Gaussian {descent.smoothing_px:g} px, falling to 0" if descent.smoothing_px else "none"
    return [
        ("recipe", request.recipe + about),
        ("patch", f"{request.size_px} × {request.size_px} px, start contrast {descent.start_contrast:g}"),
        ("steps", f"{descent.steps}{epochs} of {descent.batch} images, seed {descent.seed}"),
        ("step", f"sign of the gradient, lr {descent.lr:g} ({descent.schedule}), smoothing {smoothing}"),
    ]
