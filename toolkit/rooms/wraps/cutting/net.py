"""A whole surface as a paper model: nets that are cut out, folded and glued, with a tab at each glued edge.

A net grows over the longest edges first, so that little is cut (minimum perimeter heuristic: Straub and Prautzsch 2011,
"Creating optimized cut-out sheets for paper models from meshes"). A new net begins if triangles would overlap or leave
the sheet.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toolkit.core.console import notice
from toolkit.core.errors import ToolkitError
from toolkit.core.lazy import shapely
from toolkit.rooms.wraps.config import MOST_PIECES
from toolkit.rooms.wraps.cutting.flatten import Region, Surface, lay_triangles
from toolkit.rooms.wraps.cutting.seams import Edge, find_joined, spread_pieces
from toolkit.rooms.wraps.cutting.trim import make_piece, turn_to_fit
from toolkit.rooms.wraps.wrap import FlatPiece, SeamRecord, TabRecord

MOST_FACES = 2_000
"""Most triangles that a person folds."""
FOLD_DEG = 1.0
"""Edges of a net that are bent by more are folded."""
FLAT_COSINE = 1 - 1e-6
TAB_MM, LEAST_TAB_MM = 7.0, 2.0
"""Depth of a glue tab, and the least depth."""
HAIR = 1e-6
"""Triangles are shrunk by this share before they are compared, so that neighbours do not touch."""


@dataclass(frozen=True)
class Tab:
    """A glue tab of a net, on an edge of a face of the mesh; `outline` (4, 2) in mm begins at the end of the edge."""

    piece: int
    edge: Edge
    outline: np.ndarray


def unfold(surface: Surface, sheet_mm: tuple[float, float]) -> list[FlatPiece]:
    """Unfold all faces into nets without stretch, largest first; faces larger than the sheet are left out.

    Args:
        surface: surface in mm.
        sheet_mm: sides of the sheet, which also holds the tabs.

    Raises:
        ToolkitError: more triangles than a hand folds, or more nets than a wrap has pieces.
    """
    left = surface.area > 0
    if int(left.sum()) > MOST_FACES:
        raise ToolkitError(
            f"a net of {int(left.sum()):,} triangles cannot be folded by hand: simplify the mesh to {MOST_FACES:,} or "
            "fewer in a modelling program, or leave out --net"
        )
    wide, high = (side - 2 * TAB_MM for side in sheet_mm)
    own = lay_triangles(surface.corners)
    for face in np.flatnonzero(left):
        left[face] = turn_to_fit(own[face][None], (wide, high))[1]
    found: list[Region] = []
    while left.any():
        seed = int(np.where(left, surface.area, -1).argmax())
        region = _grow_net(surface, seed, left, own[seed], (wide, high))
        left[region.faces] = False
        found.append(region)
    if len(found) > MOST_PIECES:
        raise ToolkitError(f"{len(found)} nets, of which a wrap has {MOST_PIECES} at most: take a larger --sheet-mm")
    found.sort(key=lambda region: -float(surface.area[region.faces].sum()))
    return [make_piece(surface, region, (wide, high)) for region in found]


def _grow_net(
    surface: Surface, seed: int, left: np.ndarray, first: np.ndarray, sheet_mm: tuple[float, float]
) -> Region:
    """Grow a net over as many of the remaining faces as fit beside each other on the sheet."""
    faces, flats = [seed], np.empty((int(left.sum()), 3, 2))
    flats[0] = first
    # faces in the same plane first, then over the longest edges: fewer folds, and longer ones
    queue: list[tuple[float, int, int, int]] = []  # minus the edge's length, the face behind it, row, edge
    done = {seed}

    def add_edges(row: int) -> None:
        for edge in range(3):
            face = int(surface.neighbour[faces[row], edge])
            if face >= 0 and left[face] and face not in done:
                length = surface.length[faces[row], edge]
                is_flat = surface.normals[face] @ surface.normals[faces[row]] > FLAT_COSINE
                heapq.heappush(queue, (-np.inf if is_flat else -length, face, row, edge))

    add_edges(0)
    while queue:
        _, face, row, edge = heapq.heappop(queue)
        if face in done:
            continue
        flat = _turn_over(surface, flats[row], faces[row], edge)
        so_far = flats[: len(faces)]
        if _overlap(flat, so_far).any() or not turn_to_fit(np.concatenate([so_far, flat[None]]), sheet_mm)[1]:
            continue  # another edge may lead to it
        flats[len(faces)] = flat
        faces.append(face)
        done.add(face)
        add_edges(len(faces) - 1)
    count = len(faces)
    return Region(np.array(faces), flats[:count], np.zeros((count, 3), bool))


def _turn_over(surface: Surface, flat: np.ndarray, face: int, edge: int) -> np.ndarray:
    """(3, 2) place of the neighbour across an edge of a face at `flat`."""
    other, own = surface.neighbour[face, edge], int(surface.across[face, edge])
    # the neighbour runs along the shared edge the other way
    start, end = flat[(edge + 1) % 3], flat[edge]
    along = (end - start) / np.linalg.norm(end - start)
    far, up = surface.apex[other, own]
    turned = np.empty((3, 2))
    turned[own], turned[(own + 1) % 3] = start, end
    turned[(own + 2) % 3] = start + far * along + up * np.array([-along[1], along[0]])
    return turned


def _overlap(polygon: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(k,) bool: triangles or quadrilaterals (k, c, 2) that overlap a convex polygon (c, 2), by separating axes."""
    apart = np.zeros(len(others), bool)
    for polygons in (polygon[None], others):
        sides = np.roll(polygons, -1, axis=1) - polygons
        across = np.stack([sides[..., 1], -sides[..., 0]], axis=-1)
        across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12)
        mine = np.einsum("kai,ci->kac", across, polygon)
        theirs = np.einsum("kai,kci->kac", np.broadcast_to(across, (len(others), *across.shape[1:])), others)
        gap = np.maximum(theirs.min(axis=2) - mine.max(axis=2), mine.min(axis=2) - theirs.max(axis=2))
        apart |= (gap >= -HAIR * np.ptp(polygon, axis=0).max()).any(axis=1)
    return ~apart


