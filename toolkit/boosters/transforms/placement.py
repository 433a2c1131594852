"""Random placements of a flat square in a photograph: affine, as of a sheet on an object, as in the paper's release.

Convention: continuous coordinates, x right and y down, pixel (row i, column j) covers [j, j+1] × [i, i+1], so that
centres are at half integers. `T_image_patch` maps patch texels, [0, n]², to image pixels, [0, m]². Poses have the
world, camera axes and `T_world_camera` of `toolkit.rig.camera`; the sheet's up is the object's front (+x), its right
the object's right (-y), as `toolkit.rig.mount` tapes it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from toolkit.boosters.transforms import Placer, Probability, Transform
from toolkit.core.config import Expect, Flag, Range, Rising
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.lazy import cv2, np
from toolkit.objects.spec import printed_size_mm

if TYPE_CHECKING:
    from toolkit.rig.camera import Camera

WHERE = "Where the patch lies"


class AffineRanges(Transform):
    """What is drawn, uniformly, for each image.

    The defaults span what the rig shows of an 88 mm patch on a 270 mm object that fills 60 % of the frame, seen from
    20-65° above: 45-95 px in the 224 px crop before foreshortening.
    """

    stage = "place"
    rotation_deg: Annotated[Range, Rising(-360, 360), Flag("--rotation", group=WHERE)] = Field(
        (-180.0, 180.0), description="Smallest and largest rotation of the patch, degrees, clockwise."
    )
    share: Annotated[Range, Rising(0.02, 2), Flag(group=WHERE)] = Field(
        (0.20, 0.42),
        description="Smallest and largest side of the patch, as a share of the image's, before foreshortening.",
    )
    foreshortening: Annotated[Range, Rising(0.05, 1), Flag(group=WHERE)] = Field(
        (0.35, 1.0), description="How much an oblique view narrows the patch; 1 is not at all."
    )
    overhang: Annotated[float, Field(ge=0, lt=0.5)] = Field(
        0.1, description="Share of the placed square's bounding box that may reach over the image's edge."
    )

    def place(self, rng: "np.random.Generator", count: int, patch_px: int, image_px: int) -> "np.ndarray":
        """Draw `count` placements; (count, 3, 3) float64 `T_image_patch`."""
        rotation = np.radians(rng.uniform(*self.rotation_deg, count))
        scale = rng.uniform(*self.share, count) * image_px / patch_px
        compression = rng.uniform(*self.foreshortening, count)
        # a half turn is enough: narrowing along a direction and along its opposite is the same
        direction = rng.uniform(0, np.pi, count)
        # turned first, then narrowed: the camera's slant does not turn with the sheet
        linear = _compress(direction, compression) @ _rotate(rotation) * scale[:, None, None]
        centre = _draw_centres(rng, linear, patch_px, image_px, self.overhang)
        return affine_matrices(linear, centre, patch_px)


def affine_matrices(linear: "np.ndarray", centre: "np.ndarray", patch_px: int) -> "np.ndarray":
    """Join (b, 2, 2) linear parts with where the patch's centre goes, (b, 2) image pixels, into (b, 3, 3) matrices."""
    matrices = np.zeros((len(linear), 3, 3))
    matrices[:, :2, :2] = linear
    matrices[:, :2, 2] = centre - linear @ np.full(2, patch_px / 2)
    matrices[:, 2, 2] = 1
    return matrices


def _rotate(angle: "np.ndarray") -> "np.ndarray":
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)


def _compress(direction: "np.ndarray", length: "np.ndarray") -> "np.ndarray":
    """Scale by `length` along `direction`, leave what is perpendicular to it."""
    along = np.stack([np.cos(direction), np.sin(direction)], -1)
    return np.eye(2) - (1 - length)[:, None, None] * along[:, :, None] * along[:, None, :]


def _draw_centres(
    rng: "np.random.Generator", linear: "np.ndarray", patch_px: int, image_px: int, overhang: float
) -> "np.ndarray":
    # a linear map's box reaches the sum of its absolute entries to either side
    half_box = np.abs(linear).sum(axis=2) * patch_px / 2
    reach = np.maximum(image_px / 2 - half_box * (1 - 2 * overhang), 0)  # a square too large for the frame is centred
    return image_px / 2 + rng.uniform(-1, 1, reach.shape) * reach


