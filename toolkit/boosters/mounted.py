"""Training on the mounted sheets: the patch as the rig shows it on its object, bent, lit and partly hidden.

Its paper is a material of the scene (`toolkit.boosters.linear_view`), whose texture is the patch with its margin.
"""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch.nn.functional import interpolate

from toolkit.boosters.detectors import box_of_coverage
from toolkit.boosters.linear_view import ViewBatch, batch_pictures, batch_views, show_linear, srgb_to_linear
from toolkit.boosters.pixel_config import count_held_out
from toolkit.boosters.pixels import Target
from toolkit.boosters.transforms.weather import ViewWeather, find_depths
from toolkit.boosters.validation import Share, Validation
from toolkit.core.console import progress
from toolkit.core.draws import Draws
from toolkit.core.files import sha256_bytes
from toolkit.objects.load import TableObject, scale_to_world
from toolkit.objects.records import mirror
from toolkit.objects.spec import Margin
from toolkit.rig.mount import PAPER, mount_sheets, size_on_paper, wear_sheets
from toolkit.rig.shading import DepthBuffer, LinearView
from toolkit.rig.views import (
    IN_STUDIO,
    NEAR_VIEWS,
    PER_STUDIO,
    TRAIN,
    PaintableObject,
    Setting,
    ViewRanges,
    ViewSettings,
    render_block,
)

EXPOSURE, TINT, NOISE = (0.75, 1.3), 0.05, 0.012
"""Drawn for each training image: factor on the light, each channel's deviation from it, sensor noise (sRGB)."""
# middle of the range: as large as a patch, and shows nothing
PAPER_GREY = 0.5
BATCH = 24
Through = tuple["torch.Tensor", "torch.Tensor"]
"""Factor and offset of linear light, see `ViewBatch.through`."""


@dataclass(frozen=True)
class MountedViews:
    """Views of an object with its sheets on it.

    Attributes:
        batch: all of them, in half precision.
        sizes_mm: side of the patch on each sheet; all share the paper of the smallest.
        sha256: of the views.
        depths: how far away everything in them is at real size; none where there is no weather.
        boxes: (n, 4) x1, y1, x2, y2 round the object with its sheet, in pixels of a view.
        bare: the same views of the unmodified object; None if they were not rendered.
        held_out: how many of the last views are never trained on; None: a fifth.
        margin: what is on the paper around the patch.
    """

    batch: ViewBatch
    sizes_mm: tuple[float, ...]
    sha256: str
    depths: tuple[DepthBuffer, ...] = ()
    boxes: np.ndarray | None = None
    bare: ViewBatch | None = None
    held_out: int | None = None
    margin: Margin = "white"

    def __len__(self) -> int:
        return len(self.batch)

    def divide(self) -> tuple["MountedViews", "MountedViews"]:
        """Return the views to train on, and the last views, which are held out."""
        # the last views are held out, a stated number or a fifth
        kept = len(self) - (count_held_out(len(self)) if self.held_out is None else self.held_out)
        train, held_out = (
            replace(
                self,
                batch=self.batch.part(start, stop),
                depths=self.depths[start:stop],
                boxes=None if self.boxes is None else self.boxes[start:stop],
                bare=None if self.bare is None else self.bare.part(start, stop),
            )
            for start, stop in ((0, kept), (kept, len(self)))
        )
        return train, held_out

    def draw_weather(
        self, weather: ViewWeather, which: np.ndarray, corners: np.ndarray, side: int, rng: np.random.Generator
    ) -> "Through":
        """Weather over squares of some views, see `ViewBatch.cut` and `ViewWeather.draw`."""
        # cut as the pictures are, so that weather lies over the same pixels
        cuts = [
            self.depths[k].cropped(int(left), int(top), side) for k, (top, left) in zip(which, corners, strict=True)
        ]
        return weather.draw(cuts, rng)


def render_mounted_views(
    item: TableObject, sizes_mm: Sequence[float], patch_px: int, count: int, *, seed: int, image_px: int,
    ranges: ViewRanges = NEAR_VIEWS, with_depth: bool = False, with_bare: bool = False,
    setting: Setting | None = None, margin: Margin = "white",
) -> list[LinearView]:  # fmt: skip
    """Views of an object with its printed sheets on it, linear in the colours of their paper.

    Light bounces off the table as from a grey patch. View i depends on (seed, i) alone, and none is a pose of a plan.

    Args:
        item: the object.
        sizes_mm: side of the printed patch on each sheet.
        patch_px: texels of its side, of which `lod` counts those that `toolkit.rig.mount.print_on_paper` makes.
        count: how many.
        seed: of all draws.
        image_px: side of the square pictures.
        ranges: where the camera may stand.
        with_depth: whether views shall have their depth, for weather.
        with_bare: whether views shall have the light of the object without its sheets; twice the work.
        setting: the world that they are taken in, where the object has its real size; None: studios.
        margin: what is on the paper around the patch.

    Raises:
        ToolkitError: a sheet that cannot be mounted, or no real size where it is needed.
    """
    subject = make_sheet_subject(item, sizes_mm, patch_px, at_real_size=setting is not None, margin=margin)
    views: list[LinearView] = []
    with progress(f"rendering {item.name} with its sheet", count) as bar:
        # a studio for each block: its light is baked once for all views in it
        for block, start in enumerate(range(0, count, PER_STUDIO)):
            settings = ViewSettings(ranges, image_px, per_studio=min(PER_STUDIO, count - start))
            taken = render_block(
                (subject,), settings, seed, TRAIN, block,
                setting=setting or IN_STUDIO, with_depth=with_depth, with_bare=with_bare, threads=None,
            )  # fmt: skip
            views += [mounted.view for mounted in taken]
            bar.advance(len(taken))
    return views


