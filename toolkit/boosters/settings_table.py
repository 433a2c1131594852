"""Which settings act in a run, as an aligned table for the console."""

from dataclasses import fields
from typing import Any

from toolkit.boosters.corrupted import Corrupted
from toolkit.boosters.print_profile import ProfiledPrint
from toolkit.boosters.recipes import RECIPES
from toolkit.boosters.request import PatchRequest

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