class Placement(Transform):
    """Ranges of the random affine placement, drawn uniformly; the defaults are those of the paper's release."""

    stage = "place"
    rotation_deg: Annotated[
        float, Field(ge=0, le=180), Expect("0 to 180 degrees"), Flag("--max-rotation", metavar="DEGREES")
    ] = Field(45.0, description="Largest rotation of a patch in either direction, degrees.")
    scale: Annotated[Range, Rising(0.1, 2), Flag("--patch-scale")] = Field(
        (0.9, 1.1), description="Smallest and largest side of the placed patch, as a multiple of its own pixels."
    )
    translate: Annotated[float, Field(ge=0, le=0.5), Expect("0 to 0.5 of the image's side"), Flag()] = Field(
        0.3,
        description="Largest move from the middle along each axis, as a share of the image's side; the patch "
        "may be cut off.",
    )

    def place(self, rng: "np.random.Generator", count: int, patch_px: int, image_px: int) -> "np.ndarray":
        """Draw `count` placements; (count, 3, 3) float64 `T_image_patch`."""
        # by seeds, so that a set of patches of several sizes can be laid alike
        return self.place_seeded(rng.integers(2**63, size=count).tolist(), patch_px, image_px)

    def place_seeded(self, seeds: Sequence[int], patch_px: int, image_px: int) -> "np.ndarray":
        """(b, 3, 3) `T_image_patch`, each by its seed alone, which turns and moves a patch of any size alike."""
        drawn = np.array([np.random.default_rng(seed).uniform(-1, 1, 4) for seed in seeds]).reshape(-1, 4)
        # four draws in [-1, 1]: turn, size, and place along both axes
        angle = np.radians(self.rotation_deg) * drawn[:, 0]
        low, high = self.scale
        scale = low + (high - low) * (drawn[:, 1] + 1) / 2
        cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
        linear = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)
        return affine_matrices(linear, image_px * (0.5 + self.translate * drawn[:, 2:]), patch_px)


STEEPEST_TILT_DEG = 80.0
GRAZING_DEG = 12.0
"""A sheet seen at less than this shows nothing: such a draw is made again."""
TRIES = 200


class PoseRanges(Transform):
    """What is drawn, uniformly, for each image; the poses of a plan have no part in it.

    The object is a box whose longest side is `length_mm`. The camera stands where the box, sheet and all, reaches
    across `fill` of the image. A sheet on a wall is seen under the same angles, another way up.
    """

    stage = "place"
    size_mm: Annotated[float, Field(gt=0)] = Field(printed_size_mm(100), description="Side of the printed patch.")
    length_mm: Annotated[float, Field(gt=0), Flag(group=WHERE)] = Field(
        270.0, description="Longest side of that object: how large the patch looks on it."
    )
    width: Annotated[Range, Rising(0.02, 1)] = Field((0.4, 1.0), description="Of the object, share of its length.")
    height: Annotated[Range, Rising(0, 1)] = Field((0.15, 0.8), description="Of the object, share of its length.")
    offset: Annotated[float, Field(ge=0, le=0.5)] = Field(
        0.15, description="Of the sheet from the middle of the top, along and across, share of its length and width."
    )
    tilt_deg: Annotated[Range, Rising(0, STEEPEST_TILT_DEG)] = Field(
        (0.0, 10.0), description="Slope of the place where the sheet is taped, in any direction."
    )
    azimuth_deg: Annotated[Range, Rising(-360, 360)] = Field(
        (0.0, 360.0), description="Around the object, 0 looks at its front."
    )
    elevation_deg: Annotated[Range, Rising(GRAZING_DEG, 90)] = Field((20.0, 80.0), description="Above the table.")
    roll_deg: Annotated[Range, Rising(-180, 180)] = Field((-12.0, 12.0), description="Of the camera.")
    fill: Annotated[Range, Rising(0.05, 0.95)] = Field(
        (0.5, 0.95), description="Size of the object, as a share of the image's side."
    )
    fov_deg: Annotated[Range, Rising(1, 100)] = Field(
        (20.0, 60.0), description="Angle of view across the image; wide ones foreshorten more."
    )
    probability: Probability = Field(0.5, description="That an image's placement is drawn here, and not affine.")

    @model_validator(mode="after")
    def _check_size(self) -> "PoseRanges":
        if self.size_mm > self.length_mm:
            raise FieldError(
                f"expected no less than the patch on it, {self.size_mm:.1f} mm",
                {"length_mm": self.length_mm},
            )
        return self

    def place(self, rng: "np.random.Generator", count: int, patch_px: int, image_px: int) -> "np.ndarray":
        """Draw `count` placements; (count, 3, 3) float64 projective `T_image_patch`."""
        placed = [self._place_one(rng, patch_px, image_px) for _ in range(count)]
        # np.stack refuses an empty list
        return np.stack(placed) if placed else np.zeros((0, 3, 3))

    def _place_one(self, rng: "np.random.Generator", patch_px: int, image_px: int) -> "np.ndarray":
        for _ in range(TRIES):
            if (T_image_patch := self._try_one(rng, patch_px, image_px)) is not None:
                return T_image_patch
        raise ToolkitError(
            f"pose: no camera sees the sheet at more than {GRAZING_DEG:g}° in {TRIES} draws: expected higher "
            "elevations, a lower object or less tilt"
        )

    def _try_one(self, rng: "np.random.Generator", patch_px: int, image_px: int) -> "np.ndarray | None":
        from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose

        azimuth, elevation = rng.uniform(*self.azimuth_deg), rng.uniform(*self.elevation_deg)
        roll, fill = rng.uniform(*self.roll_deg), rng.uniform(*self.fill)
        camera = Camera.from_fov(image_px, image_px, rng.uniform(*self.fov_deg))
        box = self.length_mm * np.array([1, rng.uniform(*self.width), rng.uniform(*self.height)])
        sheet = draw_sheet(rng, box, self.size_mm, self.offset, rng.uniform(*self.tilt_deg))
        middle = np.array([0, 0, box[2] / 2])
        # the sheet may reach over the box: both have to be in the frame
        points = np.concatenate([box_corners(box), sheet.corners])
        distance = distance_to_fill(camera, points, middle, azimuth, elevation, fill, roll)
        T_world_camera = orbit_pose(middle, azimuth, elevation, distance, roll)
        if angle_above(sheet, T_world_camera[:3, 3]) < GRAZING_DEG:
            return None
        T_image_patch = project_sheet(camera, T_world_camera, sheet, patch_px)
        # as far as the frame has room beside the object
        return shift_image(T_image_patch, rng.uniform(-1, 1, 2) * (1 - fill) * image_px / 2)


