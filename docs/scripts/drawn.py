"""Figures that need no workspace: parts of training, the kinds that rig18 was trained on, skies, the city."""

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from toolkit.boosters.transforms.camera import CameraBlur, JpegFile, SensorNoise
from toolkit.boosters.transforms.placement import AffineRanges, PoseRanges
from toolkit.boosters.transforms.printing import LightRanges, PrintProcess, TapeGlare
from toolkit.boosters.transforms.show import Appearance, show_patch
from toolkit.core.draws import Draws
from toolkit.imaging.style import INK
from toolkit.rig.camera import Camera, look_at, orbit_direction, pixel_rays
from toolkit.rig.shading import tone_map
from toolkit.rig.views import THUMBNAIL_STUDIO, WIDE_VIEWS, ViewSettings, render_pictures
from toolkit.rooms.worlds.conditions import CLEAR, TIMES
from toolkit.rooms.worlds.content.everyday import MAKERS, make_everyday
from toolkit.rooms.worlds.own import build_world
from toolkit.rooms.worlds.picture import leave_empty, make_renderer, see_through
from toolkit.rooms.worlds.sky import make_sky
from toolkit.rooms.worlds.viewpoints import FOV_DEG, choose_viewpoints

CELL_PX, CAPTION_PX, GAP_PX, DRAWS = 224, 30, 8, 2
STILL = AffineRanges(rotation_deg=(12, 12), share=(0.6, 0.6), foreshortening=(0.9, 0.9), overhang=0)


@dataclass(frozen=True)
class Row:
    """A part and what to call it."""

    title: str
    appearance: Appearance


def list_rows() -> list[Row]:
    """Each part with probability 1, at the ranges that the default recipe draws from."""
    sure = {"probability": 1.0}
    return [
        Row("pose", Appearance(PoseRanges(**sure))),
        Row("light", Appearance(STILL, on_paper=(LightRanges(),))),
        Row("print", Appearance(STILL, on_print=(PrintProcess(**sure),))),
        Row("glare", Appearance(STILL, on_paper=(TapeGlare(**sure),))),
        Row("blur", Appearance(STILL, on_photo=(CameraBlur(**sure),))),
        Row("noise", Appearance(STILL, on_photo=(SensorNoise(**sure),))),
        Row("JPEG", Appearance(STILL, on_photo=(JpegFile(quality=(40, 40), **sure),))),
    ]


def draw_parts(pixels: np.ndarray, photo: Image.Image, font: ImageFont.FreeTypeFont) -> Image.Image:
    """A column per part, two random draws below each other.

    Args:
        pixels: (n, n, 3) uint8 sRGB patch.
        photo: to paste it into.
        font: of the captions.
    """
    import torch

    side = min(photo.size)
    left, top = (photo.width - side) // 2, (photo.height - side) // 2
    square = photo.crop((left, top, left + side, top + side)).resize((CELL_PX, CELL_PX), Image.Resampling.LANCZOS)
    image = torch.from_numpy(np.array(square)).permute(2, 0, 1)[None].float().div(255)
    patch = torch.from_numpy(pixels.copy()).permute(2, 0, 1).float().div(255)
    rows = list_rows()
    step = CELL_PX + GAP_PX
    sheet = Image.new("RGB", (len(rows) * step - GAP_PX, CAPTION_PX + DRAWS * step - GAP_PX), "white")
    draw = ImageDraw.Draw(sheet)
    for column, row in enumerate(rows):
        draw.text((column * step + 4, 3), row.title, fill=INK, font=font)
        for line in range(DRAWS):
            shown = show_patch(patch, image, row.appearance, Draws(5, line))[0].permute(1, 2, 0).numpy()
            cell = Image.fromarray(np.round(shown * 255).astype(np.uint8))
            sheet.paste(cell, (column * step, CAPTION_PX + line * step))
    return sheet


KIND_COLUMNS, KIND_PX, KIND_CAPTION_PX = 9, 150, 22
SEED = 20_000
"""Far from the seeds of the training set."""