def find_tabs(surface: Surface, pieces: Sequence[FlatPiece]) -> tuple[list[Tab], int]:
    """Find a glue tab for each pair of edges that meet when folded, on the side with more room; count pairs without."""
    owner, flat = spread_pieces(surface, pieces)
    joined = find_joined(surface, owner, flat)
    taken = [piece.flat_mm for piece in pieces]  # tabs must not overlap them
    tabs: list[Tab] = []
    missed = 0
    face, edge = np.nonzero((owner >= 0)[:, None] & (surface.neighbour >= 0) & ~joined)
    for here in sorted(zip(face.tolist(), edge.tolist(), strict=True), key=lambda at: (-surface.length[at], at)):
        other = int(surface.neighbour[here]), int(surface.across[here])
        if owner[other[0]] < 0 or here > other:
            continue
        sides = [(at, _fit_tab(surface, flat, at, taken[owner[at[0]]])) for at in (here, other)]
        # the deeper tab
        (at, outline) = max(
            sides, key=lambda side: -1.0 if side[1] is None else float(np.linalg.norm(side[1][1] - side[1][2]))
        )
        if outline is None:
            missed += 1
            continue
        piece = int(owner[at[0]])
        tabs.append(Tab(piece, at, outline))
        halves = outline[[[0, 1, 2], [0, 2, 3]]]
        taken[piece] = np.concatenate([taken[piece], halves])
    return tabs, missed


def name_tabs(
    surface: Surface, pieces: Sequence[FlatPiece], seams: Sequence[Sequence[SeamRecord]]
) -> list[list[TabRecord]]:
    """Return the tabs of each net, named as the seams that they are glued at; a notice counts edges without a tab."""
    tabs, missed = find_tabs(surface, pieces)
    owner, _ = spread_pieces(surface, pieces)
    records: list[list[TabRecord]] = [[] for _ in pieces]
    for tab in tabs:
        meets = int(owner[surface.neighbour[tab.edge]]) + 1
        middle = tab.outline[:2].mean(axis=0)
        # the seam nearest to the tab's edge
        near = [seam for seam in seams[tab.piece] if seam.piece == meets]
        lines = [shapely.LineString([seam.from_mm, seam.middle_mm, seam.to_mm]) for seam in near]
        letter = near[int(np.argmin(shapely.distance(lines, shapely.Point(middle))))].letter if near else ""
        points = [(round(float(x), 4), round(float(y), 4)) for x, y in tab.outline]
        records[tab.piece].append(TabRecord(piece=meets, letter=letter, outline_mm=points))
    if missed:
        notice(f"{missed} edges have no room for a tab: glue them edge to edge, or back them with a strip")
    return records


def _fit_tab(surface: Surface, flat: np.ndarray, at: Edge, taken: np.ndarray) -> np.ndarray | None:
    """(4, 2) deepest tab on an edge without overlap, if there is room, sloped by 45° so that tabs do not meet."""
    start, end = flat[at[0], at[1]], flat[at[0], (at[1] + 1) % 3]
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    out = np.array([along[1], -along[0]])
    # not deeper than the face behind it, which it is glued to
    partner = int(surface.neighbour[at]), int(surface.across[at])
    deepest = min(TAB_MM, 0.4 * length, 0.8 * float(surface.apex[partner][1]))
    for depth in (deepest, 0.7 * deepest, 0.5 * deepest, 0.3 * deepest):
        if depth < LEAST_TAB_MM:
            return None
        outline = np.stack([
            end, start, start + depth * (along + out), end + depth * (out - along)
        ])  # fmt: skip
        # counter-clockwise as the faces are, slightly off the edge
        if not _overlap(outline + 1e-4 * out, taken).any():
            return outline
    return None
