"""What the camera should see from every place: small renders of the object on its board, with and without a sheet."""

from collections.abc import Mapping
from dataclasses import replace
from io import BytesIO

import numpy as np
from PIL import Image

from toolkit.captures.variants import Paint, Print, dress
from toolkit.console import Ticker
from toolkit.objects.load import TableObject
from toolkit.rig.board import Sheet
from toolkit.rig.board_table import lay_board
from toolkit.rig.camera import Camera
from toolkit.rig.finish import develop
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.plan import Pose
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import Studio, make_studio

WIDTH_PX = 416
"""250 dpi on a picture 42 mm wide."""
TABLE_SCALE = 1.6
"""The table reaches further than the rig's own, so that few pictures show its end."""
JPEG_QUALITY = 85
BRIGHTER = 1.25
"""Than a photograph: printers darken, and white paper is white."""
DETAIL = BakeDetail(key_rays=16, room_rays=48, surface_spacing=0.026, table_spacing=0.022)


def make_light_studio(item: TableObject, board: Sheet | None) -> Studio:
    """A white table, which costs little ink, with the board painted on in true size."""
    studio = make_studio(0, TABLE_SCALE * float(item.mesh.size_mm.max()), backdrop="white")
    studio = replace(studio, exposure=BRIGHTER * studio.exposure)
    return studio if board is None else lay_board(studio, board, px_per_mm=studio.table.shape[1] / studio.table_mm[0])


def draw_views(
    item: TableObject, camera: Camera, poses: list[Pose], boosters: Mapping[str, Print | Paint | None],
    board: Sheet | None, bar: Ticker,
) -> dict[tuple[str, int], bytes]:  # fmt: skip
    """JPEGs by (variant, pose id), as wide as `WIDTH_PX` and of the camera's aspect.

    Args:
        item: on the table.
        camera: the plan's; its field of view is kept.
        poses: from where.
        boosters: what is stuck on, by variant.
        board: the sheet that the object stands on, None for a bare table.
        bar: counts one per picture.

    Raises:
        ToolkitError: a sheet cannot be mounted on the object.
    """
    small = Camera(WIDTH_PX, max(1, round(WIDTH_PX * camera.height / camera.width)), camera.fov_deg)
    studio = make_light_studio(item, board)
    views = {}
    for variant, booster in boosters.items():
        bar.advance(0, note=f"{item.name} {variant}: light")
        renderer = RaycastRenderer(dress(item, booster), studio, DETAIL)
        for pose in poses:
            picture = develop(renderer.render(small, pose.matrix()), (0, pose.id), noise=0, falloff=0)
            views[variant, pose.id] = encode_jpeg(picture)
            bar.advance(note=f"{item.name} {variant}")
    return views


def encode_jpeg(pixels: np.ndarray, quality: int = JPEG_QUALITY) -> bytes:
    """JPEG bytes of (h, w, 3) uint8 sRGB pixels."""
    buffer = BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=quality, optimize=True)
    return buffer.getvalue()
