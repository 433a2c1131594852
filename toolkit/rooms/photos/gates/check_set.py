"""Gates that need all photographs of an object: has each its partner, and was the patch in the same place?"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from toolkit.rig import PAIR
from toolkit.rooms.photos.gates import Gate, GateResult
from toolkit.rooms.photos.gates.patch import CELLS
from toolkit.rooms.photos.posed_camera import PosedCamera
from toolkit.rooms.photos.prints.align import cell_centres
from toolkit.rooms.photos.prints.find import CELL_SHOWS, SIZE_TOLERANCE, PatchSighting

MOVED = Gate("patch moved", 5.0, "mm", "put it where it is in the other photographs, and take this photograph again")
"""5 mm: in the rig's photographs a patch that stays is found within 0.2 mm. Wavy paper and an uncalibrated lens add a
millimetre or two. A patch that was taken off and taped on again by eye lies 5 to 20 mm off."""
SIZE = Gate(
    "patch size", 100 * SIZE_TOLERANCE, "% off",
    "print it again at 100 % ('actual size'), with a ruler on the page's bars",
)  # fmt: skip
"""The rig's photographs give the side within 0.3 %; "fit to page" makes it 3 to 6 % too small."""
LEAST_PHOTOS = 3
"""Smallest number of photographs: two that disagree do not tell which is right."""
FEW_SIDES = f"it takes {LEAST_PHOTOS} photographs with pose and patch, from different sides"
LEAST_CELLS = 4
LEAST_ANGLE_DEG = 8.0
"""Least angle between lines of sight that locate a point."""
ROUNDS = 20
SOFT_MM = 0.5


@dataclass(frozen=True)
class PatchLines:
    """Lines of sight from a camera to the cells of a patch, 25 cells a sheet.

    Attributes:
        origin_mm: (3,) the camera.
        directions: (25 · sheets, 3) unit vectors in the world, rows of cells down; 0 for a sheet that was not found.
        shows: (25 · sheets,) bool: which cells were seen.
    """

    origin_mm: np.ndarray
    directions: np.ndarray
    shows: np.ndarray


class LinesRecord(BaseModel):
    """`PatchLines` as a file holds them; directions to a hundred-thousandth, which is 0.01 mm at a metre."""

    model_config = ConfigDict(frozen=True)
    origin_mm: list[float]
    directions: list[list[float]]
    shows: list[bool]

    @classmethod
    def from_lines(cls, lines: PatchLines) -> "LinesRecord":
        """Rounded for a file."""
        origin, directions = np.round(lines.origin_mm, 3).tolist(), np.round(lines.directions, 6).tolist()
        return cls(origin_mm=origin, directions=directions, shows=lines.shows.tolist())

    def to_lines(self) -> PatchLines:
        """Undo `from_lines`."""
        return PatchLines(np.array(self.origin_mm), np.array(self.directions), np.array(self.shows))


def trace_patch(sightings: Sequence[PatchSighting | None], view: PosedCamera) -> PatchLines | None:
    """The lines of a patch, sheet by sheet; None if no sheet was found. `view` is of the picture at the same size."""
    if not any(sighting is not None for sighting in sightings):
        return None
    directions, shows = np.zeros((len(sightings), CELLS**2, 3)), np.zeros((len(sightings), CELLS**2), bool)
    for sheet, seen in enumerate(sightings):
        if seen is not None:
            directions[sheet] = view.rays(view.camera.undistort(seen.warp.to_pixels(cell_centres(CELLS))))
            shows[sheet] = seen.agreement.ravel() >= CELL_SHOWS
    return PatchLines(view.position_mm, directions.reshape(-1, 3), shows.reshape(-1))


