"""A figure of the procedural kinds that rig18 was trained on: one random instance of each."""

from PIL import Image, ImageDraw, ImageFont

from toolkit.objects.shapes.everyday import MAKERS, make_everyday
from toolkit.rig.camera import Camera
from toolkit.rig.views import render_thumbnails

COLUMNS, CELL_PX, CAPTION_PX = 9, 150, 22
SEED = 20_000
"""Far from the seeds of the training set."""


def draw_everyday(font: ImageFont.FreeTypeFont) -> Image.Image:
    """All kinds, in the order of their labels, from random poses as in training."""
    rows = -(-len(MAKERS) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * CELL_PX, rows * (CELL_PX + CAPTION_PX)), "white")
    draw = ImageDraw.Draw(sheet)
    camera = Camera.from_fov(CELL_PX, CELL_PX, 40.0)
    for i, label in enumerate(sorted(MAKERS)):
        left, top = i % COLUMNS * CELL_PX, i // COLUMNS * (CELL_PX + CAPTION_PX)
        picture = render_thumbnails(make_everyday(label, (SEED, i)), 1, (SEED, i), camera)[0]
        sheet.paste(Image.fromarray(picture), (left, top))
        draw.text((left + 4, top + CELL_PX + 2), label, fill=(28, 30, 34), font=font)
    return sheet
