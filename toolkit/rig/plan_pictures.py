"""Pictures of plans: camera positions around an object, and what each sees."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.imaging.read import encode_image
from toolkit.objects.load import TableObject
from toolkit.rig.camera import Camera
from toolkit.rig.plan import Pose
from toolkit.rig.renderers import RAYCAST, make_renderer
from toolkit.rig.scene import Scene
from toolkit.rig.shading import tone_map


@with_default_style
def draw_positions(item: TableObject, poses: list[Pose]) -> bytes:
    """PNG of the camera positions from above, with the object and its front, and their heights over their azimuths."""
    # centimetres, and at most 3,000 points: the object is only a backdrop
    positions = np.stack([pose.matrix()[:3, 3] for pose in poses]) / 10
    vertices = item.mesh.vertices[:: max(1, len(item.mesh.vertices) // 3000)] / 10
    azimuths, elevations = ([getattr(pose, name) for pose in poses] for name in ("azimuth_deg", "elevation_deg"))
    reach = 1.1 * float(max(np.abs(positions[:, :2]).max(), np.abs(vertices[:, :2]).max()))
    figure = make_figure(12, 5.6)
    # left: the table from above, the object's front along +x
    above, aside = figure.subplots(1, 2)
    above.scatter(vertices[:, 0], vertices[:, 1], s=0.5, c="0.6", linewidths=0)
    front = float(vertices[:, 0].max())
    above.annotate(
        "", (front + 0.2 * reach, 0), (front + 0.04 * reach, 0), arrowprops={"arrowstyle": "->"}, va="center"
    )
    above.text(front + 0.04 * reach, 0.03 * reach, "front", fontsize=9)
    above.set(xlabel="x, towards the object's front (cm)", ylabel="y, to the object's left (cm)", title="from above")
    above.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach))
    # right: heights over azimuths, past both ends so that dots at 0° and 360° are whole
    aside.set(xlabel="azimuth (degrees): 0 front, 90 left, 180 back, 270 right", ylabel="height above the table (cm)")
    aside.set(title="heights", xlim=(-20, 380), xticks=range(0, 361, 45), ylim=(0, 1.15 * positions[:, 2].max()))
    # dots are coloured by elevation; their numbers stay readable on dark ones
    for panel, x, y in ((above, positions[:, 0], positions[:, 1]), (aside, np.mod(azimuths, 360), positions[:, 2])):
        dots = panel.scatter(x, y, c=elevations, cmap="cividis", s=150, zorder=3)
        for pose, *at in zip(poses, x, y, strict=True):
            colour = "white" if dots.norm(pose.elevation_deg) < 0.6 else "black"
            panel.annotate(str(pose.id), at, ha="center", va="center", fontsize=8, color=colour, zorder=4)
        panel.grid(alpha=0.3)
    figure.colorbar(dots, ax=aside, label="elevation (degrees)", shrink=0.7)
    figure.suptitle(f"{item.name}: {len(poses)} camera positions")
    return encode_figure(figure, dpi=110)


def draw_contact_sheet(
    item: TableObject, camera: Camera, poses: list[Pose], studio: Scene, columns: int = 6, tile_px: int = 320
) -> bytes:
    """PNG of what every pose sees, with its number and angles."""
    small = camera.scaled(tile_px, round(tile_px * camera.height / camera.width))
    renderer = make_renderer(RAYCAST, item.mesh, studio)
    columns = min(columns, len(poses))
    rows = -(-len(poses) // columns)
    sheet = Image.new("RGB", (columns * small.width, rows * small.height), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=14)
    for i, pose in enumerate(poses):
        tile = tone_map(renderer.render(small, pose.matrix()), (0, pose.id))
        left, top = i % columns * small.width, i // columns * small.height
        sheet.paste(Image.fromarray(tile), (left, top))
        label = f"{pose.id}: azimuth {pose.azimuth_deg:.0f}°, elevation {pose.elevation_deg:.0f}°"
        # on white, as the picture behind may be dark
        box = draw.textbbox((left + 6, top + 4), label, font=font)
        draw.rectangle((box[0] - 3, box[1] - 2, box[2] + 3, box[3] + 2), fill="white")
        draw.text((left + 6, top + 4), label, font=font, fill="black")
    return encode_image(sheet, "PNG")
