"""Pictures of the poses, and a drawing with millimetres of the place of each sheet."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from PIL import Image

from toolkit.core.console import Ticker
from toolkit.imaging.read import encode_image
from toolkit.objects.load import TableObject
from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.objects.spec import PatchMount
from toolkit.printing.canvas import BOLD, SHEET, SOFT, WHITE, Pdf, Point
from toolkit.printing.page import Rect
from toolkit.rig.applied.base import AppliedBooster
from toolkit.rig.board import Board
from toolkit.rig.camera import Camera, look_at, project
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.mount import SIDES, attach
from toolkit.rig.mount import MountedSheet as MountedSheet
from toolkit.rig.plan import Pose
from toolkit.rig.renderers import RAYCAST, make_renderer
from toolkit.rig.scene import Scene
from toolkit.rig.shading import tone_map
from toolkit.rig.studio import add_board, make_studio
from toolkit.rig.variants import apply_booster

WIDTH_PX = 416
"""250 dpi on a picture 42 mm wide."""
TABLE_SCALE = 1.6
"""The table is larger than the rig's own, so that few pictures show its end."""
JPEG_QUALITY = 85
BRIGHTER = 1.25
"""Factor on a photograph's exposure: printers darken, and white paper is white."""
DETAIL = BakeDetail(key_rays=16, room_rays=48, surface_spacing=0.026, table_spacing=0.022)


def make_light_studio(item: TableObject, board: Board | None) -> Scene:
    """A white table, which costs little ink, with the board painted on in true size."""
    studio = make_studio(0, TABLE_SCALE * float(item.mesh.size_mm.max()), backdrop="white")
    studio = replace(studio, exposure=BRIGHTER * studio.exposure)
    return studio if board is None else add_board(studio, board, px_per_mm=studio.need_table().px_per_mm)


def draw_views(
    item: TableObject, camera: Camera, poses: list[Pose], boosters: Mapping[str, AppliedBooster | None],
    board: Board | None, bar: Ticker,
) -> dict[tuple[str, int], bytes]:  # fmt: skip
    """JPEGs by (variant, pose id), as wide as `WIDTH_PX` and of the camera's aspect; a `bar` step each."""
    small = camera.scaled(WIDTH_PX, max(1, round(WIDTH_PX * camera.height / camera.width)))
    studio = make_light_studio(item, board)
    views = {}
    # each variant is lit once and seen from all poses
    for variant, booster in boosters.items():
        bar.advance(0, note=f"{item.name} {variant}: light")
        renderer = make_renderer(RAYCAST, apply_booster(item, booster), studio, DETAIL)
        lights = renderer.render_many((small, pose.matrix()) for pose in poses)
        for pose, light in zip(poses, lights, strict=True):
            # no noise and no vignette: the card is to be compared with, not to look like a photograph
            picture = tone_map(light, (0, pose.id), noise=0, falloff=0)
            views[variant, pose.id] = encode_jpeg(picture)
            bar.advance(note=f"{item.name} {variant}")
    return views


def encode_jpeg(pixels: np.ndarray, quality: int = JPEG_QUALITY) -> bytes:
    """JPEG bytes of (h, w, 3) uint8 sRGB pixels."""
    return encode_image(pixels, "JPEG", quality=quality, optimize=True)


LONG_SIDE_PX = 840
FINER = 2
AWAY = 60.0
"""Camera distance in object lengths: perspective then moves no line by more than about a millimetre."""
ROOM = 1.04


