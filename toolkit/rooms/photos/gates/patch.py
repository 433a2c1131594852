"""Is the right patch on the object, and does it show?"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from toolkit.core.text import join_words
from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.rig.mount import MountedSheet
from toolkit.rooms.photos.gates import Gate, GateResult
from toolkit.rooms.photos.gates.objects import Solid
from toolkit.rooms.photos.posed_camera import PosedCamera
from toolkit.rooms.photos.prints.align import cell_centres
from toolkit.rooms.photos.prints.features import LocalFeatures, describe_patch, guess_places
from toolkit.rooms.photos.prints.find import CELL_SHOWS, LEAD, PatchSighting, SearchedPhoto, find_patch, search_photo

CELLS = 5
"""Cells each way whose visibility `find_patch` measures."""
STEEPEST_DEG = 72.0
"""Largest slant of a cell that should show: more slanted cells are a few pixels high."""
LEAST_SUPPORT = 12
"""Least number of local features that agree on a patch's place. In the rig's photographs 33 to 190 do for a patch that
is there, fewer for a very slanted patch, and at most 11 without a patch."""
REACH = 0.02
"""Margin round the object's silhouette in which a patch is looked for, as a share of the picture's longer side."""
LEAST_SEEN = 0.3
"""Least share of the patch that must face the camera to tell whether it is hidden."""
LEAST_HEIGHT_PX = 24.0
"""Smallest apparent height of a patch, pixels, at which its absence is believed."""
HIDDEN = Gate(
    "patch hidden", 30.0, "% of the patch that should show",
    "a part of the patch does not show: take hand, cable, tape or glare off it, and press its corners down",
)  # fmt: skip
"""30 %: photograph and file must agree in each of 5 × 5 cells. 7 % of what should show does not in the rig's good
photographs, up to 12 % in blurred photographs. A finger over an edge hides a fifth."""
VARIANT = Gate("wrong variant", 0.0, "wrong or missing patches", "the photograph shows another variant")


@dataclass(frozen=True)
class PlacedSheet:
    """Place of the patch on a mounted sheet in the world.

    Attributes:
        at: the side of the object that it is taped to, for people.
        cells_mm: (25, 3) middles of its cells, rows down.
        outward: (25, 3) the paper's unit normals there.
        corners_mm: (4, 3) its corners, in the file's order.
    """

    at: str
    cells_mm: np.ndarray
    outward: np.ndarray
    corners_mm: np.ndarray


@dataclass(frozen=True)
class ExpectedPatch:
    """The patch that a photograph's object should wear.

    Attributes:
        own: name of the patch that belongs there, or None.
        patches: pixels (n, n, 3) uint8 sRGB by name of all patches that could be confused, with its own.
        home: name of the object's own patch in a variant without it: the likeliest patch to be there by mistake.
        sheets: places of the patch by mesh and mounts; empty if they are not known.
    """

    own: str | None
    patches: Mapping[str, np.ndarray] = field(repr=False)
    home: str | None = None
    sheets: tuple[PlacedSheet, ...] = ()


@dataclass(frozen=True)
class PatchesSeen:
    """The patch that belongs there, sheet by sheet or anywhere, and the name of the surest patch that does not."""

    own: tuple[PatchSighting | None, ...]
    other: str | None

    def lacks_own(self, shown: Sequence[bool] | None) -> bool:
        """Whether a sheet that is `shown`, as for `look_for_patches`, was not found, or none at all."""
        parts = () if shown is None else zip(self.own, shown, strict=True)
        return not any(self.own) or any(is_shown and sighting is None for sighting, is_shown in parts)


def search_region(image: np.ndarray, region: np.ndarray | None) -> SearchedPhoto:
    """Find the local features of a photograph (h, w, 3) uint8 sRGB in a region (h, w) bool, or everywhere."""
    photo = search_photo(image)
    if region is None:
        return photo
    # a little beyond the region, as features have an extent
    near = cv2.dilate(region.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=round(REACH * max(region.shape)))
    column, row = (photo.features.frames[:, :, 2] / photo.scale).T.astype(int)
    kept = near[row.clip(0, region.shape[0] - 1), column.clip(0, region.shape[1] - 1)] > 0
    return replace(photo, features=LocalFeatures(photo.features.frames[kept], photo.features.descriptors[kept]))


def look_for_patches(
    photo: SearchedPhoto, patch: ExpectedPatch, view: PosedCamera | None, shown: Sequence[bool] | None = None
) -> PatchesSeen:
    """Look for the patch that belongs on the object; if it is not seen, for all others.

    The object's own patch is looked for everywhere, and in its place by mesh and mount. Others need the support of
    local features (`LEAST_SUPPORT`), as every patch of a workspace would take seconds.

    Args:
        photo: from `search_region`.
        patch: expected on the object.
        view: of the photograph, None if it is not known.
        shown: whether the view shows each of several sheets, from `list_shown`: each is looked for in its own place.
    """
    # the patch that belongs on the object, or on the bare object the patch it would wear
    likely = patch.own or patch.home
    # places by mesh and mount; without a view, or behind the camera, a sheet may be anywhere
    seen_at = [view.project(sheet.corners_mm) for sheet in patch.sheets if view is not None]
    places = [corners if np.isfinite(corners).all() else None for corners in seen_at] or [None]
    found: tuple[PatchSighting | None, ...] = (None,)
    if likely is not None and patch.own is not None and shown is not None:
        found = _find_each(photo, patch.patches[likely], places, shown)
        if not PatchesSeen(found, None).lacks_own(shown):
            return PatchesSeen(found, None)
    elif likely is not None:
        # the first place where the patch is found decides
        for expected in places:
            sighting = find_patch(photo, patch.patches[likely], expected)
            if sighting is not None:
                is_own = likely == patch.own
                return PatchesSeen((sighting,) if is_own else (None,), None if is_own else likely)
    # not the object's own: others must have the support of features
    ranked: list[tuple[float, str]] = []
    for name, pixels in patch.patches.items():
        guesses = [] if name == likely else guess_places(photo.features, describe_patch(pixels), 1)
        if guesses and guesses[0].support >= LEAST_SUPPORT and (sighting := find_patch(photo, pixels)) is not None:
            ranked.append((sighting.confidence, name))
    ranked.sort(reverse=True)
    # two patches that fit about as well are both named
    sure = len(ranked) < 2 or ranked[0][0] - ranked[1][0] >= LEAD
    return PatchesSeen(found, " or ".join(name for _, name in ranked[: 1 if sure else 2]) or None)


def _find_each(
    photo: SearchedPhoto, pixels: np.ndarray, places: Sequence[np.ndarray | None], shown: Sequence[bool]
) -> tuple[PatchSighting | None, ...]:
    """Find the same patch on each sheet that is shown: near its own place, and nearer to it than to any other's."""
    found: list[PatchSighting | None] = []
    for number, expected in enumerate(places):
        sighting = None
        if shown[number] and expected is not None:
            # features within half a sheet around its place
            reach = np.ptp(expected, axis=0).max() / 2
            middles = photo.features.frames[:, :, 2] / photo.scale
            low, high = expected.min(axis=0) - reach, expected.max(axis=0) + reach
            near = ((middles >= low) & (middles <= high)).all(axis=1)
            features = LocalFeatures(photo.features.frames[near], photo.features.descriptors[near])
            sighting = find_patch(replace(photo, features=features), pixels, expected)
        if sighting is not None:
            away = [
                np.inf if place is None else np.linalg.norm(sighting.corners_px - place, axis=1).mean()
                for place in places
            ]
            # the same patch is on other sheets too: nearer to another's place it is a sighting of that sheet
            sighting = sighting if int(np.argmin(away)) == number else None
        found.append(sighting)
    return tuple(found)