def make_sheet_subject(
    item: TableObject, sizes_mm: Sequence[float], patch_px: int, at_real_size: bool = False, margin: Margin = "white"
) -> PaintableObject:
    """An object with a grey patch on each of its sheets, whose paper is what is painted.

    It is the model, millimetres, or what it is a model of, metres, with sheets that grew with it.
    """
    # the paper is found by its texture: grey stands for any patch
    grey = np.full((patch_px, patch_px, 3), 128, np.uint8)
    mesh, paper = wear_sheets(item.mesh, mount_sheets(item.mesh, grey, item.spec.mounts, sizes_mm, item.name, margin))
    material = next(k for k, candidate in enumerate(mesh.materials) if candidate.texture is paper)
    bare = item.mesh
    # at real size, the sheets grow with the object
    if at_real_size:
        mesh, bare = (scale_to_world(one, item.spec, item.spec.real_length_m) for one in (mesh, bare))
    return PaintableObject(mesh, material, bare)


def stack_views(
    views: list[LinearView], sizes_mm: Sequence[float], device: str, metres_per_unit: float = 1.0,
    margin: Margin = "white",
) -> MountedViews:  # fmt: skip
    """Views of sheets on which the patch has sides of `sizes_mm`, as tensors on `device`.

    Their depths, where they have any, are in units that are `metres_per_unit` long at real size.
    """
    # of the views themselves: a renderer that changes makes another run
    digest = sha256_bytes("".join(view.sha256 for view in views).encode())
    depths = find_depths(views, [metres_per_unit] * len(views))
    boxes = np.array([box_of_coverage(view.coverage) for view in views], np.float32)
    bare = [view.bare for view in views if view.bare is not None]
    return MountedViews(
        batch_views(views, device, half=True), tuple(sizes_mm), digest, tuple(depths), boxes,
        bare=batch_pictures(bare, device) if bare else None, margin=margin,
    )  # fmt: skip


def print_on_paper(linear: torch.Tensor, size_mm: float, margin: Margin = "white") -> torch.Tensor:
    """(3, m, m): `toolkit.rig.mount.print_on_paper`, in linear light and differentiable in the patch (3, n, n)."""
    repeat, margin_px = size_on_paper(linear.shape[-1], size_mm)
    # nearest by default: texels on paper have sharp edges
    crisp = interpolate(linear[None], scale_factor=repeat)[0]
    side = crisp.shape[-1]
    if margin == "bleed":
        which = torch.from_numpy(mirror(side, margin_px)).to(linear.device)
        return crisp[:, which][:, :, which]
    white = srgb_to_linear(torch.tensor(PAPER, dtype=linear.dtype, device=linear.device) / 255)[:, None, None]
    paper = white.repeat(1, side + 2 * margin_px, side + 2 * margin_px)
    paper[:, margin_px : margin_px + side, margin_px : margin_px + side] = crisp
    return paper


def show_mounted(
    patch: torch.Tensor, views: MountedViews, which: np.ndarray, corners: np.ndarray, image_px: int,
    rng: np.random.Generator | None = None, *, through: Through | None = None,
) -> torch.Tensor:  # fmt: skip
    """Photographs of the object with a patch on its sheets.

    Args:
        patch: θ, (3, n, n) sRGB-encoded in [0, 1], n as the views were made for.
        views: of the object.
        which: (b,) views to show.
        corners: (b, 2) top and left of the cut.
        image_px: side of the cut.
        rng: draws exposure, tint and noise; None shows the views as they are.
        through: weather over these cuts, see `MountedViews.draw_weather`.

    Returns:
        (b, 3, image_px, image_px) sRGB-encoded in [0, 1], differentiable in `patch`.
    """
    batch = views.batch.cut(which, corners, image_px, patch.dtype)
    # weather acts on light, before the camera develops it
    if through is not None:
        batch = batch.through(*through)
    # in linear light, in which views are linear in the paper's colours
    paper = print_on_paper(srgb_to_linear(patch), min(views.sizes_mm), views.margin)
    if rng is None:
        return show_linear(paper, batch)
    count = len(batch)
    # exposure for all colours, and a small tint for each
    drawn = rng.uniform(*EXPOSURE, (count, 1, 1, 1)) * rng.uniform(1 - TINT, 1 + TINT, (count, 3, 1, 1))
    photos = show_linear(paper, batch, torch.as_tensor(drawn, dtype=patch.dtype, device=patch.device))
    shape = (count, 3, image_px, image_px)
    grain = torch.as_tensor(rng.standard_normal(shape, np.float32), dtype=patch.dtype, device=patch.device)
    return (photos + NOISE * grain).clamp(0, 1)


