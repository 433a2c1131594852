"""Is the right patch on the object, and does it show?"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.photos.gates.result import Gate, GateResult
from toolkit.photos.gates.solid import Solid
from toolkit.photos.posed_camera import PosedCamera
from toolkit.photos.prints.features import Features, describe_patch, guess_places
from toolkit.photos.prints.find import CELL_SHOWS, LEAD, PatchSighting, SearchedPhoto, find_patch, search_photo
from toolkit.rig.mount import MountedSheet

CELLS = 5
"""`find_patch` tells of so many cells each way whether they show."""
STEEPEST_DEG = 72.0
"""A cell that is seen at more than this from straight above is a few pixels high, and nothing is expected of it."""
LEAST_SUPPORT = 12
"""Local features that agree on where a patch lies: in the rig's photographs 33 to 190 for the patch that is there,
fewer where it is seen very slanted, and at most 11 for one that is not."""
REACH = 0.02
"""How far round the object's silhouette a patch is looked for, as a share of the picture's longer side."""
LEAST_SEEN = 0.3
"""Where less of the patch than this faces the camera, whether the rest is hidden cannot be told."""
HIDDEN = Gate(
    "patch hidden", 30.0, "% of the patch that should show",
    "a part of the patch does not show: take hand, cable, tape or glare off it, and press its corners down",
)  # fmt: skip
"""30 %: photograph and file must agree in each of 5 × 5 cells. In the rig's good photographs 7 % of what should show
does not, in blurred ones up to 12 %; a finger over one edge is a fifth."""
VARIANT = Gate("wrong variant", 0.0, "wrong or missing patches", "the photograph shows another variant")
"""0: the variant's own patch and no other."""


@dataclass(frozen=True)
class ExpectedPatch:
    """What a photograph's object should have stuck on it.

    Attributes:
        own: name of the patch that belongs there; None where none does.
        home: name of the object's own patch in a variant without it: the likeliest one to be there by mistake.
        patches: pixels (n, n, 3) uint8 sRGB by name of all patches that could be confused, the own one among them.
        cells_mm: (25, 3) middles of that patch's cells in the world, rows down, where the mesh and the mount say.
        outward: (25, 3) the paper's unit normals there.
        corners_mm: (4, 3) that patch's corners, in the file's order.
    """

    own: str | None
    patches: Mapping[str, np.ndarray] = field(repr=False)
    home: str | None = None
    cells_mm: np.ndarray | None = None
    outward: np.ndarray | None = None
    corners_mm: np.ndarray | None = None


@dataclass(frozen=True)
class PatchesSeen:
    """What was found.

    Attributes:
        own: the patch that belongs there.
        other: name of the surest one that does not.
    """

    own: PatchSighting | None
    other: str | None


def search_region(image: np.ndarray, region: np.ndarray | None) -> SearchedPhoto:
    """A photograph made ready for `look_for_patches`: local features of the object alone, which are fewer than all.

    Args:
        image: (h, w, 3) uint8 sRGB.
        region: (h, w) bool where the object should be; None where that is not known, and then the whole picture counts.
    """
    photo = search_photo(image)
    if region is None:
        return photo
    near = cv2.dilate(region.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=round(REACH * max(region.shape)))
    column, row = (photo.features.frames[:, :, 2] / photo.scale).T.astype(int)
    kept = near[row.clip(0, region.shape[0] - 1), column.clip(0, region.shape[1] - 1)] > 0
    return replace(photo, features=Features(photo.features.frames[kept], photo.features.descriptors[kept]))


def look_for_patches(photo: SearchedPhoto, patch: ExpectedPatch, view: PosedCamera | None) -> PatchesSeen:
    """Look for the patch that belongs on the object; where it is not seen, for all others.

    The object's own patch is looked for thoroughly, also where mesh and mount say that it lies. Of the others, only
    those that the local features speak for (`LEAST_SUPPORT`): to look for every patch of a workspace takes seconds.

    Args:
        photo: from `search_region`.
        patch: what should be on the object.
        view: of the photograph, None where it is not known.
    """
    expected = None
    if view is not None and patch.corners_mm is not None:
        corners = view.project(patch.corners_mm)
        expected = corners if np.isfinite(corners).all() else None
    likely = patch.own or patch.home
    found = find_patch(photo, patch.patches[likely], expected) if likely is not None else None
    if found is not None:
        return PatchesSeen(found, None) if likely == patch.own else PatchesSeen(None, likely)
    sightings = {
        name: find_patch(photo, pixels)
        for name, pixels in patch.patches.items()
        if name != likely and _is_supported(photo, pixels)
    }
    ranked = sorted(((one.confidence, name) for name, one in sightings.items() if one is not None), reverse=True)
    sure = len(ranked) < 2 or ranked[0][0] - ranked[1][0] >= LEAD
    return PatchesSeen(None, " or ".join(name for _, name in ranked[: 1 if sure else 2]) or None)


