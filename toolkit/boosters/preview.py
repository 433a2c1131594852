"""Pictures of a booster on what it was trained for, each with the network's first answer below it."""

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from toolkit.boosters.pixels import Target
from toolkit.core.files import write_bytes

if TYPE_CHECKING:
    import torch

COLUMNS, ROWS = 4, 4
PHOTO_PX, GAP_PX, CAPTION_PX, HEADER_PX = 224, 12, 26, 176
PAPER, INK, FAINT, RIGHT, WRONG = (255, 255, 255), (28, 30, 34), (110, 115, 122), (22, 130, 62), (190, 42, 36)


def draw_patch_preview(
    patch: np.ndarray, photos: "torch.Tensor", target: Target, title: str, lines: list[str]
) -> np.ndarray:
    """Draw sixteen photographs with the patch and the patch itself; (h, w, 3) uint8 sRGB.

    Args:
        patch: (n, n, 3) uint8 sRGB.
        photos: (16, 3, m, m) sRGB-encoded in [0, 1].
        target: the network that labels them.
        title: above, beside the patch.
        lines: smaller, below the title.
    """
    width = COLUMNS * (PHOTO_PX + GAP_PX) + GAP_PX
    sheet = Image.new("RGB", (width, HEADER_PX + ROWS * (PHOTO_PX + CAPTION_PX + GAP_PX) + GAP_PX), PAPER)
    _draw_header(sheet, Image.fromarray(patch), title, lines)
    _draw_photos(sheet, photos, target, HEADER_PX, GAP_PX, PHOTO_PX)
    return np.asarray(sheet)


TURNTABLE_GAP_PX = 8


def draw_turntable(photos: "torch.Tensor", target: Target) -> np.ndarray:
    """(h, w, 3) uint8 sRGB: views (k, 3, s, s) sRGB-encoded in [0, 1] of the objects, as large as they are."""
    side, gap = photos.shape[-1], TURNTABLE_GAP_PX
    rows = -(-len(photos) // COLUMNS)
    size = (COLUMNS * (side + gap) + gap, rows * (side + CAPTION_PX + gap) + gap)
    sheet = Image.new("RGB", size, PAPER)
    _draw_photos(sheet, photos, target, gap, gap, side)
    return np.asarray(sheet)


def write_preview(file: Path, sheet: np.ndarray) -> None:
    """Write a picture (h, w, 3) uint8 sRGB as PNG."""
    buffer = BytesIO()
    Image.fromarray(sheet).save(buffer, "PNG")  # without the slow search for the smallest file that a patch is worth
    write_bytes(file, buffer.getvalue())


def _draw_photos(
    sheet: Image.Image, photos: "torch.Tensor", target: Target, top_px: int, gap_px: int, side_px: int
) -> None:
    import torch

    with torch.inference_mode():
        chances = target.classifier.logits(photos).float().softmax(1).cpu()
    for k, (photo, chance) in enumerate(zip(photos, chances, strict=True)):
        row, column = divmod(k, COLUMNS)
        corner = (gap_px + column * (side_px + gap_px), top_px + row * (side_px + CAPTION_PX + gap_px))
        picture = Image.fromarray((photo.permute(1, 2, 0).cpu().numpy() * 255).round().astype(np.uint8))
        if picture.width != side_px:
            picture = picture.resize((side_px, side_px), Image.Resampling.LANCZOS)
        sheet.paste(picture, corner)
        best = int(chance.argmax())
        colour = RIGHT if best == target.class_index else WRONG
        caption = _shorten(target.classifier.labels[best], f" {float(chance[best]):.0%}", side_px)
        ImageDraw.Draw(sheet).text((corner[0], corner[1] + side_px + 3), caption, colour, _font(17))


def _shorten(label: str, percent: str, width_px: int) -> str:
    pen, font = ImageDraw.Draw(Image.new("RGB", (1, 1))), _font(17)
    text = label
    # the percentage stays whole; the label is what may be cut
    while pen.textlength(text + percent, font) > width_px and len(text) > 4:
        text = text.removesuffix("...")[:-1].rstrip() + "..."
    return text + percent


def _font(size: int) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(size)


def _draw_header(sheet: Image.Image, patch: Image.Image, title: str, lines: list[str]) -> None:
    side = HEADER_PX - 2 * GAP_PX
    # nearest: texels are shown as they are printed, with sharp edges
    sheet.paste(patch.resize((side, side), Image.Resampling.NEAREST), (GAP_PX, GAP_PX))
    pen = ImageDraw.Draw(sheet)
    left = side + 2 * GAP_PX + 6
    pen.text((left, GAP_PX), title, INK, _font(30))
    for k, line in enumerate(lines):
        pen.text((left, GAP_PX + 46 + 26 * k), line, FAINT, _font(18))
