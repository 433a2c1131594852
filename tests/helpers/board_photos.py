"""Photographs for the tests: the rig's own pictures of an object that stands on the printed board.

The camera is known exactly, so that what is measured from the picture can be compared with the truth. The board is
painted into the studio's table at true millimetres; `photograph` makes the picture, the other functions spoil it or
write it with metadata as a camera would.
"""

from dataclasses import replace
from datetime import datetime
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from toolkit.core.workspace import Workspace
from toolkit.imaging.colour import linear_to_srgb, srgb_to_linear
from toolkit.objects.load import load_object
from toolkit.objects.mesh import Mesh, place_on_table
from toolkit.rig.camera import Camera
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.scene import Scene, Table
from toolkit.rig.shading import tone_map
from toolkit.rig.studio import make_studio
from toolkit.rooms.photos.lens import FULL_FRAME_DIAGONAL_MM
from toolkit.rooms.worlds.content.modelling import assemble, box

QUICK = BakeDetail(key_rays=8, room_rays=32, surface_spacing=0.04, table_spacing=0.04)
INK, PAPER = 28, 236
PAPER_EDGE_MM = 9.0
"""White paper round the board."""
KEPT_SCENES = 6
_scenes: dict[tuple, RaycastRenderer] = {}


def photograph(
    subject: str | Mesh | None, board, camera: Camera, T_world_camera: np.ndarray, *, seed: int = 0,
    backdrop: str | None = None, light: str = "studio", px_per_mm: float = 3.0, noise: float = 0.006,
) -> np.ndarray:  # fmt: skip
    """(h, w, 3) uint8 sRGB picture of a subject on the board.

    Args:
        subject: name of a built-in object, a mesh in world millimetres, or None for the bare board.
        board: a `CharucoBoard` or `MarkerRing`; None for no board.
        camera: whose distortion and principal point the picture gets.
        T_world_camera: (4, 4).
        seed: of the table top and the sensor's noise.
        backdrop, light: as `make_studio` names them; the backdrop is what lies under the board.
        px_per_mm: of the painted table; at least the picture's own px per mm gives a crisp board.
        noise: as in `tone_map`.
    """
    renderer = _scene(subject, board, seed, backdrop, light, px_per_mm)
    if camera == Camera.from_focal_px(camera.width, camera.height, camera.fx):
        picture = renderer.render(camera, T_world_camera)
    else:
        wide = _camera_around(camera)
        picture = _through_lens(renderer.render(wide, T_world_camera), wide, camera)
    return tone_map(picture, (seed, int(np.abs(T_world_camera[:3, 3]).sum())), noise)


def object_mesh(name: str) -> Mesh:
    """A built-in object as it stands on the table."""
    return load_object(Workspace(Path("/nowhere")).object_spec(name)).mesh


def paint_table(board, seed: int, backdrop: str | None, px_per_mm: float, margin_mm: float = 150.0):
    """(picture, table_mm) of a table top with the board in its middle: FRONT of the page to +x, its right to +y."""
    studio = make_studio(seed, 100.0, backdrop)
    if board is None:
        return studio.table.picture, studio.table.size_mm
    page = board.paint(px_per_mm)  # rows run down the page, which is +x; columns to its right, +y
    page = np.pad(page, round(PAPER_EDGE_MM * px_per_mm), constant_values=255)
    sheet = np.rot90(page)  # in the table's picture x runs right and y up
    high, wide = sheet.shape
    margin = round(margin_mm * px_per_mm)
    # the margins are even on both sides, so that the sheet's middle is the picture's
    table = cv2.resize(studio.table.picture, (wide + 2 * margin, high + 2 * margin), interpolation=cv2.INTER_CUBIC)
    ink, paper = srgb_to_linear(np.array([INK, PAPER]) / 255)
    shades = linear_to_srgb(ink + srgb_to_linear(np.arange(256) / 255) * (paper - ink))
    table[margin : margin + high, margin : margin + wide] = (shades * 255).round().astype(np.uint8)[sheet][..., None]
    return table, ((wide + 2 * margin) / px_per_mm, (high + 2 * margin) / px_per_mm)


def _scene(subject, board, seed, backdrop, light, px_per_mm) -> RaycastRenderer:
    name = subject if isinstance(subject, str) or subject is None else id(subject)
    key = (name, board, seed, backdrop, light, px_per_mm)
    if key not in _scenes:
        while len(_scenes) >= KEPT_SCENES:
            del _scenes[next(iter(_scenes))]
        table, table_mm = paint_table(board, seed, backdrop, px_per_mm)
        mesh = _crumb(table_mm) if subject is None else object_mesh(subject) if isinstance(subject, str) else subject
        _scenes[key] = RaycastRenderer(mesh, _studio(seed, light, table, table_mm), QUICK)
    return _scenes[key]


def _studio(seed: int, light: str, table: np.ndarray, table_mm) -> Scene:
    # metered for paper, as a camera that looks at the board does
    studio = make_studio(seed, 100.0, "white", light)
    return replace(studio, table=Table(table, table_mm, studio.table.roughness))


def _crumb(table_mm: tuple[float, float]) -> Mesh:
    """What stands for no object: a tenth of a millimetre at the table's corner."""
    mesh = place_on_table(assemble(box((0.1, 0.1, 0.1)), {"paint": (0.8, 0.0)}, 16))
    corner = np.array([table_mm[0] / 2 - 1, table_mm[1] / 2 - 1, 0], np.float32)
    return replace(mesh, vertices=mesh.vertices + corner)