def _is_supported(photo: SearchedPhoto, pixels: np.ndarray) -> bool:
    guesses = guess_places(photo.features, describe_patch(pixels), 1)
    return bool(guesses) and guesses[0].support >= LEAST_SUPPORT


def check_variant(seen: PatchesSeen, own: str | None, variant: str) -> GateResult:
    """Count what is wrong: a patch that does not belong there, or none where one does.

    Args:
        seen: what was found.
        own: name of the patch that belongs there, None for a variant without one.
        variant: for the advice.
    """
    if seen.other is not None:
        should = f"the patch '{own}'" if own else "no patch"
        return VARIANT.judge(
            1,
            f"the patch '{seen.other}' is seen, '{variant}' should show {should}: change it, or sort the photo anew",
        )
    if own is not None and seen.own is None:
        return VARIANT.judge(
            1, f"no patch is seen, '{variant}' should show '{own}': stick it on, uncover it, or sort the photo anew"
        )
    return VARIANT.judge(0)


def check_patch_shows(seen: PatchesSeen, expected: np.ndarray | None) -> GateResult:
    """Share of the patch that should show and does not.

    Args:
        seen: what was found.
        expected: (25,) bool which cells should show, from `expect_cells`; None where that is not known, and then all.
    """
    if seen.own is None:
        return HIDDEN.skip("the patch is not found, see 'wrong variant'")
    agrees = seen.own.agreement.ravel() >= CELL_SHOWS
    expected = np.ones(agrees.size, bool) if expected is None else expected
    if expected.mean() < LEAST_SEEN:
        return HIDDEN.skip("from this pose the object itself hides most of the patch")
    return HIDDEN.judge(100.0 * float((~agrees[expected]).mean()))


def expect_cells(patch: ExpectedPatch, solid: Solid | None, view: PosedCamera | None) -> np.ndarray | None:
    """(25,) bool: which cells of the patch face the camera, in the frame and behind nothing; None without a pose."""
    if view is None or solid is None or patch.cells_mm is None or patch.outward is None:
        return None
    to_camera = view.position_mm - patch.cells_mm
    to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
    facing = (to_camera * patch.outward).sum(axis=1) > np.cos(np.radians(STEEPEST_DEG))
    return facing & view.sees(patch.cells_mm) & ~solid.hides(view, patch.cells_mm)


def place_cells(sheet: MountedSheet) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where a mounted patch's cells lie: `ExpectedPatch`'s cells_mm, outward and corners_mm, in the object's frame.

    The sheet's printed face is a grid of points along its bend and across it; places between are linear.
    """
    count = len(sheet.mesh.vertices) // 4  # printed face and back, both edges of each
    points, normals, uv = (
        array[: 2 * count].reshape(count, 2, -1).astype(float)
        for array in (sheet.mesh.vertices, sheet.mesh.normals, sheet.mesh.uv)
    )
    along_u = abs(uv[-1, 0, 0] - uv[0, 0, 0]) > 0.5
    side = sheet.size_mm + 2 * TAPE_MARGIN_MM

    def at(places: np.ndarray, values: np.ndarray) -> np.ndarray:
        right = (TAPE_MARGIN_MM + places[:, 0] * sheet.size_mm) / side
        up = 1 - (TAPE_MARGIN_MM + places[:, 1] * sheet.size_mm) / side
        run, share = (right, up) if along_u else (up, right)
        steps = np.linspace(0, 1, count)
        edges = [np.stack([np.interp(run, steps, values[:, k, i]) for i in range(3)], axis=1) for k in (0, 1)]
        return edges[0] * (1 - share[:, None]) + edges[1] * share[:, None]

    outward = at(cell_middles(), normals)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    return at(cell_middles(), points), outward / np.linalg.norm(outward, axis=1, keepdims=True), at(corners, points)


def cell_middles() -> np.ndarray:
    """(25, 2) middles of a patch's cells, (u, v) in [0, 1], rows down."""
    steps = (np.arange(CELLS) + 0.5) / CELLS
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