def draw_everyday(font: ImageFont.FreeTypeFont) -> Image.Image:
    """All kinds, in the order of their labels, from random poses as in training."""
    rows = -(-len(MAKERS) // KIND_COLUMNS)
    sheet = Image.new("RGB", (KIND_COLUMNS * KIND_PX, rows * (KIND_PX + KIND_CAPTION_PX)), "white")
    draw = ImageDraw.Draw(sheet)
    settings = ViewSettings(WIDE_VIEWS, KIND_PX)
    for i, label in enumerate(sorted(MAKERS)):
        left, top = i % KIND_COLUMNS * KIND_PX, i // KIND_COLUMNS * (KIND_PX + KIND_CAPTION_PX)
        mesh = make_everyday(label, (SEED, i))
        (picture,) = render_pictures(mesh, 1, settings, (SEED, i), setting=THUMBNAIL_STUDIO)
        sheet.paste(Image.fromarray(picture), (left, top))
        draw.text((left + 4, top + KIND_PX + 2), label, fill=INK, font=font)
    return sheet


SKY_PX, SKY_FOV_DEG, SKY_ELEVATION_DEG = (288, 216), 60.0, 12.0
"""Each sky is seen towards its sun and, below, away from it."""


def draw_skies(font: ImageFont.FreeTypeFont) -> Image.Image:
    """A column for each time of day."""
    width, height = SKY_PX
    camera = Camera.from_fov(width, height, SKY_FOV_DEG)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float32) + 0.5
    step = height + GAP_PX
    sheet = Image.new("RGB", (len(TIMES) * (width + GAP_PX) - GAP_PX, CAPTION_PX + 2 * step - GAP_PX), "white")
    draw = ImageDraw.Draw(sheet)
    for column, name in enumerate(TIMES):
        left = column * (width + GAP_PX)
        draw.text((left + 4, 3), name, fill=INK, font=font)
        sky = make_sky(name, 0, 768)
        for row, turn in enumerate((0, 180)):
            towards = orbit_direction(sky.sun.azimuth_deg + turn, SKY_ELEVATION_DEG)
            rays = pixel_rays(camera, look_at(np.zeros(3), towards), pixels)[:, 3:]
            shown = tone_map(sky.render(rays).reshape(height, width, 3), (0,))
            sheet.paste(Image.fromarray(shown), (left, CAPTION_PX + row * step))
    return sheet


CITY_PX = (480, 270)
CITY_LOOKS = (("afternoon", CLEAR), ("dusk", CLEAR), ("afternoon", ("fog", 1)))


def draw_city(font: ImageFont.FreeTypeFont) -> Image.Image:
    """City 0 from a street and from the height of roofs: by day, at dusk, in fog of 100 m."""
    world, (width, height) = build_world("city"), CITY_PX
    views = [one for one in choose_viewpoints(world) if one.name in ("street", "roof")]
    step = height + GAP_PX
    sheet = Image.new("RGB", (len(CITY_LOOKS) * (width + GAP_PX) - GAP_PX, CAPTION_PX + 2 * step - GAP_PX), "white")
    draw, camera = ImageDraw.Draw(sheet), Camera.from_fov(width, height, FOV_DEG)
    for time in ("afternoon", "dusk"):
        sky = make_sky(time)
        renderer = make_renderer(leave_empty(world, sky))
        columns = [(k, weather) for k, (name, weather) in enumerate(CITY_LOOKS) if name == time]
        for row, view in enumerate(views):
            pictures = see_through(renderer, world, sky, (camera, view.T_world_camera), [one for _, one in columns])
            for (column, weather), picture in zip(columns, pictures, strict=True):
                left = column * (width + GAP_PX)
                sheet.paste(Image.fromarray(picture), (left, CAPTION_PX + row * step))
                words = time if weather == CLEAR else f"{time}, {weather[0]} {weather[1]}"
                draw.text((left + 4, 3), words, fill=INK, font=font)
    return sheet