def measure_moves(photos: Sequence[PatchLines]) -> list[float | None]:
    """Measure in mm how far each photograph's patch lies from where the photographs together have it.

    Each value is the median over the cells that it shows, of the sheet farthest off. It is None if too few photographs
    show them, or all from the same side.
    """
    if len(photos) < LEAST_PHOTOS:
        return [None] * len(photos)
    # distance of each line of sight from the place where all photographs together have the cell
    misses = np.full((len(photos), photos[0].shows.size), np.nan)
    for cell, point in enumerate(triangulate_cells(photos)):
        who = [i for i, photo in enumerate(photos) if photo.shows[cell]]
        if np.isfinite(point).all():
            origins = np.array([photos[i].origin_mm for i in who])
            misses[who, cell] = _miss(point, origins, np.array([photos[i].directions[cell] for i in who]))
    moves: list[float | None] = []
    for row in misses.reshape(len(photos), -1, CELLS**2):
        # the median of a sheet, as a cell may lie in glare; the worst sheet, as each is taped alone
        sheets = [float(np.nanmedian(cells)) for cells in row if np.isfinite(cells).sum() >= LEAST_CELLS]
        moves.append(max(sheets, default=None))
    return moves


def triangulate_cells(photos: Sequence[PatchLines]) -> np.ndarray:
    """(25 · sheets, 3) places of the cells in the world, mm; NaN for a cell that too few photographs show."""
    points = np.full((photos[0].shows.size, 3), np.nan)
    for cell in range(len(points)):
        who = [photo for photo in photos if photo.shows[cell]]
        if len(who) >= LEAST_PHOTOS:
            directions = np.array([photo.directions[cell] for photo in who])
            # the widest angle between two of them has the smallest cosine
            if np.degrees(np.arccos(np.clip((directions @ directions.T).min(), -1, 1))) >= LEAST_ANGLE_DEG:
                points[cell] = meet(np.array([photo.origin_mm for photo in who]), directions)
    return points


def measure_side(photos: Sequence[PatchLines], sheet: int = 0) -> float | None:
    """Measure the side of the patch on a sheet, mm, by the distances of neighbouring cells; None with too few.

    A bend shortens the distance over a fifth of a patch by nothing that could be measured.
    """
    if len(photos) < LEAST_PHOTOS:
        return None
    # steps between neighbours along rows and columns
    grid = triangulate_cells(photos).reshape(-1, CELLS, CELLS, 3)[sheet]
    steps = np.concatenate([np.diff(grid, axis=axis).reshape(-1, 3) for axis in (0, 1)])
    lengths = np.linalg.norm(steps, axis=1)
    known = lengths[np.isfinite(lengths)]
    return None if len(known) < LEAST_CELLS else float(np.median(known)) * CELLS


