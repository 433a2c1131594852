"""Flat pieces onto one square sheet, by xatlas in a process of its own."""

import io
import os
import sys
from importlib.util import find_spec

import numpy as np

from toolkit.core.child import run_python
from toolkit.core.errors import ToolkitError

PADDING_PX = 2
"""Texels between pieces."""
FAIR_SCALE = 0.4
"""With texels smaller than this share of the ideal, the space between pieces goes first."""
_KEPT: list[object] = []
"""Atlases, which are not given back."""


def pack_pieces(points: np.ndarray, triangles: np.ndarray, chart: np.ndarray, n: int) -> np.ndarray:
    """Move and turn flat pieces, at the largest scale at which they fit on a sheet.

    An atlas of xatlas that is given back waits for its threads, now and then for ever: they are woken once, without the
    lock that keeps the call from being missed. A process that ends at once gives nothing back.

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
            "this mesh needs new texture coordinates, which need xatlas: install it with 'pip install xatlas'"
        )
    given = io.BytesIO()
    np.savez(given, points=points, triangles=triangles, chart=chart, n=n)
    done = run_python("from toolkit.objects.pack import _serve; _serve()", given.getvalue())
    if done.returncode:
        said = done.stderr.decode("utf-8", "replace").strip().splitlines()
        why = said[-1] if said else f"xatlas ended with code {done.returncode}"
        raise ToolkitError(f"cannot make texture coordinates for this mesh: {why}")
    return np.load(io.BytesIO(done.stdout), allow_pickle=False)


def _pack(points: np.ndarray, triangles: np.ndarray, chart: np.ndarray, n: int) -> np.ndarray:
    """As `pack_pieces`, in this process."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    doubled = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    ideal = n / np.sqrt(max(np.abs(doubled).sum() / 2, 1e-30))
    best, best_scale = None, 0.0
    for padding in range(PADDING_PX, -1, -1):
        low, high = best_scale, 1.0
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
    if best is None:
        placed, size = _try_pack(points * ideal, triangles, chart, 0)
        best = placed * (n / size)
    return best


def _try_pack(points: np.ndarray, triangles: np.ndarray, chart: np.ndarray, padding: int) -> tuple[np.ndarray, int]:
    """Pieces in texels, moved and turned into one sheet, and that sheet's side."""
    import xatlas

    atlas = xatlas.Atlas()
    _KEPT.append(atlas)
    uv, index = np.ascontiguousarray(points, np.float32), np.ascontiguousarray(triangles, np.uint32)
    atlas.add_uv_mesh(uv, index, np.ascontiguousarray(chart[:, None], np.uint32))
    options = xatlas.PackOptions()
    options.texels_per_unit, options.padding, options.bilinear = 1.0, padding, True
    atlas.generate(pack_options=options)
    origin, _, placed = atlas.get_mesh(0)
    result = np.zeros(points.shape)
    result[np.asarray(origin)] = np.asarray(placed, np.float64) * [atlas.width, atlas.height]
    return result, max(atlas.width, atlas.height)


def _serve() -> None:
    """Pack what comes in, send it out, and end without giving atlases back."""
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
