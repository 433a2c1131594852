"""Texture coordinates for meshes that have none: flat pieces that each face a direction, packed by xatlas."""

import io
import os
import sys
from importlib.util import find_spec

import numpy as np

from toolkit.core.child import run_python
from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import connected_parts, cross_products, flat_areas, group_places

FINE = 32
"""A piece is looked at on a grid of about so many cells a side."""
JUMP = 4.0
"""Heights in a cell that differ by more cells than this are two surfaces."""
WORTH_A_LOOK = 1e-3
"""Smaller pieces, as a share of the surface, stay whole."""
TOLERATED = 0.02
"""Share of a piece's cells that may hold two surfaces."""


def find_winding(flat: np.ndarray, height: np.ndarray, area: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Find the pieces that cover themselves.

    Args:
        flat: (m, 3, 2) the corners' places as seen along the piece's direction.
        height: (m, 3) the corners' heights along it.
        area: (m,) of the faces, in the unit of `flat` squared.
        piece: (m,) the piece of each face.

    Returns:
        (count,) bool per piece.
    """
    count = int(piece.max()) + 1
    # cells of a grid over each piece, with about two samples in each; small pieces are not worth a look
    size = np.bincount(piece, area, count)
    cell = np.sqrt(np.maximum(size, 1e-300)) / FINE
    samples = np.clip(np.ceil(2 * area / cell[piece] ** 2), 1, 4096).astype(np.int64)
    samples[size[piece] < WORTH_A_LOOK * size.sum()] = 0
    # samples spread evenly over each face
    face = np.repeat(np.arange(len(piece)), samples)
    if not len(face):
        return np.zeros(count, bool)
    weights = spread(len(face))
    places = np.einsum("kc,kci->ki", weights, flat[face])
    level = np.einsum("kc,kc->k", weights, height[face])
    of = piece[face]
    grid = np.floor(places / cell[of][:, None]).astype(np.int64)
    low, width = grid.min(axis=0), np.ptp(grid, axis=0) + 1
    if float(count) * float(width[0]) * float(width[1]) > 2**62:  # pieces of wildly different sizes: leave them whole
        return np.zeros(count, bool)
    # one number for piece, column and row
    key = (of * width[0] + grid[:, 0] - low[0]) * width[1] + grid[:, 1] - low[1]
    # sorted by cell, then height: consecutive samples of a cell that are far apart are two surfaces
    order = np.lexsort((level, key))
    key, level, of = key[order], level[order], of[order]
    gap = (np.diff(key) == 0) & (np.diff(level) > JUMP * cell[of[1:]])
    starts = np.r_[True, np.diff(key) != 0]
    cell_index = np.cumsum(starts) - 1
    double = np.zeros(int(cell_index[-1]) + 1, bool)
    double[cell_index[1:][gap]] = True
    # a piece covers itself if more than a few of its cells hold two surfaces
    cells = np.bincount(of[starts], minlength=count)
    return np.bincount(of[starts], double, count) > TOLERATED * cells


def spread(count: int) -> np.ndarray:
    """(count, 3) barycentric coordinates that fill a triangle evenly (the R2 sequence, folded)."""
    golden = 1.32471795724474602596  # the real root of x³ = x + 1 (M. Roberts, 2018)
    i = np.arange(1, count + 1)[:, None]
    a, b = ((0.5 + i / golden ** np.array([1, 2])) % 1).T
    # the unit square's upper half is mirrored into the lower one
    folded = a + b > 1
    a, b = np.where(folded, 1 - a, a), np.where(folded, 1 - b, b)
    return np.column_stack([a, b, 1 - a - b])


DIRECTIONS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
FACING = 0.45
"""Least cosine between a face's normal and its direction, for smooth borders."""
LEANING = 0.2
"""The same for faces of pieces that are too small to stand alone."""
AGREE = 0.5
"""Weight, as a cosine, of neighbours that all face the same way."""
MOST_CUTS = 8
"""Most halvings of pieces that cover themselves."""


def cut_charts(vertices: np.ndarray, faces: np.ndarray, least_area: float) -> tuple[np.ndarray, np.ndarray]:
    """Cut a mesh into connected pieces that each face a direction, and project each along its mean normal.

    Args:
        vertices: (n, 3), welded.
        faces: (m, 3).
        least_area: smaller pieces join a neighbour in whose direction they lean, in the vertices' unit squared.

    Returns:
        (m,) piece of each face, from 0; and (m, 3, 2) places of the corners on it, counter-clockwise from outside.
    """
    corners = vertices[faces].astype(np.float64)
    weighted = cross_products(corners)
    area = np.linalg.norm(weighted, axis=1) / 2
    unit = weighted / np.maximum(2 * area, 1e-300)[:, None]
    unit[area == 0] = 0
    # faces with a common edge, and its length
    pairs, length = _neighbours(vertices, faces)
    facing = _choose_directions(unit, pairs, length)
    piece, facing = _join_small(facing, unit, area, pairs, length=length, least_area=least_area)
    piece = _cut_winding(piece, facing, corners, area, pairs)
    return piece, _flatten(corners, unit, weighted, piece, facing)


def _neighbours(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(k, 2) faces that share an edge, and (k,) the edge's length; of more than two at an edge, each with the next."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1).astype(np.int64)
    key = edges[:, 0] * len(vertices) + edges[:, 1]  # a number for each edge sorts faster than pairs
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    pairs = np.stack([order[same], order[same + 1]], axis=1) // 3
    ends = vertices[edges[order[same]]].astype(np.float64)
    return pairs, np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)


def _choose_directions(unit: np.ndarray, pairs: np.ndarray, length: np.ndarray) -> np.ndarray:
    """(m,) index of each face's direction: as it faces, unless its neighbours outvote it."""
    m, count = len(unit), len(DIRECTIONS)
    # a face may turn away from its best direction only as far as FACING allows
    cosine = unit @ DIRECTIONS.T
    facing = cosine.argmax(axis=1)
    allowed = (cosine >= FACING) | (unit == 0).all(axis=1, keepdims=True)
    allowed[np.arange(m), facing] = True
    both, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    weight = np.concatenate([length, length])
    # neighbours vote by the length of their common edge
    around = np.maximum(np.bincount(both, weight, m), 1e-300)[:, None]
    for step in range(8):  # every second face at a time: two that swap with each other would never settle
        votes = np.bincount(both * count + facing[other], weight, m * count).reshape(m, count)
        better = np.where(allowed, cosine + AGREE * votes / around, -np.inf).argmax(axis=1)
        turn = np.arange(m) % 2 == step % 2
        facing = np.where(turn, better, facing)
    return facing


def _pieces(facing: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(m,) connected faces of the same direction (or any other label), numbered from 0."""
    joined = pairs[facing[pairs[:, 0]] == facing[pairs[:, 1]]]
    return connected_parts(len(facing), joined[:, 0], joined[:, 1])


def _join_small(
    facing: np.ndarray, unit: np.ndarray, area: np.ndarray, pairs: np.ndarray, length: np.ndarray, least_area: float
) -> tuple[np.ndarray, np.ndarray]:
    """Join pieces under `least_area` to the neighbour with the longest border, if they lean in its direction."""
    piece = _pieces(facing, pairs)
    for _ in range(6):
        count = int(piece.max()) + 1
        size = np.bincount(piece, area, count)
        # how far every face of a piece leans towards each direction, at worst
        lean = np.ones((count, len(DIRECTIONS)))
        np.minimum.at(lean, piece[area > 0], unit[area > 0] @ DIRECTIONS.T)
        way = np.zeros(count, np.int64)
        # all faces of a piece have the same direction
        way[piece] = facing
        # the common border of each pair of pieces
        a, b = piece[np.concatenate([pairs, pairs[:, ::-1]])].T
        key, inverse = np.unique(a * count + b, return_inverse=True)
        border = np.bincount(inverse, np.concatenate([length, length]))
        a, b = np.divmod(key, count)
        # joins only where the smaller piece leans enough in the larger piece's direction
        fit = (a != b) & (size[a] < least_area) & (size[a] <= size[b]) & (lean[a, way[b]] >= LEANING)
        a, b, border = a[fit], b[fit], border[fit]
        goes, receives = np.arange(count), np.zeros(count, bool)
        # smallest first, each to its longest border; a piece that has received another stays for this round
        for i in np.lexsort((-border, size[a])):
            if goes[a[i]] == a[i] and goes[b[i]] == b[i] and not receives[a[i]]:
                goes[a[i]] = b[i]
                receives[b[i]] = True
        if (goes == np.arange(count)).all():
            break
        facing = way[goes[piece]]
        piece = _pieces(facing, pairs)
    return piece, facing


def _cut_winding(
    piece: np.ndarray, facing: np.ndarray, corners: np.ndarray, area: np.ndarray, pairs: np.ndarray
) -> np.ndarray:
    """Halve pieces that lie over themselves at the middle of their height, as often as it takes."""
    # the two axes across each direction
    across = np.array([[1, 2], [1, 2], [0, 2], [0, 2], [0, 1], [0, 1]])[facing]
    flat = np.take_along_axis(corners, np.repeat(across[:, None], 3, axis=1), axis=2)
    height = np.einsum("mci,mi->mc", corners, DIRECTIONS[facing])
    for _ in range(MOST_CUTS):
        winding = find_winding(flat, height, area, piece)[piece]
        if not winding.any():
            break
        count = int(piece.max()) + 1
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        middle = height.mean(axis=1)
        np.minimum.at(low, piece, middle)
        np.maximum.at(high, piece, middle)
        # label 2k below and 2k + 1 above the middle: `_pieces` joins what is connected and labelled alike
        upper = winding & (middle > ((low + high) / 2)[piece])
        piece = _pieces(2 * piece + upper, pairs)
    return piece


def _flatten(
    corners: np.ndarray, unit: np.ndarray, weighted: np.ndarray, piece: np.ndarray, facing: np.ndarray
) -> np.ndarray:
    """(m, 3, 2) corners on their piece, along its mean normal or its direction, whichever suits its worst face."""
    count = int(piece.max()) + 1
    # the mean normal by area; the direction that the piece was made for
    mean = np.stack([np.bincount(piece, weighted[:, axis], count) for axis in range(3)], axis=1)
    mean = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    straight = np.zeros((count, 3))
    straight[piece] = DIRECTIONS[facing]
    # a face without area has no normal
    real = (unit != 0).any(axis=1)
    worst_mean, worst_straight = np.ones(count), np.ones(count)
    np.minimum.at(worst_mean, piece[real], np.einsum("ij,ij->i", unit[real], mean[piece[real]]))
    np.minimum.at(worst_straight, piece[real], np.einsum("ij,ij->i", unit[real], straight[piece[real]]))
    axis = np.where((worst_mean >= worst_straight)[:, None], mean, straight)
    # crossed with the world's axis that it leans on least, so that the product is never short
    helper = np.eye(3)[np.abs(axis).argmin(axis=1)]
    right = np.cross(helper, axis)
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-300)
    up = np.cross(axis, right)
    basis = np.stack([right, up], axis=1)[piece]
    return np.einsum("mij,mkj->mki", basis, corners)


SMALL_PX = 4
"""Pieces under so many texels squared join a neighbour where they can."""


def unwrap(vertices: np.ndarray, faces: np.ndarray, n: int) -> np.ndarray:
    """Flatten every triangle onto a square texture, at the same scale; the same input gives the same coordinates.

    Pieces are 2 texels apart, or less if there are very many.

    Args:
        vertices: (v, 3) positions; those at the same place are joined.
        faces: (m, 3).
        n: side of the texture in texels.

    Returns:
        (m, 3, 2) float32 in [0, 1], u right and v up.

    Raises:
        ToolkitError: xatlas is not installed, or cannot pack them.
    """
    # vertices at the same place count once
    first, place = group_places(vertices)
    places, welded = vertices[first].astype(np.float64), place[faces]
    corners = places[welded]
    surface = np.linalg.norm(cross_products(corners), axis=1).sum() / 2
    # a guess at the scale before packing: pieces fill about 60 % of the sheet
    texel = np.sqrt(surface / (0.6 * n * n))
    chart, flat = cut_charts(places, welded, least_area=(SMALL_PX * texel) ** 2)
    # a corner is shared within a piece and cut between pieces: a number for the pair
    key = (chart.astype(np.int64)[:, None] * len(places) + welded).reshape(-1)
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    points, triangles = flat.reshape(-1, 2)[first], inverse.reshape(-1, 3)
    packed = pack_pieces(points, triangles, chart, n)
    return np.clip(packed[triangles] / n, 0, 1).astype(np.float32)


PADDING_PX = 2
"""Texels between pieces."""
FAIR_SCALE = 0.4
"""With texels smaller than this share of the ideal, the space between pieces goes first."""
_KEPT: list[object] = []
"""Atlases, which are never freed."""


def pack_pieces(points: np.ndarray, triangles: np.ndarray, chart: np.ndarray, n: int) -> np.ndarray:
    """Move and turn flat pieces, at the largest scale at which they fit on a sheet.

    Freeing an atlas of xatlas may wait for its threads for ever. A child process packs, and ends without freeing it.

    Args:
        points: (k, 2) in any unit.
        triangles: (m, 3) their points.
        chart: (m,) the piece of each triangle.
        n: side of the sheet in texels.

    Returns:
        (k, 2) where each point lies on it, in texels.

    Raises:
        ToolkitError: xatlas is not installed, or cannot pack them.
    """
    if find_spec("xatlas") is None:
        raise ToolkitError(
            "this mesh needs new texture coordinates, which need xatlas: install it with 'pip install xatlas' "
            "(on Python 3.14 this needs a C++ compiler)"
        )
    # a child process: xatlas may hang when it frees its memory
    given = io.BytesIO()
    np.savez(given, points=points, triangles=triangles, chart=chart, n=n)
    done = run_python("from toolkit.objects.unwrap import _serve; _serve()", given.getvalue())
    if done.returncode:
        said = done.stderr.decode("utf-8", "replace").strip().splitlines()
        why = said[-1] if said else f"xatlas ended with code {done.returncode}"
        raise ToolkitError(f"cannot make texture coordinates for this mesh: {why}")
    return np.load(io.BytesIO(done.stdout), allow_pickle=False)


def _pack(points: np.ndarray, triangles: np.ndarray, chart: np.ndarray, n: int) -> np.ndarray:
    """Pack in this process: bisection finds the largest scale that fits, as a share of that of equal areas."""
    ideal = n / np.sqrt(max(flat_areas(points[triangles]).sum(), 1e-30))
    best, best_scale = None, 0.0
    # a margin between charts if it costs little scale; without it colours of neighbours may bleed
    for padding in range(PADDING_PX, -1, -1):
        low, high = best_scale, 1.0
        # seven halvings: the scale to 1 % of the ideal
        for _ in range(7):
            scale = (low + high) / 2
            placed, size = _try_pack(points * ideal * scale, triangles, chart, padding)
            if size <= n:
                best, low = placed, scale
            else:
                high = scale
        best_scale = low
        if best_scale >= FAIR_SCALE:
            break
    # not even without margins: larger than the texture, and scaled down to it
    if best is None:
        placed, size = _try_pack(points * ideal, triangles, chart, 0)
        best = placed * (n / size)
    return best


def _try_pack(points: np.ndarray, triangles: np.ndarray, chart: np.ndarray, padding: int) -> tuple[np.ndarray, int]:
    """Return pieces in texels, moved and turned into a sheet, and that sheet's side."""
    import xatlas

    atlas = xatlas.Atlas()
    # kept alive until the process ends: freeing it may never return
    _KEPT.append(atlas)
    uv, index = np.ascontiguousarray(points, np.float32), np.ascontiguousarray(triangles, np.uint32)
    atlas.add_uv_mesh(uv, index, np.ascontiguousarray(chart[:, None], np.uint32))
    options = xatlas.PackOptions()
    options.texels_per_unit, options.padding, options.bilinear = 1.0, padding, True
    atlas.generate(pack_options=options)
    # xatlas may split vertices: back to the points as they were given
    origin, _, placed = atlas.get_mesh(0)
    result = np.zeros(points.shape)
    result[np.asarray(origin)] = np.asarray(placed, np.float64) * [atlas.width, atlas.height]
    return result, max(atlas.width, atlas.height)


def _serve() -> None:
    """Pack the standard input, write the result, and end without freeing atlases."""
    code = 1
    try:
        with np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False) as given:
            packed = _pack(given["points"], given["triangles"], given["chart"], int(given["n"]))
        np.save(sys.stdout.buffer, packed, allow_pickle=False)
        sys.stdout.flush()
        code = 0
    except Exception as error:  # whatever xatlas makes of them; the process that asked says it
        sys.stderr.write(f"{type(error).__name__}: {error}")
        sys.stderr.flush()
    finally:
        os._exit(code)
