"""Is the right patch on the object, and does it show?"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.rig.mount import MountedSheet
from toolkit.rooms.photos.gates import Gate, GateResult
from toolkit.rooms.photos.gates.objects import Solid
from toolkit.rooms.photos.posed_camera import PosedCamera
from toolkit.rooms.photos.prints.align import cell_centres
from toolkit.rooms.photos.prints.features import Features, describe_patch, guess_places
from toolkit.rooms.photos.prints.find import CELL_SHOWS, LEAD, PatchSighting, SearchedPhoto, find_patch, search_photo

CELLS = 5
"""`find_patch` tells of so many cells each way whether they show."""
STEEPEST_DEG = 72.0
"""A cell that is seen at more than this from straight above is a few pixels high, and nothing is expected of it."""
LEAST_SUPPORT = 12
"""Local features that agree on where a patch lies: in the rig's photographs 33 to 190 for the patch that is there,
fewer where it is seen very slanted, and at most 11 where no patch is."""
REACH = 0.02
"""How far round the object's silhouette a patch is looked for, as a share of the picture's longer side."""
LEAST_SEEN = 0.3
"""Where less of the patch than this faces the camera, whether the rest is hidden cannot be told."""
LEAST_HEIGHT_PX = 24.0
"""Smallest apparent height of a patch, pixels, at which its absence is believed."""
HIDDEN = Gate(
    "patch hidden", 30.0, "% of the patch that should show",
    "a part of the patch does not show: take hand, cable, tape or glare off it, and press its corners down",
)  # fmt: skip
"""30 %: photograph and file must agree in each of 5 × 5 cells. In the rig's good photographs 7 % of what should show
does not, in blurred ones up to 12 %; a finger over one edge is a fifth."""
VARIANT = Gate("wrong variant", 0.0, "wrong or missing patches", "the photograph shows another variant")
"""0: the variant's own patch and no other."""


@dataclass(frozen=True)
class PlacedSheet:
    """Where the patch on a mounted sheet lies in the world.

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
    """What a photograph's object should have stuck on it.

    Attributes:
        own: name of the patch that belongs there; None where none does.
        home: name of the object's own patch in a variant without it: the likeliest patch to be there by mistake.
        patches: pixels (n, n, 3) uint8 sRGB by name of all patches that could be confused, with its own.
        sheets: where that patch is, sheet by sheet, where the mesh and the mounts say; empty where that is not known.
    """

    own: str | None
    patches: Mapping[str, np.ndarray] = field(repr=False)
    home: str | None = None
    sheets: tuple[PlacedSheet, ...] = ()


@dataclass(frozen=True)
class PatchesSeen:
    """What was found.

    Attributes:
        own: the patch that belongs there, sheet by sheet; one where it is not known which sheet it is.
        other: name of the surest patch that does not.
    """

    own: tuple[PatchSighting | None, ...]
    other: str | None

    def lacks_own(self, shown: Sequence[bool] | None) -> bool:
        """Whether a sheet was not found that is `shown`, as for `look_for_patches`, or none at all."""
        parts = () if shown is None else zip(self.own, shown, strict=True)
        return not any(self.own) or any(is_shown and sighting is None for sighting, is_shown in parts)


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


def look_for_patches(
    photo: SearchedPhoto, patch: ExpectedPatch, view: PosedCamera | None, shown: Sequence[bool] | None = None
) -> PatchesSeen:
    """Look for the patch that belongs on the object; where it is not seen, for all others.

    The object's own patch is looked for thoroughly, also where mesh and mount say that it lies. Of the others, only
    those that the local features speak for (`LEAST_SUPPORT`): to look for every patch of a workspace takes seconds.

    Args:
        photo: from `search_region`.
        patch: what should be on the object.
        view: of the photograph, None where it is not known.
        shown: of several sheets, which ones the view shows, from `list_shown`: each is looked for in its own place.
    """
    likely = patch.own or patch.home
    places = [_expect_corners(sheet, view) for sheet in patch.sheets if view is not None] or [None]
    found: tuple[PatchSighting | None, ...] = (None,)
    if likely is not None and patch.own is not None and shown is not None:
        found = _find_each(photo, patch.patches[likely], places, shown)
        if not PatchesSeen(found, None).lacks_own(shown):
            return PatchesSeen(found, None)
    elif likely is not None:
        for expected in places:
            sighting = find_patch(photo, patch.patches[likely], expected)
            if sighting is not None:
                is_own = likely == patch.own
                return PatchesSeen((sighting,) if is_own else (None,), None if is_own else likely)
    sightings = {
        name: find_patch(photo, pixels)
        for name, pixels in patch.patches.items()
        if name != likely and _is_supported(photo, pixels)
    }
    ranked = sorted(
        ((sighting.confidence, name) for name, sighting in sightings.items() if sighting is not None), reverse=True
    )
    # of two patches that fit about as well both are named, as either may be what is there
    sure = len(ranked) < 2 or ranked[0][0] - ranked[1][0] >= LEAD
    return PatchesSeen(found, " or ".join(name for _, name in ranked[: 1 if sure else 2]) or None)


def _expect_corners(sheet: PlacedSheet, view: PosedCamera) -> np.ndarray | None:
    corners = view.project(sheet.corners_mm)
    return corners if np.isfinite(corners).all() else None


def _find_each(
    photo: SearchedPhoto, pixels: np.ndarray, places: Sequence[np.ndarray | None], shown: Sequence[bool]
) -> tuple[PatchSighting | None, ...]:
    """The same patch on each sheet that is shown: near its own place, and nearer to it than to any other's."""
    found: list[PatchSighting | None] = []
    for number, expected in enumerate(places):
        sighting = None
        if shown[number] and expected is not None:
            reach = np.ptp(expected, axis=0).max() / 2
            middles = photo.features.frames[:, :, 2] / photo.scale
            low, high = expected.min(axis=0) - reach, expected.max(axis=0) + reach
            near = ((middles >= low) & (middles <= high)).all(axis=1)
            features = Features(photo.features.frames[near], photo.features.descriptors[near])
            sighting = find_patch(replace(photo, features=features), pixels, expected)
        if sighting is not None:
            away = [
                np.inf if place is None else np.linalg.norm(sighting.corners_px - place, axis=1).mean()
                for place in places
            ]
            # the same patch is on other sheets too: what lies nearer to another's place is a sighting of that sheet
            sighting = sighting if int(np.argmin(away)) == number else None
        found.append(sighting)
    return tuple(found)


