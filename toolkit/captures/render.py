"""Render an object in memory, and draw previews of a plan and of a new object."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from toolkit.captures.shoot import ShootSettings, print_booster, studio_for
from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.files import write_bytes, write_text
from toolkit.core.workspace import Workspace
from toolkit.objects.add import DEFAULT_PATCH_MM
from toolkit.objects.export_mesh import make_turntable
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.records import Patch, Texture
from toolkit.rig import Pattern
from toolkit.rig.applied.base import AppliedBooster
from toolkit.rig.applied.patch import PatchBooster
from toolkit.rig.applied.texture import TextureBooster
from toolkit.rig.camera import Camera
from toolkit.rig.fit import describe_misfits
from toolkit.rig.mount import attach, mount_sheets
from toolkit.rig.plan import CapturePlan, Pose, plan_poses
from toolkit.rig.plan_pictures import draw_contact_sheet, draw_positions
from toolkit.rig.renderers import make_renderer
from toolkit.rig.shading import tone_map
from toolkit.rig.variants import apply_booster


def render(
    item: TableObject, poses: Sequence[Pose], camera: Camera | None = None, booster: Patch | Texture | None = None,
    settings: ShootSettings | None = None,
) -> np.ndarray:  # fmt: skip
    """Render an object in the virtual studio, with or without a patch or texture.

    The light is baked once for all poses. The pixels are those of `shoot_plan` with the same settings as PNG.

    Args:
        item: object from `load_object`.
        poses: camera poses, such as `plan.objects["racer"]`; degrees and millimetres.
        camera: pixels and field of view; 640 × 480 px and 40 degrees by default.
        booster: patch or texture; place and size of a patch are those of the object's spec, else the patch's record.
        settings: seed, backdrop, light and renderer.

    Returns:
        (n, h, w, 3) uint8 sRGB, an image for each pose.

    Raises:
        ToolkitError: a backdrop, light or renderer is unknown, a patch is too large for the object, or a texture was
            trained on another object.

    Example:
        >>> _ = trimesh.creation.box((0.1, 0.1, 0.1)).export("crate.glb")
        >>> space, camera = tk.make_workspace(Path("space")), tk.Camera.from_fov(64, 48)
        >>> crate = tk.add_object(space, Path("crate.glb"), tk.ObjectRequest(class_name="crate")).item
        >>> tk.render(crate, tk.plan_poses(crate, camera, tk.Pattern(count=2)), camera).shape
        (2, 48, 64, 3)
    """
    settings, camera = settings or ShootSettings(), camera or Camera.from_fov()
    if settings.rehearsal is not None:
        raise ToolkitError("a rehearsal is of photographs in files: shoot them with shoot_plan")
    applied: AppliedBooster | None = None
    if booster is not None:
        named = booster.pixels, booster.record.png_sha256, booster.record.name
        if isinstance(booster, Texture):
            applied = TextureBooster(*named, texture=booster)
        else:
            applied = PatchBooster(*named, item.spec.sizes_mm(booster.size_mm), margin=booster.record.margin)
    # printed if the settings say so, by the same draws as in files
    mesh = apply_booster(item, print_booster(applied, settings.printer, settings.seed, item.name))
    renderer = make_renderer(settings.renderer, mesh, studio_for(item, settings))
    lights = renderer.render_many((camera, pose.matrix()) for pose in poses)
    # each pose has its own noise, the same as in `shoot_plan`
    pictures = [tone_map(light, (settings.seed, pose.id)) for light, pose in zip(lights, poses, strict=True)]
    return np.stack(pictures) if pictures else np.zeros((0, camera.height, camera.width, 3), np.uint8)


CHEQUERED = np.where(np.indices((8, 8)).sum(0)[..., None] % 2, [40, 90, 200], [250, 250, 250]).astype(np.uint8)
"""Placeholder of a patch that is not trained yet."""


def preview_plan(workspace: Workspace, plan: CapturePlan, seed: int = 0) -> Path:
    """Draw the camera positions and views of every object of a plan; return the folder of the pictures."""
    folder = workspace.root / "rig" / "preview"
    with progress("drawing previews", len(plan.objects)) as bar:
        for name, poses in plan.objects.items():
            item = load_object(workspace.object_spec(name))
            write_bytes(folder / f"{name}-positions.png", draw_positions(item, poses))
            studio = studio_for(item, ShootSettings(seed=seed))
            write_bytes(folder / f"{name}-sheet.png", draw_contact_sheet(item, plan.camera, poses, studio))
            bar.advance(note=name)
    return folder


@dataclass(frozen=True)
class ObjectPreview:
    """Preview of an object.

    Attributes:
        picture: PNG with views from eight sides.
        page: HTML page to turn the object in a browser; None for a very large mesh.
        trouble: fault of the sheet's place, if there is any.
    """

    picture: Path
    page: Path | None
    trouble: str

    def lines(self) -> Iterator[str]:
        """Yield sentences on the files of the preview."""
        yield (
            f"drew {self.picture}: azimuth 0° must show its front, upright (if not, add it again with --up, --front, "
            "--replace); the patch goes where the checks are"
        )
        if self.page is not None:
            yield f"{self.page}: open it in a browser to turn the object with its patch"


def preview_object(workspace: Workspace, item: TableObject) -> ObjectPreview:
    """Draw an object with a chequered sheet for its patch."""
    shown, trouble = item, ""  # shown without a sheet if there is no place for it
    try:
        # the printed size that a patch will have by default
        sizes_mm = item.spec.sizes_mm(DEFAULT_PATCH_MM)
        trouble = "; ".join(describe_misfits(item, sizes_mm))
        sheets = mount_sheets(item.mesh, CHEQUERED, item.spec.mounts, sizes_mm, item.name)
        shown = replace(item, mesh=attach(item.mesh, *sheets))
    except ToolkitError as error:
        trouble = f"no place for the patch yet: {error}"
    # pictures and page
    camera = Camera.from_fov()
    # eight views round the object, low and high
    poses = plan_poses(item, camera, Pattern(name="grid", count=8, elevation_deg=(20.0, 60.0)))
    picture = workspace.root / "rig" / "preview" / f"{item.name}-object.png"
    with progress("drawing the preview", 1) as bar:
        write_bytes(picture, draw_contact_sheet(shown, camera, poses, studio_for(item, ShootSettings()), columns=4))
        bar.advance()
    long_mm = float(item.mesh.size_mm.max())
    words = f"{item.name}, {item.spec.class_name}: {long_mm:.0f} mm long; the patch goes where the checks are. Drag it."
    html = make_turntable(shown.mesh, item.name, words)
    page = None if html is None else write_text(picture.with_name(f"{item.name}.html"), html)
    return ObjectPreview(picture, page, trouble)