@dataclass(frozen=True)
class MountDrawing:
    """A side of an object, drawn to be measured; the drawing's axes are `right` and `up`, seen from outside.

    Attributes:
        jpeg: the picture, the object cut out on white.
        frame_mm: left, bottom, right, top of the picture.
        object_mm: left, bottom, right, top of the object.
        extremes_mm: (4, 2) points of the object there.
        sheet_mm: left, bottom, right, top of the cut sheet, with its white margin.
        outline_mm: (k, 2) the cut sheet's edge.
        patch_mm: (k, 2) the patch's edge.
        centre_mm: (2,) the sheet's middle.
        arrow_mm: (2,) a unit step along the page's arrow (on top) or towards the sheet's upper edge (on a side).
        size_mm: side of the patch on paper, and `cut_mm` of the cut sheet.
        mount: of the object's spec.
        number: of the sheet, from 1 to `count`.
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
    mount: PatchMount
    number: int
    count: int

    @property
    def gaps_mm(self) -> tuple[float, float, float, float]:
        """From the object's outermost edge to the sheet's: left, bottom, right, top; negative if it hangs over."""
        a, b = self.object_mm, self.sheet_mm
        return b[0] - a[0], b[1] - a[1], a[2] - b[2], a[3] - b[3]


def draw_mountings(item: TableObject, booster: AppliedBooster) -> list[MountDrawing]:
    """Draw for each sheet of an object its side, with all sheets; a `ToolkitError` if a sheet cannot be mounted."""
    sheets = booster.sheets(item)
    return [_draw_mounting(item, sheets, index) for index in range(len(sheets))]


def _draw_mounting(item: TableObject, sheets: Sequence[MountedSheet], index: int) -> MountDrawing:
    mount, sheet = item.spec.mounts[index], sheets[index]
    right, up = (np.array(axis, float) for axis in SIDES[mount.at])
    flat = np.stack([right, up], axis=1)
    half = len(sheet.mesh.vertices) // 2  # the printed face; the other half is the paper's back
    face = sheet.mesh.vertices[:half] @ flat
    cut_mm = sheet.size_mm + 2 * TAPE_MARGIN_MM
    # along a straight edge and back along the other: the outline of the sheet's face
    edge = np.concatenate([face[0::2], face[1::2][::-1]])
    patch = _inset(face, sheet.mesh.uv[:half], TAPE_MARGIN_MM / cut_mm)
    middle = face.mean(axis=0)
    # on top the page's arrow runs along the sheet's u, on a side its upper edge is v
    axis = sheet.T_object_sheet[:3, 0 if mount.at == "top" else 1] @ flat
    body = item.mesh.vertices @ flat
    extremes = body[[body[:, 0].argmin(), body[:, 1].argmin(), body[:, 0].argmax(), body[:, 1].argmax()]]
    jpeg, frame = _photograph(item, sheets, right, up, np.concatenate([body, edge]))
    return MountDrawing(
        jpeg, frame, _box(body), extremes, _box(edge), outline_mm=edge, patch_mm=patch, centre_mm=middle,
        arrow_mm=axis / max(float(np.linalg.norm(axis)), 1e-9), size_mm=sheet.size_mm, cut_mm=cut_mm,
        mount=mount, number=index + 1, count=len(sheets),
    )  # fmt: skip


def _box(points: np.ndarray) -> tuple[float, float, float, float]:
    low, high = points.min(axis=0), points.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _inset(points: np.ndarray, uv: np.ndarray, inner: float) -> np.ndarray:
    """The rim of the patch, `inner` (share of the sheet's side) inside the sheet's, from its vertices (2k, 2).

    Vertices alternate between the sheet's two straight edges, k points along each.
    """
    first, second = points[0::2], points[1::2]
    # u or v runs along the bend, the other between the straight edges
    run = uv[0::2][:, 0] if np.ptp(uv[0::2][:, 0]) > 0.5 else uv[0::2][:, 1]
    # the patch's rim is bent as the sheet is: points between the sheet's own vertices are interpolated
    kept = np.concatenate([[inner], run[(run > inner) & (run < 1 - inner)], [1 - inner]])
    along = [np.stack([np.interp(kept, run, line[:, k]) for k in range(2)], axis=1) for line in (first, second)]
    low, high = along[0] + inner * (along[1] - along[0]), along[1] + inner * (along[0] - along[1])
    return np.concatenate([low, high[::-1]])


def _photograph(
    item: TableObject, sheets: Sequence[MountedSheet], right: np.ndarray, up: np.ndarray, points: np.ndarray
) -> tuple[bytes, tuple[float, float, float, float]]:
    """The picture from far away, cut out on white, and its frame in millimetres."""
    normal = np.cross(right, up)
    low, high = points.min(axis=0), points.max(axis=0)
    size = (high - low) * ROOM
    centre = (low + high) / 2
    depth = float(normal @ np.sum(item.mesh.bounds, axis=0) / 2)
    target = right * centre[0] + up * centre[1] + normal * depth
    # so far away that the picture is a plan: perspective moves nothing by a visible length
    far = AWAY * float(item.mesh.size_mm.max())
    px_per_mm = LONG_SIDE_PX / float(size.max())
    width, height = (max(16, round(side * px_per_mm)) for side in size)
    fov = 2 * float(np.degrees(np.arctan(width / px_per_mm / 2 / far)))
    T_world_camera = look_at(target + normal * far, target)
    # the drawing's own axes: for a view straight down `look_at` has any azimuth to choose from
    T_world_camera[:3, :3] = np.stack([right, -up, -normal], axis=1)
    fine = Camera.from_fov(width * FINER, height * FINER, fov)
    renderer = make_renderer(RAYCAST, attach(item.mesh, *sheets), make_light_studio(item, None), DETAIL)
    picture = tone_map(renderer.render(fine, T_world_camera), (0,), noise=0, falloff=0)
    # only the object stays: its table would hide where it ends
    outside = ~np.isfinite(renderer.buffers(fine, T_world_camera)["depth"])
    picture[outside] = 255
    small = np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.BOX))
    # the scale is that of a millimetre at the target, as the camera projects it
    places = np.array([target, target + right, target + up])
    corners, _ = project(Camera.from_fov(width, height, fov), T_world_camera, places)
    scale = float(np.hypot(*(corners[1] - corners[0])))
    x, y, half_width, half_height = float(centre[0]), float(centre[1]), width / 2 / scale, height / 2 / scale
    return encode_jpeg(small, 90), (x - half_width, y - half_height, x + half_width, y + half_height)


ToPage = Callable[[Sequence[float] | np.ndarray], Point]
"""Millimetres on the object's side -> millimetres on the page."""
CHAINS_MM = 18.0
"""Room beside and below the picture for its dimensions, and above it for the title."""


def draw_mounting_plan(pdf: Pdf, area: Rect, drawing: MountDrawing) -> None:
    """Draw the object's side with the sheet's outline, its distances from the object's edges, and its arrow."""
    side = drawing.mount.at
    seen = {"top": "seen from above", "back": "seen from behind"}.get(side, f"seen from the {side}")
    which = "the patch" if drawing.count == 1 else f"sheet {drawing.number} of {drawing.count}"
    pdf.heading(area, f"Where {which} goes, {seen}")
    left, bottom, right, top = drawing.frame_mm
    room = Rect(area.x + 9.0, area.y + 8.0, area.width - CHAINS_MM, area.height - CHAINS_MM + 2)
    # as large as the room allows, with a margin for the chains of measures on two sides
    scale = min(room.width / (right - left), room.height / (top - bottom))
    picture = room.centre((right - left) * scale, (top - bottom) * scale)
    pdf.picture(drawing.jpeg, picture, None)

    def at(point: Sequence[float] | np.ndarray) -> Point:
        return picture.x + (float(point[0]) - left) * scale, picture.y + (float(point[1]) - bottom) * scale

    # white below the line: it is seen on any paint
    for colour, line in ((WHITE, 0.9), (SHEET, 0.45)):
        pdf.ink(colour, line)
        pdf.shape([at(p) for p in drawing.outline_mm], fill=False)
    pdf.setDash(1.0, 0.8)
    pdf.setLineWidth(0.2)
    pdf.shape([at(p) for p in drawing.patch_mm], fill=False)
    pdf.setDash()
    # across the sheet's middle to where the page's arrow, or its upper edge, must point
    reach = 0.34 * drawing.size_mm * drawing.arrow_mm
    pdf.block_arrow(at(drawing.centre_mm - reach), at(drawing.centre_mm + reach), 2.6, SHEET)
    _draw_chains(pdf, at, picture, drawing)
    if side == "top":
        y = picture.y + picture.height / 2 - 1
        pdf.write("front", picture.right + 0.6, y, 2.8, room_mm=9, font=BOLD, colour=SOFT)


def _draw_chains(pdf: Pdf, at: ToPage, picture: Rect, drawing: MountDrawing) -> None:
    """Draw chains of dimensions below and on the left: edge of the object, sheet, other edge."""
    b, gaps = drawing.sheet_mm, drawing.gaps_mm
    left, low, right, high = drawing.extremes_mm
    level, upright = picture.y - 4.5, picture.x - 4.5
    corner = (b[0], b[1])
    below = [at(point) for point in (left, corner, (b[2], b[1]), right)]
    beside = [at(point) for point in (low, corner, (b[0], b[3]), high)]
    _draw_chain(pdf, below, [(x, level) for x, _ in below], (0, -1), (gaps[0], b[2] - b[0], gaps[2]))
    _draw_chain(pdf, beside, [(upright, y) for _, y in beside], (-1, 0), (gaps[1], b[3] - b[1], gaps[3]))


def _draw_chain(
    pdf: Pdf, corners: Sequence[Point], places: Sequence[Point], way: Point, lengths: Sequence[float]
) -> None:
    """Draw dashed lines from corners to their places on the chain, and the dimensions between these."""
    for corner, (x, y) in zip(corners, places, strict=True):
        pdf.ink(SOFT, 0.12)
        pdf.setDash(0.5, 0.6)
        pdf.line(*corner, x + way[0], y + way[1])
        pdf.setDash()
    for (start, end), mm in zip(pairwise(places), lengths, strict=True):
        # below half a millimetre a ruler shows nothing
        pdf.dimension(start, end, f"{mm:.0f}" if mm >= 0.5 else (f"over {-mm:.0f}" if mm <= -0.5 else "0"))
