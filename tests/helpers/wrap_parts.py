"""A box of 100 × 60 × 40 mm: its front and top are one piece of a wrap, laid flat by hand, its right side another."""

import numpy as np

from toolkit.objects.mesh import Mesh, hash_shape
from toolkit.rooms.wraps.wrap import FlatPiece, PieceRecord, Wrap, WrapRecord

N_PX, TEXEL_MM = 512, 0.5
FRONT_AND_TOP, SIDE = (10, 10), (240, 240)


def make_box_wrap(box: Mesh, *, with_top: bool = True) -> Wrap:
    """`box` is `make_box()`: x from -50 to 50, y from -30 to 30, z from 0 to 40."""
    corners = box.vertices[box.faces].astype(np.float64)
    middle = corners.mean(axis=1)
    x, y, z = np.moveaxis(corners, 2, 0)
    front, top, right = middle[:, 1] < -29.9, middle[:, 2] > 39.9, middle[:, 0] > 49.9
    net = np.stack([x + 50, np.where(top[:, None], y + 70, z)], axis=2)
    pieces = (
        FlatPiece(np.flatnonzero(front | (top & with_top)).astype(np.int32), net[front | (top & with_top)], 0.0),
        FlatPiece(np.flatnonzero(right).astype(np.int32), np.stack([y + 30, z], axis=2)[right], 0.0),
    )
    records = [
        PieceRecord(
            number=number, origin_px=origin_px, width_mm=piece.width_mm, height_mm=piece.height_mm,
            area_mm2=piece.area_mm2, stretch=0, outline_mm=[list(piece.outline().exterior.coords)], png_sha256="0" * 64,
        )
        for number, (piece, origin_px) in enumerate(zip(pieces, (FRONT_AND_TOP, SIDE), strict=True), 1)
    ]  # fmt: skip
    record = WrapRecord(
        name="crate", object="crate", mesh_sha256=hash_shape(box), material="film", stretch_allowed=0.03, covered=0.5,
        covered_surface=0.5, texel_mm=TEXEL_MM, n_px=N_PX, pieces=records, map_sha256="0" * 64,
    )  # fmt: skip
    return Wrap(record, pieces, np.full((N_PX, N_PX, 3), 90, np.uint8))
