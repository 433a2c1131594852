"""The animation of the README, and the boosters side by side: animation.py WORKSPACE [OBJECT] [MODEL].

The camera goes once round an object, left unmodified, right with its shipped patch. Below each picture stands what the
network predicts for it, and the probability that it gives to the object's class. No frame is left out or chosen.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from figures import RIGHT, WRONG
from PIL import Image, ImageDraw

from toolkit.captures.render import render
from toolkit.captures.shoot import ShootSettings, studio_for
from toolkit.cli.output import say
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.imaging.plots import read_font
from toolkit.imaging.preprocessing import resize_and_crop
from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.records import read_patch
from toolkit.rig import Pattern
from toolkit.rig.camera import Camera
from toolkit.rig.plan import Pose, plan_poses
from toolkit.rig.renderers import make_renderer
from toolkit.rig.shading import tone_map
from toolkit.rig.variants import apply_booster, find_booster

FRAMES, FRAME_MS, ELEVATION_DEG = 36, 130, 30.0
WIDTH, HEIGHT, STRIP, GAP, COLOURS = 320, 240, 64, 8, 80
INK, SOFT, PAPER = (27, 31, 36), (225, 228, 232), (255, 255, 255)
TITLES = ("unmodified", "with its patch")
FIGURES = Path(__file__).resolve().parents[1] / "figures"
KINDS = {"unpatched": "unmodified", "patched": "patch", "wrapped": "wrap", "textured": "texture"}


def draw_frame(
    pictures: list[np.ndarray], probabilities: list[np.ndarray], labels: list[str], truth: int
) -> Image.Image:
    """Both pictures side by side, with prediction and bar below each.

    Args:
        pictures: (h, w, 3) uint8 sRGB each.
        probabilities: (classes,) each.
        labels: of the classes.
        truth: index of the object's class.
    """
    frame = Image.new("RGB", (2 * WIDTH + GAP, HEIGHT + STRIP), PAPER)
    draw, small, large = ImageDraw.Draw(frame), read_font("plain", 13), read_font("plain", 17)
    for column, (picture, shares) in enumerate(zip(pictures, probabilities, strict=True)):
        left, top = column * (WIDTH + GAP), int(shares.argmax())
        colour = RIGHT if top == truth else WRONG
        frame.paste(Image.fromarray(picture), (left, 0))
        draw.text((left + 8, 6), TITLES[column], fill=INK, font=small)
        mark = "✓" if top == truth else "✗"
        draw.text((left + 8, HEIGHT + 6), f"{mark} {labels[top]}", fill=colour, font=large)
        full = WIDTH - 150
        draw.text((left + 8, HEIGHT + 38), f"{labels[truth]}  {shares[truth]:.0%}", fill=INK, font=small)
        box = left + 130, HEIGHT + 40, left + 130 + full, HEIGHT + 52
        draw.rectangle(box, fill=SOFT)
        draw.rectangle((*box[:2], box[0] + round(full * float(shares[truth])), box[3]), fill=colour)
    return frame


def ask(network: Classifier, pictures: np.ndarray) -> np.ndarray:
    """(n, classes) probabilities for (n, h, w, 3) uint8 sRGB pictures."""
    crops = np.stack([resize_and_crop(picture, network.preprocessing) for picture in pictures])
    batch = torch.from_numpy(crops).permute(0, 3, 1, 2).float() / 255
    with torch.no_grad():
        return torch.cat([network.logits(part).softmax(1) for part in batch.split(8)]).numpy()


def draw_boosters(space: Workspace, item: TableObject, pose: Pose, camera: Camera) -> Image.Image:
    """The object without and with each kind of booster, from one pose, with the kind's name below."""
    sheet = Image.new("RGB", (len(KINDS) * camera.width, camera.height + 26), PAPER)
    draw, font, settings = ImageDraw.Draw(sheet), read_font("plain", 16), ShootSettings()
    for column, (variant, title) in enumerate(KINDS.items()):
        mesh = apply_booster(item, find_booster(space, item, variant))
        light = make_renderer(settings.renderer, mesh, studio_for(item, settings)).render(camera, pose.matrix())
        sheet.paste(Image.fromarray(tone_map(light, (0, pose.id))), (column * camera.width, 0))
        draw.text((column * camera.width + 8, camera.height + 3), title, fill=INK, font=font)
    return sheet


def main(folder: str, name: str = "racer", model: str = "resnet18") -> None:
    """Write the animation, and print how many frames are correct on either side."""
    space, camera = open_workspace(Path(folder)), Camera.from_fov(WIDTH, HEIGHT)
    item, patch, network = load_object(space.object_spec(name)), read_patch(space.patch(name)), load_classifier(model)
    pattern = Pattern(name="ring", count=FRAMES, elevation_deg=(ELEVATION_DEG, ELEVATION_DEG))
    poses, truth = plan_poses(item, camera, pattern), network.class_index(item.spec.class_name)
    sides = [render(item, poses, camera, booster) for booster in (None, patch)]
    shares = [ask(network, side) for side in sides]
    for title, side in zip(TITLES, shares, strict=True):
        say(f"{title}: {sum(int(row.argmax()) == truth for row in side)} of {FRAMES}")
    draw_boosters(space, item, poses[FRAMES // 9], camera).save(FIGURES / "boosters.jpg", quality=88)
    frames = [
        draw_frame([side[k] for side in sides], [side[k] for side in shares], list(network.labels), truth)
        for k in range(FRAMES)
    ]
    # one palette for all frames: colours that change from frame to frame flicker, and take more bytes
    palette = Image.fromarray(np.concatenate([np.asarray(frame) for frame in frames[::6]])).quantize(COLOURS)
    coded = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    file = FIGURES / "turn.gif"
    coded[0].save(file, save_all=True, append_images=coded[1:], duration=FRAME_MS, loop=0, optimize=True)
    say(f"{file.name}: {file.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main(*sys.argv[1:])