def _is_supported(photo: SearchedPhoto, pixels: np.ndarray) -> bool:
    guesses = guess_places(photo.features, describe_patch(pixels), 1)
    return bool(guesses) and guesses[0].support >= LEAST_SUPPORT


def check_variant(
    seen: PatchesSeen, patch: ExpectedPatch, variant: str, shown: Sequence[bool] | None = None
) -> GateResult:  # fmt: skip
    """Count what is wrong: a patch that does not belong there, or a missing patch."""
    own, was_found = patch.own, any(seen.own)
    # a patch that does not belong there
    if seen.other is not None:
        should = f"the patch '{own}'" if own else "no patch"
        on_each = f" on each of its {len(patch.sheets)} sheets" if was_found else ""
        return VARIANT.judge(
            1,
            f"the patch '{seen.other}' is seen, '{variant}' should show {should}{on_each}: change it, or sort the "
            "photo anew",
        )
    # no patch where it should be
    if own is not None and not was_found:
        return VARIANT.judge(
            1, f"no patch is seen, '{variant}' should show '{own}': stick it on, uncover it, or sort the photo anew"
        )
    # a sheet of several that faces the camera and is not found
    if own is not None and shown is not None:
        parts = enumerate(zip(patch.sheets, seen.own, shown, strict=True), 1)
        missing = [
            f"{number} ({sheet.at})" for number, (sheet, sighting, is_shown) in parts if is_shown and sighting is None
        ]
        if missing:
            which = f"sheet {' and '.join(missing)} of {len(patch.sheets)}"
            return VARIANT.judge(
                len(missing), f"{which} is not seen, '{variant}' should show '{own}' there: stick it on, or uncover it"
            )
    return VARIANT.judge(0)


def check_patch_shows(seen: PatchesSeen, expected: Sequence[np.ndarray | None]) -> GateResult:
    """Return the missing share of the patch that should show; of several found sheets, of the sheet that shows least.

    Args:
        seen: what was found.
        expected: for each sheet (25,) bool which cells should show, from `expect_cells`; None where that is not known,
            and then all.
    """
    if not any(seen.own):
        return HIDDEN.skip("the patch is not found, see 'wrong variant'")
    hidden: list[float] = []
    for sighting, cells in zip(seen.own, expected, strict=len(seen.own) > 1):
        if sighting is None:
            continue
        agrees = sighting.agreement.ravel() >= CELL_SHOWS
        shows = np.ones(agrees.size, bool) if cells is None else cells
        if shows.mean() >= LEAST_SEEN:
            hidden.append(100.0 * float((~agrees[shows]).mean()))
    if not hidden:
        return HIDDEN.skip("from this pose the object itself hides most of the patch")
    return HIDDEN.judge(max(hidden))


def list_shown(expected: Sequence[np.ndarray | None]) -> list[bool] | None:
    """Which of several sheets face the camera; None for a single sheet, or where no pose is known."""
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
    """Whether a patch on a sheet would be wide enough in the photograph to be found for sure."""
    corners = view.project(sheet.corners_mm)
    if not np.isfinite(corners).all():
        return False
    _, (width, height), _ = cv2.minAreaRect(corners.astype(np.float32))
    return min(width, height) >= LEAST_HEIGHT_PX


def place_cells(sheet: MountedSheet, at: str = "object") -> PlacedSheet:
    """Where a mounted patch's cells lie, in the object's frame; `at` names the side that it is taped to.

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
        right = (TAPE_MARGIN_MM + places[:, 0] * sheet.size_mm) / side
        up = 1 - (TAPE_MARGIN_MM + places[:, 1] * sheet.size_mm) / side
        run, share = (right, up) if along_u else (up, right)
        steps = np.linspace(0, 1, count)
        edges = [np.stack([np.interp(run, steps, values[:, k, i]) for i in range(3)], axis=1) for k in (0, 1)]
        return edges[0] * (1 - share[:, None]) + edges[1] * share[:, None]

    outward = place(cell_centres(CELLS), normals)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    return PlacedSheet(at, place(cell_centres(CELLS), points), outward, place(corners, points))