def meet(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(3,) the point with the least sum of distances to lines (Weiszfeld's weights), robust against a few strays.

    `origins` (n, 3) are points of the lines, `directions` (n, 3) unit vectors, not all parallel.
    """
    # I - d d^T takes from a vector its part along d: what is left is the distance from the line
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    weight = np.ones(len(origins))
    point = origins.mean(axis=0)
    for _ in range(ROUNDS):
        weighted = across * weight[:, None, None]
        # normal equations of the point with the least sum of squared distances to the lines, each with its weight
        point = np.linalg.solve(weighted.sum(axis=0), (weighted @ origins[:, :, None]).sum(axis=0))[:, 0]
        # 1 / distance turns squares into distances; `SOFT_MM` keeps a line through the point from taking all weight
        weight = 1 / np.maximum(_miss(point, origins, directions), SOFT_MM)
    return point


def _miss(point: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n,) distances of a point from lines."""
    return np.linalg.norm(np.cross(point - origins, directions), axis=1)


PARTNER = Gate("missing partner", 0.0, "photos missing", "take the same pose in the other variant")
"""A pair is the same object from the same pose with and without its patch; a single photograph is left out."""


@dataclass(frozen=True)
class CheckedPhoto:
    """A photograph with the results of its gates, or a finding of `check_set` on a photograph that may be missing.

    Attributes:
        lines: of sight to its patch; None without pose or patch.
        path: of the image, for people.
    """

    object: str
    variant: str
    pose_id: int | None
    results: tuple[GateResult, ...] = ()
    lines: PatchLines | None = None
    path: str = ""


def check_set(
    photos: Sequence[CheckedPhoto], sides_mm: Mapping[tuple[str, str], Sequence[float]] | None = None
) -> list[CheckedPhoto]:
    """Check pairs and patches over all photographs of a source.

    `sides_mm` has the side of the patch on each sheet as it should have been printed, by object and variant.
    """
    # partners, places and sizes are compared within an object
    by_object: dict[str, list[CheckedPhoto]] = defaultdict(list)
    for photo in photos:
        by_object[photo.object].append(photo)
    findings = []
    for name in sorted(by_object):
        findings += find_single_photos(name, by_object[name])
        findings += find_moved_patches(by_object[name])
        findings += find_wrong_sizes(by_object[name], sides_mm or {})
    return findings


def find_single_photos(name: str, photos: Sequence[CheckedPhoto]) -> list[CheckedPhoto]:
    """Find for each pose of an object whether it has both photographs of the pair."""
    poses = {
        variant: {photo.pose_id: photo for photo in photos if photo.variant == variant and photo.pose_id is not None}
        for variant in PAIR
    }
    findings = []
    # either half of the pair may lack the other
    for variant, other in (PAIR, PAIR[::-1]):
        for pose_id, photo in sorted(poses[variant].items(), key=lambda item: item[0] or 0):
            # a half that has not begun is no fault of the other's photographs
            if not poses[other]:
                result = PARTNER.skip(f"'{other}' has no photograph yet")
                findings.append(CheckedPhoto(name, variant, pose_id, (result,), path=photo.path))
            elif pose_id not in poses[other]:
                advice = f"take it: the {variant} photograph is there"
                findings.append(CheckedPhoto(name, other, pose_id, (PARTNER.judge(1, advice),)))
            # a whole pair is reported once, by its first half
            elif variant == PAIR[0]:
                findings.append(CheckedPhoto(name, variant, pose_id, (PARTNER.judge(0),), path=photo.path))
    for photo in photos:
        if photo.variant in PAIR and photo.pose_id is None:
            result = PARTNER.skip("its pose is not known")
            findings.append(CheckedPhoto(name, photo.variant, None, (result,), path=photo.path))
    return findings


def find_moved_patches(photos: Sequence[CheckedPhoto]) -> list[CheckedPhoto]:
    """Find for each photograph of an object how far its patch lies beside the others'; none without any patch."""
    findings = []
    # patches are compared within a variant: another sheet may lie elsewhere
    for variant in sorted({photo.variant for photo in photos if photo.lines is not None}):
        group = [photo for photo in photos if photo.variant == variant]
        seen = [(photo, photo.lines) for photo in group if photo.lines is not None]
        moves = dict(zip((id(photo) for photo, _ in seen), measure_moves([lines for _, lines in seen]), strict=True))
        for photo in group:
            move = moves.get(id(photo))
            if move is not None:
                beside = f"the patch, or the object on its board, lies {move:.0f} mm beside: {MOVED.advice}"
                result = MOVED.judge(move, beside)
            else:
                result = MOVED.skip(FEW_SIDES if photo.lines is not None else "no pose, or no patch is seen")
            findings.append(CheckedPhoto(photo.object, photo.variant, photo.pose_id, (result,), path=photo.path))
    return findings


def find_wrong_sizes(
    photos: Sequence[CheckedPhoto], sides_mm: Mapping[tuple[str, str], Sequence[float]]
) -> list[CheckedPhoto]:  # fmt: skip
    """Find for each variant of an object with a patch whether the patch has its size."""
    findings = []
    for key in sorted({(photo.object, photo.variant) for photo in photos if photo.lines is not None} & set(sides_mm)):
        group = [photo for photo in photos if (photo.object, photo.variant) == key]
        lines = [photo.lines for photo in group if photo.lines is not None]
        # each sheet has its own size
        for sheet, meant in enumerate(sides_mm[key]):
            which = f"sheet {sheet + 1}: " if len(sides_mm[key]) > 1 else ""
            side = measure_side(lines, sheet)
            if side is None:
                result = SIZE.skip(f"{which}{FEW_SIDES}")
            else:
                off = 100 * (side / meant - 1)
                found = f"{which}the patch measures {side:.1f} mm, {off:+.1f} % from the intended {meant:.1f} mm"
                result = SIZE.judge(abs(off), f"{found}: {SIZE.advice}")
            findings.append(CheckedPhoto(*key, None, (result,)))
    return findings
