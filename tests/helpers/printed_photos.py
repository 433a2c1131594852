"""Photographs of a printed page for the tests: printer, camera and scale are known, so that all has a truth."""

from io import BytesIO

import cv2
import numpy as np
from PIL import Image

from toolkit.core.workspace import PACKAGE_DATA
from toolkit.imaging.colour import linear_to_srgb, srgb_to_linear
from toolkit.imaging.printer import SOLIDS
from toolkit.objects.records import read_patch
from toolkit.printing.marks import STRIP

A4_MM = (210.0, 297.0)
PATCH_MM = 88.194
PATCH_CORNER_MM = (60.0, 70.0)
STRIP_CORNER_MM = (54.0, 190.0)
PX_PER_MM = 6
SIZE = (960, 1280)
TABLE = (0.10, 0.07, 0.045)


def shipped_patch(name: str) -> np.ndarray:
    """Pixels of a patch that comes with the kit."""
    return read_patch(PACKAGE_DATA / "patches" / f"{name}.png").pixels


def ink(encoded: np.ndarray, power: float = 1.7) -> np.ndarray:
    """Linear light as a share of paper's, where a printer mixes `SOLIDS` by Neugebauer's equation."""
    solids = srgb_to_linear(SOLIDS / SOLIDS[1, 1, 1]).astype(float)
    a = np.asarray(encoded, float)[..., None] ** power
    a = np.concatenate([1 - a, a], axis=-1)
    return np.einsum("...i,...j,...k,ijkc->...c", a[..., 0, :], a[..., 1, :], a[..., 2, :], solids)


def paint_page(patch: np.ndarray, scale: float = 1.0, printer=ink, with_strip: bool = True) -> np.ndarray:
    """(h, w, 3) linear light of an A4 page as shares of paper's, printed at `scale` of its size about its middle."""
    page = np.ones((round(A4_MM[1] * PX_PER_MM), round(A4_MM[0] * PX_PER_MM), 3), np.float32)

    def put(picture: np.ndarray, corner_mm: tuple[float, float], size_mm: tuple[float, float]) -> None:
        middle = np.array(A4_MM) / 2
        corner = (middle + scale * (np.array(corner_mm) - middle)) * PX_PER_MM
        step = scale * np.array(size_mm) * PX_PER_MM / np.array(picture.shape[1::-1])
        # every page pixel is an average of finer ones, so that edges lie where they should to a part of a pixel
        fine = 4
        left, top = np.floor(corner).astype(int)
        width, height = np.ceil(step * picture.shape[1::-1] + 1).astype(int)
        u = np.floor(((np.arange(width * fine) + 0.5) / fine + left - corner[0]) / step[0]).astype(int)
        v = np.floor(((np.arange(height * fine) + 0.5) / fine + top - corner[1]) / step[1]).astype(int)
        finely = np.pad(picture, ((1, 1), (1, 1), (0, 0)), constant_values=1.0)
        finely = finely[v.clip(-1, picture.shape[0])[:, None] + 1, u.clip(-1, picture.shape[1])[None] + 1]
        size = (int(width), int(height))
        page[top : top + height, left : left + width] = cv2.resize(finely, size, interpolation=cv2.INTER_AREA)

    put(printer(patch / 255.0), PATCH_CORNER_MM, (PATCH_MM, PATCH_MM))
    if with_strip:
        strip = printer(STRIP.paint(12, 0.0) / 255.0)
        put(strip, STRIP_CORNER_MM, STRIP.size_mm)
    return page


def photograph_page(
    page: np.ndarray, corners_px: np.ndarray, size: tuple[int, int] = SIZE, exposure: float = 0.8,
    light=(1.0, 0.97, 0.9), slope: float = 0.2, noise: float = 0.004, blur_px: float = 0.6, quality: int = 92,
    seed: int = 0,
) -> np.ndarray:  # fmt: skip
    """(h, w, 3) uint8 sRGB photo of a page (linear light) on a dark table.

    Args:
        page: from `paint_page`.
        corners_px: (4, 2) where its upper left, upper right, lower right and lower left corners go.
        size: width and height in pixels.
        exposure, light, slope: linear light of white paper in the middle, its tint, and how it falls across the photo.
        noise, blur_px, quality: of sensor, lens and JPEG.
        seed: of the noise.
    """
    h, w = page.shape[:2]
    source = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
    fine = 2
    T = cv2.getPerspectiveTransform(source, (np.asarray(corners_px) * fine).astype(np.float32))
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    sharp = cv2.GaussianBlur(page.astype(np.float32), (0, 0), 0.5)
    inked = cv2.warpPerspective(
        sharp, np.linalg.inv(half) @ T @ half, (size[0] * fine, size[1] * fine), flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=TABLE,
    )  # fmt: skip
    picture = cv2.GaussianBlur(cv2.resize(inked, size, interpolation=cv2.INTER_AREA), (0, 0), max(blur_px, 0.01))
    x = np.linspace(-0.5, 0.5, size[0])[None, :, None]
    picture = picture * exposure * np.array(light) * (1 + slope * x)
    grain = np.random.default_rng(seed).standard_normal(picture.shape)
    picture = picture + noise * np.sqrt(np.maximum(picture, 0.01)) * grain
    eight = np.round(linear_to_srgb(picture) * 255).astype(np.uint8)
    if not quality:
        return eight
    file = BytesIO()
    Image.fromarray(eight).save(file, "JPEG", quality=quality, subsampling=0)
    return np.asarray(Image.open(file))


def page_corners(tilt: float = 0.1, turn_deg: float = 4.0, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Corners of a page that fills most of a portrait photo, seen a little from one side."""
    height = 0.86 * size[1]
    width = height * A4_MM[0] / A4_MM[1]
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, height / 2]
    corners[:2, 0] *= 1 - tilt
    corners[:, 1] *= 1 - tilt / 3
    turn = np.radians(turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return corners @ rotation.T + np.array(size) / 2
