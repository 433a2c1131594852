"""A picture of the patch on training images, with what the network says under each."""

from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from toolkit.boosters.appearance import Appearance, show_patch
from toolkit.boosters.batches import cut_centres
from toolkit.boosters.training import Target
from toolkit.draws import Draws

if TYPE_CHECKING:
    import torch

COLUMNS, ROWS = 4, 4
CELL_PX, GAP_PX, CAPTION_PX, HEADER_PX = 224, 12, 26, 176
PAPER, INK, FAINT, RIGHT, WRONG = (255, 255, 255), (28, 30, 34), (110, 115, 122), (22, 130, 62), (190, 42, 36)


def draw_preview(
    patch: "torch.Tensor",
    images: "torch.Tensor",
    target: Target,
    appearance: Appearance,
    seed: int,
    image_px: int,
    title: str,
    lines: list[str],
) -> np.ndarray:
    """Draw sixteen images with the patch and the patch itself; (h, w, 3) uint8 sRGB.

    Args:
        patch: (3, n, n) in [0, 1].
        images: (k, 3, s, s) uint8 sRGB; they repeat, in other placements, when k is below sixteen.
        target: the network that labels them.
        appearance: as in training, drawn anew.
        seed: of the run.
        image_px: side of what the network sees.
        title: above, beside the patch.
        lines: smaller, below the title.
    """
    import torch

    which = torch.arange(COLUMNS * ROWS, device=images.device) % len(images)
    with torch.inference_mode():
        photos = show_patch(patch, cut_centres(images, image_px)[which], appearance, Draws(seed, 0, "preview"))
        chances = target.classifier.logits(photos).float().softmax(1).cpu()
    width = COLUMNS * (CELL_PX + GAP_PX) + GAP_PX
    sheet = Image.new("RGB", (width, HEADER_PX + ROWS * (CELL_PX + CAPTION_PX + GAP_PX) + GAP_PX), PAPER)
    _draw_header(sheet, _to_image(patch), title, lines)
    for k, (photo, chance) in enumerate(zip(photos, chances, strict=True)):
        row, column = divmod(k, COLUMNS)
        corner = (GAP_PX + column * (CELL_PX + GAP_PX), HEADER_PX + row * (CELL_PX + CAPTION_PX + GAP_PX))
        sheet.paste(_to_image(photo).resize((CELL_PX, CELL_PX), Image.Resampling.LANCZOS), corner)
        best = int(chance.argmax())
        colour = RIGHT if best == target.class_index else WRONG
        write_caption(sheet, corner, target.classifier.labels[best], float(chance[best]), colour)
    return np.asarray(sheet)


def _to_image(pixels: "torch.Tensor") -> Image.Image:
    return Image.fromarray((pixels.permute(1, 2, 0).cpu().numpy() * 255).round().astype(np.uint8))


def _font(size: int) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(size)


def _draw_header(sheet: Image.Image, patch: Image.Image, title: str, lines: list[str]) -> None:
    side = HEADER_PX - 2 * GAP_PX
    sheet.paste(patch.resize((side, side), Image.Resampling.NEAREST), (GAP_PX, GAP_PX))
    pen = ImageDraw.Draw(sheet)
    left = side + 2 * GAP_PX + 6
    pen.text((left, GAP_PX), title, INK, _font(30))
    for k, line in enumerate(lines):
        pen.text((left, GAP_PX + 46 + 26 * k), line, FAINT, _font(18))


def write_caption(
    sheet: Image.Image, corner: tuple[int, int], label: str, chance: float, colour, cell_px: int = CELL_PX
) -> None:
    """Write what a network says under the picture at `corner`, shortened to its width."""
    pen, font = ImageDraw.Draw(sheet), _font(17)
    percent = f" {chance:.0%}"
    text = label
    while pen.textlength(text + percent, font) > cell_px and len(text) > 4:
        text = text.removesuffix("...")[:-1].rstrip() + "..."
    pen.text((corner[0], corner[1] + cell_px + 3), text + percent, colour, font)