def check_variant(
    seen: PatchesSeen, patch: ExpectedPatch, variant: str, shown: Sequence[bool] | None = None
) -> GateResult:
    """Count patches that do not belong there, or are missing."""
    own, was_found = patch.own, any(seen.own)
    # a patch that does not belong there
    if seen.other is not None:
        should = f"the patch '{own}'" if own else "no patch"
        on_each = f" on each of its {len(patch.sheets)} sheets" if was_found else ""
        wrong = f"the patch '{seen.other}' is seen, '{variant}' should show {should}{on_each}"
        return VARIANT.judge(1, f"{wrong}: change it, or sort the photo again")
    # no patch where it should be
    if own is not None and not was_found:
        missing = f"no patch is seen, '{variant}' should show '{own}'"
        return VARIANT.judge(1, f"{missing}: stick it on, uncover it, or sort the photo again")
    # a sheet of several that faces the camera and is not found
    if own is not None and shown is not None:
        parts = enumerate(zip(patch.sheets, seen.own, shown, strict=True), 1)
        lost = [f"{i} ({sheet.at})" for i, (sheet, sighting, is_shown) in parts if is_shown and sighting is None]
        if lost:
            which = f"sheet {join_words(lost)} of {len(patch.sheets)} is not seen"
            advice = f"{which}, '{variant}' should show '{own}' there: stick it on, or uncover it"
            return VARIANT.judge(len(lost), advice)
    return VARIANT.judge(0)