def draw_cuts(
    views: MountedViews, rng: np.random.Generator, count: int, image_px: int
) -> tuple[np.ndarray, np.ndarray]:
    """(count,) random views, and (count, 2) top and left of a random square of each."""
    which = rng.choice(len(views), count, replace=count > len(views))
    return which, rng.integers(0, views.batch.still.shape[1] - image_px + 1, (count, 2))


@dataclass(frozen=True)
class DrawnViews:
    """Views at cuts and in weather that were drawn for a training step, waiting for a patch.

    Attributes:
        views: of the object.
        which, corners: see `show_mounted`.
        image_px: side of the cuts.
        rng: draws light and grain, the same whenever they are shown.
        through: weather over them.
    """

    views: MountedViews
    which: np.ndarray
    corners: np.ndarray
    image_px: int
    rng: np.random.Generator
    through: Through | None

    @property
    def boxes(self) -> np.ndarray:
        """(b, 4) x1, y1, x2, y2 round the object, in pixels of the cuts."""
        assert self.views.boxes is not None
        # x and y of a box; corners are top and left
        return self.views.boxes[self.which] - self.corners[:, [1, 0, 1, 0]]

    def __call__(self, patch: torch.Tensor) -> torch.Tensor:
        """Photographs of the object with a patch on its sheets."""
        return show_mounted(
            patch, self.views, self.which, self.corners, self.image_px, deepcopy(self.rng), through=self.through
        )

    def show_bare(self, patch: torch.Tensor) -> torch.Tensor:
        """The same photographs of the object without its sheets; of the patch the type counts alone."""
        assert self.views.bare is not None
        return replace(self, views=replace(self.views, batch=self.views.bare))(patch)


def draw_mounted(
    views: MountedViews, draws: Draws, count: int, image_px: int, weather: ViewWeather | None = None
) -> DrawnViews:
    """A batch of random views at random cuts in the weather that is drawn for them."""
    # views, cuts and weather of a step, all from its own draws
    rng = draws.of("mounted")
    which, corners = draw_cuts(views, rng, count, image_px)
    through = None
    if weather is not None:
        through = views.draw_weather(weather, which, corners, image_px, weather.rng(draws))
    return DrawnViews(views, which, corners, image_px, rng, through)


def recognise_mounted(
    patches: Sequence[torch.Tensor], views: MountedViews, targets: list[Target], image_px: int, *,
    weather: ViewWeather | None = None, seed: int = 0,
) -> list[list[Share]]:  # fmt: skip
    """For each patch (3, n, n), in how many views each network recognises the object with it; in the same weather."""
    # in validation every view has weather
    weather = None if weather is None else weather.with_overrides(probability=1.0)
    # the middle: validation draws no cut, so that two patches are seen alike
    start = (views.batch.still.shape[1] - image_px) // 2
    hits = np.zeros((len(patches), len(targets)), int)
    with torch.inference_mode():
        for first in range(0, len(views), BATCH):
            which = np.arange(first, min(first + BATCH, len(views)))
            corners = np.full((len(which), 2), start)
            through = None
            if weather is not None:
                rng = weather.rng(Draws(seed, first, "validate"))
                through = views.draw_weather(weather, which, corners, image_px, rng)
            for row, patch in enumerate(patches):
                photos = show_mounted(patch, views, which, corners, image_px, through=through)
                for k, target in enumerate(targets):
                    hits[row, k] += target.count_hits(photos)
    return [[Share(int(count), len(views)) for count in row] for row in hits]


def grey_paper(patch: torch.Tensor) -> torch.Tensor:
    """A plain grey patch of the same size, for comparison."""
    return torch.full_like(patch, PAPER_GREY)


def validate_mounted(
    patch: torch.Tensor, views: MountedViews, targets: list[Target], image_px: int, *,
    weather: ViewWeather | None = None, seed: int = 0,
) -> list[Validation]:  # fmt: skip
    """Recognise held-out views with the patch, and with plain grey paper in its place; both in the same weather."""
    both = [grey_paper(patch), patch]
    bare, patched = recognise_mounted(both, views, targets, image_px, weather=weather, seed=seed)
    return [Validation(target.classifier.name, *shares) for target, *shares in zip(targets, bare, patched, strict=True)]
