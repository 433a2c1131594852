"""Where the sheet is stuck: a picture of that side of the object, and what a ruler measures on it."""

from dataclasses import dataclass

import numpy as np
from PIL import Image

from toolkit.captures.variants import Print
from toolkit.objects.load import TableObject
from toolkit.patches import TAPE_MARGIN_MM
from toolkit.printing.shot_list.views import DETAIL, encode_jpeg, make_light_studio
from toolkit.rig.camera import Camera, look_at, project
from toolkit.rig.finish import develop
from toolkit.rig.mount import SIDES, attach, mount_patch
from toolkit.rig.raycast import RaycastRenderer

LONG_SIDE_PX = 840
FINER = 2
AWAY = 60.0
"""Camera distance in object lengths: perspective then moves no line by more than about a millimetre."""
ROOM = 1.04


@dataclass(frozen=True)
class MountDrawing:
    """One side of an object, drawn to be measured; the drawing's axes are `right` and `up` as one sees that side.

    Attributes:
        jpeg: the picture, the object cut out on white.
        frame_mm: left, bottom, right, top of the picture, millimetres along right and up.
        object_mm: left, bottom, right, top of the object.
        extremes_mm: (4, 2) where the object reaches these.
        sheet_mm: the same of the cut sheet, with its white margin.
        outline_mm: (k, 2) the cut sheet's edge.
        patch_mm: (k, 2) the patch's edge.
        centre_mm, arrow_mm: (2,) the sheet's middle, and a unit step along the arrow that is printed on the page (on
            top) or towards the sheet's upper edge (on a side).
        size_mm, cut_mm: sides of patch and cut sheet on paper.
    """

    jpeg: bytes
    frame_mm: tuple[float, float, float, float]
    object_mm: tuple[float, float, float, float]
    extremes_mm: np.ndarray
    sheet_mm: tuple[float, float, float, float]
    outline_mm: np.ndarray
    patch_mm: np.ndarray
    centre_mm: np.ndarray
    arrow_mm: np.ndarray
    size_mm: float
    cut_mm: float

    @property
    def gaps_mm(self) -> tuple[float, float, float, float]:
        """From the object's outermost edge to the sheet's: left, bottom, right, top; negative where it hangs over."""
        a, b = self.object_mm, self.sheet_mm
        return b[0] - a[0], b[1] - a[1], a[2] - b[2], a[3] - b[3]


def draw_mounting(item: TableObject, booster: Print) -> MountDrawing:
    """The side of an object that its sheet is stuck on, with the sheet.

    Raises:
        ToolkitError: the sheet cannot be mounted there.
    """
    mount = item.spec.patch
    sheet = mount_patch(item.mesh, booster.pixels, booster.size_mm, mount, item.name)
    right, up = (np.array(axis, float) for axis in SIDES[mount.at])
    flat = np.stack([right, up], axis=1)
    half = len(sheet.mesh.vertices) // 2  # the printed face; the other half is the paper's back
    face = sheet.mesh.vertices[:half] @ flat
    cut_mm = booster.size_mm + 2 * TAPE_MARGIN_MM
    edge = np.concatenate([face[0::2], face[1::2][::-1]])
    patch = _inset(face, sheet.mesh.uv[:half], TAPE_MARGIN_MM / cut_mm)
    middle = face.mean(axis=0)
    axis = sheet.T_object_sheet[:3, 0 if mount.at == "top" else 1] @ flat
    body = item.mesh.vertices @ flat
    extremes = body[[body[:, 0].argmin(), body[:, 1].argmin(), body[:, 0].argmax(), body[:, 1].argmax()]]
    jpeg, frame = _photograph(item, sheet, right, up, np.concatenate([body, edge]))
    return MountDrawing(
        jpeg, frame, _box(body), extremes, _box(edge), edge, patch, middle,
        axis / max(float(np.linalg.norm(axis)), 1e-9), booster.size_mm, cut_mm,
    )  # fmt: skip


def _box(points: np.ndarray) -> tuple[float, float, float, float]:
    low, high = points.min(axis=0), points.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _inset(points: np.ndarray, uv: np.ndarray, inner: float) -> np.ndarray:
    """The rim of the patch, `inner` (share of the sheet's side) inside the sheet's, from its vertices (2k, 2).

    Vertices alternate between the sheet's two straight edges, k points along each.
    """
    first, second = points[0::2], points[1::2]
    # one of u and v runs along the bend, the other from one straight edge to the other
    run = uv[0::2][:, 0] if np.ptp(uv[0::2][:, 0]) > 0.5 else uv[0::2][:, 1]
    kept = np.concatenate([[inner], run[(run > inner) & (run < 1 - inner)], [1 - inner]])
    along = [np.stack([np.interp(kept, run, line[:, k]) for k in range(2)], axis=1) for line in (first, second)]
    low, high = along[0] + inner * (along[1] - along[0]), along[1] + inner * (along[0] - along[1])
    return np.concatenate([low, high[::-1]])


def _photograph(item: TableObject, sheet, right, up, points: np.ndarray):
    """The picture from far away, cut out on white, and its frame in millimetres."""
    normal = np.cross(right, up)
    low, high = points.min(axis=0), points.max(axis=0)
    size = (high - low) * ROOM
    centre = (low + high) / 2
    depth = float(normal @ np.sum(item.mesh.bounds, axis=0) / 2)
    target = right * centre[0] + up * centre[1] + normal * depth
    far = AWAY * float(item.mesh.size_mm.max())
    px_per_mm = LONG_SIDE_PX / float(size.max())
    width, height = (max(16, round(side * px_per_mm)) for side in size)
    fov = 2 * float(np.degrees(np.arctan(width / px_per_mm / 2 / far)))
    T_world_camera = look_at(target + normal * far, target)
    T_world_camera[:3, :3] = np.stack([right, -up, -normal], axis=1)
    fine = Camera(width * FINER, height * FINER, fov)
    renderer = RaycastRenderer(attach(item.mesh, sheet), make_light_studio(item, None), DETAIL)
    picture = develop(renderer.render(fine, T_world_camera), (0,), noise=0, falloff=0)
    outside = ~np.isfinite(renderer.buffers(fine, T_world_camera)["depth"])
    picture[outside] = 255
    small = np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.BOX))
    corners, _ = project(Camera(width, height, fov), T_world_camera, np.array([target, target + right, target + up]))
    scale = float(np.hypot(*(corners[1] - corners[0])))
    frame = (
        centre[0] - width / 2 / scale, centre[1] - height / 2 / scale,
        centre[0] + width / 2 / scale, centre[1] + height / 2 / scale,
    )  # fmt: skip
    return encode_jpeg(small, 90), tuple(float(side) for side in frame)