def check_patch_shows(seen: PatchesSeen, expected: Sequence[np.ndarray | None]) -> GateResult:
    """Return the missing share of the patch that should show, for the found sheet that shows least.

    `expected` has for each sheet (25,) bool which cells should show, from `expect_cells`; None stands for all.
    """
    if not any(seen.own):
        return HIDDEN.skip("the patch is not found, see 'wrong variant'")
    hidden: list[float] = []
    for sighting, cells in zip(seen.own, expected, strict=len(seen.own) > 1):
        if sighting is None:
            continue
        # cells of the sheet that agree with the file
        agrees = sighting.agreement.ravel() >= CELL_SHOWS
        # cells that this pose hides are not missed
        shows = np.ones(agrees.size, bool) if cells is None else cells
        if shows.mean() >= LEAST_SEEN:
            hidden.append(100.0 * float((~agrees[shows]).mean()))
    if not hidden:
        return HIDDEN.skip("from this pose the object itself hides most of the patch")
    return HIDDEN.judge(max(hidden))


def list_shown(expected: Sequence[np.ndarray | None]) -> list[bool] | None:
    """Whether each of several sheets faces the camera; None for a single sheet, or without a pose."""
    cells = [facing for facing in expected if facing is not None]
    if len(expected) < 2 or len(cells) < len(expected):
        return None
    return [bool(facing.mean() >= LEAST_SEEN) for facing in cells]


def expect_cells(sheet: PlacedSheet, solid: Solid | None, view: PosedCamera | None) -> np.ndarray | None:
    """(25,) bool: which cells of a sheet face the camera, in the frame and behind nothing; None without a pose."""
    if view is None or solid is None:
        return None
    to_camera = view.position_mm - sheet.cells_mm
    to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
    facing = (to_camera * sheet.outward).sum(axis=1) > np.cos(np.radians(STEEPEST_DEG))
    return facing & view.sees(sheet.cells_mm) & ~solid.hides(view, sheet.cells_mm)


def is_clear(sheet: PlacedSheet, view: PosedCamera) -> bool:
    """Whether a patch on a sheet is large enough in the photograph to be found for sure."""
    corners = view.project(sheet.corners_mm)
    if not np.isfinite(corners).all():
        return False
    _, (width, height), _ = cv2.minAreaRect(corners.astype(np.float32))
    return min(width, height) >= LEAST_HEIGHT_PX


def place_cells(sheet: MountedSheet, at: str = "object") -> PlacedSheet:
    """Place a mounted patch's cells in the object's frame; `at` names the side that it is taped to.

    The sheet's printed face is a grid of points along its bend and across it; places between are linear.
    """
    count = len(sheet.mesh.vertices) // 4  # printed face and back, both edges of each
    points, normals, uv = (
        array[: 2 * count].reshape(count, 2, -1).astype(float)
        for array in (sheet.mesh.vertices, sheet.mesh.normals, sheet.mesh.uv)
    )
    # the sheet bends along one of its texture's axes, and the grid runs along that axis
    along_u = abs(uv[-1, 0, 0] - uv[0, 0, 0]) > 0.5
    side = sheet.size_mm + 2 * TAPE_MARGIN_MM

    def place(places: np.ndarray, values: np.ndarray) -> np.ndarray:
        # printed and tape margin together make up the sheet; v grows downwards on the page and upwards in the texture
        right = (TAPE_MARGIN_MM + places[:, 0] * sheet.size_mm) / side
        up = 1 - (TAPE_MARGIN_MM + places[:, 1] * sheet.size_mm) / side
        run, share = (right, up) if along_u else (up, right)
        steps = np.linspace(0, 1, count)
        # linear along the bend, on both long edges of the sheet
        edges = [np.stack([np.interp(run, steps, values[:, k, i]) for i in range(3)], axis=1) for k in (0, 1)]
        # linear from edge to edge across it
        return edges[0] * (1 - share[:, None]) + edges[1] * share[:, None]

    # normals are interpolated as well, so they need their length back
    outward = place(cell_centres(CELLS), normals)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    return PlacedSheet(at, place(cell_centres(CELLS), points), outward, place(corners, points))
