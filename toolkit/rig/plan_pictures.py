"""Pictures of a plan: the camera positions around an object, and what each of them sees."""

from io import BytesIO

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.objects.load import TableObject
from toolkit.rig.camera import Camera
from toolkit.rig.plan import Pose
from toolkit.rig.renderer import make_renderer
from toolkit.rig.scene import Scene
from toolkit.rig.shading import tone_map


@with_default_style
def draw_positions(item: TableObject, camera: Camera, poses: list[Pose]) -> bytes:
    """PNG of the camera positions in space and from above, numbered, with the object's outline and front."""
    positions = np.stack([pose.matrix()[:3, 3] for pose in poses]) / 10
    vertices = item.mesh.vertices[:: max(1, len(item.mesh.vertices) // 3000)] / 10
    figure = make_figure(12, 6)
    space = figure.add_subplot(1, 2, 1, projection="3d")
    space.scatter(*vertices.T, s=0.5, c="0.55", linewidths=0)
    space.scatter(*positions.T, c=positions[:, 2], cmap="viridis", s=42, depthshade=False)
    for pose, position in zip(poses, positions, strict=True):
        corners = _frame_corners(camera, pose) / 10
        for corner in corners:
            space.plot(*np.stack([position, corner]).T, color="0.6", lw=0.5)
        space.plot(*np.vstack([corners, corners[:1]]).T, color="0.4", lw=0.7)
        space.text(*(position * 1.04), str(pose.id), fontsize=8)
    reach = float(np.abs(positions).max()) * 1.05
    space.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(0, reach), xlabel="x, front (cm)", ylabel="y (cm)")
    space.set_box_aspect((2, 2, 1))
    space.view_init(28, -60)
    plan = figure.add_subplot(1, 2, 2)
    plan.scatter(vertices[:, 0], vertices[:, 1], s=0.5, c="0.6", linewidths=0)
    dots = plan.scatter(positions[:, 0], positions[:, 1], c=[p.elevation_deg for p in poses], cmap="viridis", s=130)
    for pose, position in zip(poses, positions, strict=True):
        plan.annotate(str(pose.id), position[:2], ha="center", va="center", fontsize=7, color="white")
    front = float(vertices[:, 0].max())
    plan.annotate("front", (front * 1.9, 0), (front * 1.15, 0), arrowprops={"arrowstyle": "->"}, va="center")
    plan.set(aspect="equal", xlabel="x (cm)", ylabel="y (cm)")
    plan.grid(alpha=0.3)
    figure.colorbar(dots, ax=plan, label="elevation (degrees)", shrink=0.7)
    figure.suptitle(f"{item.name}: {len(poses)} camera positions")
    return encode_figure(figure, dpi=110)


def draw_contact_sheet(
    item: TableObject, camera: Camera, poses: list[Pose], studio: Scene, columns: int = 6, tile_px: int = 320
) -> bytes:
    """PNG of what every pose sees, with its number and angles."""
    small = Camera.from_fov(tile_px, round(tile_px * camera.height / camera.width), camera.fov_deg)
    renderer = make_renderer("raycast", item.mesh, studio)
    columns = min(columns, len(poses))
    rows = -(-len(poses) // columns)
    sheet = Image.new("RGB", (columns * small.width, rows * small.height), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=14)
    for i, pose in enumerate(poses):
        tile = tone_map(renderer.render(small, pose.matrix()), (0, pose.id))
        left, top = i % columns * small.width, i // columns * small.height
        sheet.paste(Image.fromarray(tile), (left, top))
        label = f"{pose.id}: azimuth {pose.azimuth_deg:.0f}°, elevation {pose.elevation_deg:.0f}°"
        box = draw.textbbox((left + 6, top + 4), label, font=font)
        draw.rectangle((box[0] - 3, box[1] - 2, box[2] + 3, box[3] + 2), fill="white")
        draw.text((left + 6, top + 4), label, font=font, fill="black")
    buffer = BytesIO()
    sheet.save(buffer, "PNG")
    return buffer.getvalue()


def _frame_corners(camera: Camera, pose: Pose) -> np.ndarray:
    """(4, 3) corners of the picture, drawn a sixth of the way to the target."""
    T_world_camera = pose.matrix()
    depth = pose.distance_mm / 6
    x, y = camera.width / 2 / camera.fx * depth, camera.height / 2 / camera.fx * depth
    local = np.array([[-x, -y, depth], [x, -y, depth], [x, y, depth], [-x, y, depth]])
    return local @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
