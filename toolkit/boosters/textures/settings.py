"""Which settings act in a run, as an aligned table for the console."""

from toolkit.boosters.settings_table import align_rows, describe_part
from toolkit.boosters.textures.recipes import RECIPES
from toolkit.boosters.textures.request import TextureRequest
from toolkit.boosters.textures.wearers import Wearers


def list_settings(request: TextureRequest, wearers: Wearers, label: str, networks: list[str]) -> list[str]:
    """One line per setting that acts, `name  value`, and one for what does not."""
    descent, views, ranges = request.descent, request.views, request.views.ranges
    about = f": {RECIPES[request.recipe].about}" if request.recipe in RECIPES else ""
    smoothing = f"Gaussian {descent.smoothing_px:g} px, falling to 0" if descent.smoothing_px else "none"
    evenly = ", evenly over the sphere" if ranges.evenly else ""
    place = f"elevation {ranges.elevation_deg[0]:g} to {ranges.elevation_deg[1]:g}°{evenly}"
    rendered = request.groups * views.studios * views.per_studio
    rows = [
        ("recipe", request.recipe + about),
        ("class", label),
        ("texture", f"{request.size_px} × {request.size_px} px, start contrast {descent.start_contrast:g}"),
        *(
            ("object", f"{item.name}, {_describe_atlas(atlas)}")
            for item, atlas in zip(wearers.items, wearers.atlases, strict=True)
        ),
        ("steps", f"{descent.steps} of {descent.batch} images, seed {descent.seed}"),
        ("step", f"{request.optimiser}, lr {descent.lr:g} ({descent.schedule}), smoothing {smoothing}"),
        ("gradient", request.gradient),
        (
            "views",
            f"{rendered}, each used {request.reuse} times, {request.held_out * views.per_studio} more held out; "
            f"{place}, roll {ranges.roll_deg[0]:g} to {ranges.roll_deg[1]:g}°, "
            f"filling {ranges.fill[0]:g} to {ranges.fill[1]:g} of the frame",
        ),
        ("networks", ", ".join(networks)),
    ]  # fmt: skip
    if request.background_share:
        rows.append(("backgrounds", f"photographs behind {request.background_share:.0%} of the views"))
    parts = {type(part).__name__: part for part in (request.exposure, *request.camera) if part is not None}
    rows += [(name, describe_part(part)) for name, part in parts.items()]
    return align_rows(rows)


def _describe_atlas(atlas) -> str:
    where = "new texture coordinates" if atlas.unwrapped else "its own texture coordinates"
    kept = 1 - atlas.trained.mean()
    paint = f", {kept:.0%} of its triangles keep their paint" if kept else ""
    return f"{len(atlas.mesh.faces)} triangles, {where}, {atlas.covered.mean():.0%} of the texture used{paint}"