@dataclass(frozen=True)
class Sheet:
    """A square in the world, millimetres.

    Attributes:
        middle: (3,) of its centre.
        right, up: (3,) unit vectors along its sides, as seen from the front.
        size_mm: its side.
    """

    middle: "np.ndarray"
    right: "np.ndarray"
    up: "np.ndarray"
    size_mm: float

    @property
    def corners(self) -> "np.ndarray":
        """(4, 3)."""
        signs = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * self.size_mm / 2
        return self.middle + signs[:, :1] * self.right + signs[:, 1:] * self.up


def draw_sheet(
    rng: "np.random.Generator", box_mm: "np.ndarray", size_mm: float, offset: float, tilt_deg: float
) -> Sheet:
    """A sheet somewhere on top of a box, on a slope of `tilt_deg` in any direction."""
    axis = rng.uniform(0, 2 * np.pi)
    # about an axis that lies in the top: it slopes in any direction and does not turn the sheet
    tilt = cv2.Rodrigues(np.radians(tilt_deg) * np.array([np.cos(axis), np.sin(axis), 0.0]))[0]
    place = rng.uniform(-offset, offset, 2) * box_mm[:2]
    return Sheet(np.array([*place, box_mm[2]]), tilt @ [0.0, -1.0, 0.0], tilt @ [1.0, 0.0, 0.0], size_mm)


def angle_above(sheet: Sheet, position_mm: "np.ndarray") -> float:
    """Degrees at which a camera stands above a sheet's plane, as its middle sees it; negative behind it."""
    view = (position_mm - sheet.middle) / np.linalg.norm(position_mm - sheet.middle)
    return float(np.degrees(np.arcsin(np.cross(sheet.right, sheet.up) @ view)))


def box_corners(box_mm: "np.ndarray") -> "np.ndarray":
    """(8, 3) of a box that stands on the table in the middle of the world."""
    signs = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [0, 1], indexing="ij"), -1).reshape(8, 3)
    return signs * box_mm


def project_sheet(camera: "Camera", T_world_camera: "np.ndarray", sheet: Sheet, patch_px: int) -> "np.ndarray":
    """(3, 3) `T_image_patch` of a sheet before a pinhole camera, scaled so that its centre has w = 1."""
    texel_mm = sheet.size_mm / patch_px
    # texel (0, 0) is at the top left of the sheet as seen from the front
    corner = sheet.middle + sheet.size_mm / 2 * (sheet.up - sheet.right)
    # columns: a step of a texel right and down, and where texel (0, 0) lies, all seen from the camera
    plane = np.stack([sheet.right * texel_mm, -sheet.up * texel_mm, corner - T_world_camera[:3, 3]], axis=1)
    T_image_patch = camera.matrix @ T_world_camera[:3, :3].T @ plane
    return T_image_patch / (T_image_patch[2] @ [patch_px / 2, patch_px / 2, 1])


def shift_image(T_image_patch: "np.ndarray", shift_px: "np.ndarray") -> "np.ndarray":
    """Move what is seen by (right, down) pixels: the object is not always in the middle."""
    T_shift = np.eye(3)
    T_shift[:2, 2] = shift_px
    return T_shift @ T_image_patch


@dataclass(frozen=True)
class MixedPlacement:
    """Each image's placement is drawn from a camera pose with the poses' probability, else affine.

    Attributes:
        poses: `PoseRanges`, or its like with a probability.
        others: any placement.
    """

    poses: PoseRanges
    others: Placer

    def place(self, rng: "np.random.Generator", count: int, patch_px: int, image_px: int) -> "np.ndarray":
        """Draw `count` placements; (count, 3, 3) float64 `T_image_patch`."""
        posed = rng.random(count) < self.poses.probability
        placed = np.empty((count, 3, 3))
        placed[posed] = self.poses.place(rng, int(posed.sum()), patch_px, image_px)
        placed[~posed] = self.others.place(rng, int((~posed).sum()), patch_px, image_px)
        return placed