def _camera_around(lens: Camera) -> Camera:
    """A centred pinhole camera of the same focal length that sees all the lens sees."""
    across, down = np.linspace(0, lens.width, 33), np.linspace(0, lens.height, 33)
    edge = np.concatenate([
        np.stack([across, np.zeros(33)], 1), np.stack([across, np.full(33, lens.height)], 1),
        np.stack([np.zeros(33), down], 1), np.stack([np.full(33, lens.width), down], 1),
    ])  # fmt: skip
    reach = np.abs(lens.undistort(edge)).max(axis=0) * lens.fx + 4
    width, height = 2 * np.ceil(reach).astype(int)
    return Camera.from_focal_px(int(width), int(height), lens.fx)


def _through_lens(picture: np.ndarray, wide: Camera, lens: Camera) -> np.ndarray:
    x, y = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    rays = lens.undistort(np.stack([x, y], axis=-1).reshape(-1, 2))
    places = rays * wide.fx + [wide.width / 2 - 0.5, wide.height / 2 - 0.5]
    places = places.astype(np.float32).reshape(lens.height, lens.width, 2)
    return cv2.remap(picture, places[..., 0], places[..., 1], cv2.INTER_CUBIC).clip(0)


def blur(pixels: np.ndarray, sigma_px: float) -> np.ndarray:
    """Out of focus."""
    return cv2.GaussianBlur(pixels, (0, 0), sigma_px)


def shake(pixels: np.ndarray, length_px: int, angle_deg: float = 20.0) -> np.ndarray:
    """Moved during the exposure, along a straight line."""
    kernel = np.zeros((length_px, length_px), np.float32)
    middle = (length_px - 1) / 2
    for t in np.linspace(-middle, middle, 4 * length_px):
        x, y = middle + t * np.cos(np.radians(angle_deg)), middle - t * np.sin(np.radians(angle_deg))
        kernel[round(y), round(x)] += 1
    return cv2.filter2D(pixels, -1, kernel / kernel.sum())


def expose(pixels: np.ndarray, stops: float) -> np.ndarray:
    """Brighter (or darker) by so many stops, clipped at white as a sensor does."""
    return (linear_to_srgb(srgb_to_linear(pixels / 255) * 2.0**stops) * 255).round().clip(0, 255).astype(np.uint8)


def crop(pixels: np.ndarray, left: float, top: float, right: float, bottom: float) -> np.ndarray:
    """A part of the picture, its sides as shares of width and height."""
    h, w = pixels.shape[:2]
    return np.ascontiguousarray(pixels[round(top * h) : round(bottom * h), round(left * w) : round(right * w)])


def webcam(pixels: np.ndarray, seed: int = 0) -> np.ndarray:
    """As a cheap webcam in room light: soft, noisy in light and colour, sharpened, JPEG at quality 60."""
    rng = np.random.default_rng(seed)
    h, w = pixels.shape[:2]
    soft = cv2.GaussianBlur(pixels, (0, 0), 0.9).astype(np.float32)
    light = rng.normal(0, 9, (h, w, 1)).astype(np.float32)
    colour = cv2.resize(rng.normal(0, 9, (h // 3 + 1, w // 3 + 1, 3)).astype(np.float32), (w, h))
    noisy = soft + light + colour
    sharpened = noisy + 0.6 * (noisy - cv2.GaussianBlur(noisy, (0, 0), 1.5))
    return through_jpeg(sharpened.clip(0, 255).astype(np.uint8), 60)


def through_jpeg(pixels: np.ndarray, quality: int) -> np.ndarray:
    """What a JPEG of that quality leaves."""
    buffer = BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=quality)
    return np.asarray(Image.open(buffer))


def focal_35mm(camera: Camera) -> float:
    """The 35 mm-equivalent focal length that a camera writes, not rounded."""
    return camera.fx * FULL_FRAME_DIAGONAL_MM / float(np.hypot(camera.width, camera.height))


TURN_BACK = {1: 0, 3: 2, 6: 1, 8: 3}
"""Quarter turns counter-clockwise from the upright picture to the one stored under an EXIF orientation."""


def save_photo(
    path: Path, pixels: np.ndarray, *, focal_35mm_mm: float | None = None, focal_mm: float | None = None,
    taken: datetime | None = None, make: str = "Toolkit", model: str = "Pinhole One", orientation: int = 1,
    quality: int = 92,
) -> Path:  # fmt: skip
    """Write an upright picture as a camera does, by the file's suffix: JPEG, HEIC or PNG with EXIF.

    Args:
        path: `.jpg`, `.heic` or `.png`.
        pixels: (h, w, 3) uint8, upright.
        focal_35mm_mm, focal_mm: focal lengths to write; EXIF holds the first as a whole number.
        taken: time to write.
        make, model: the camera's name.
        orientation: EXIF's 1, 3, 6 or 8; the pixels are stored turned, so that obeying it makes them upright.
        quality: of JPEG and HEIC.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    image = Image.fromarray(np.ascontiguousarray(np.rot90(pixels, TURN_BACK[orientation])))
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0112] = make, model, orientation
    details = exif.get_ifd(0x8769)
    if focal_35mm_mm is not None:
        details[0xA405] = round(focal_35mm_mm)
    if focal_mm is not None:
        details[0x920A] = focal_mm
    if taken is not None:
        exif[0x0132] = details[0x9003] = taken.strftime("%Y:%m:%d %H:%M:%S")
    exif[0x8769] = dict(details)  # as Pillow before 11.1 needs it
    if path.suffix.lower() in (".heic", ".heif"):
        from pillow_heif import from_pillow

        from_pillow(image).save(path, quality=quality, exif=exif.tobytes())
    else:
        image.save(path, quality=quality, exif=exif, **({"subsampling": 0} if path.suffix == ".jpg" else {}))
    return path
