"""A whole surface as a paper model: nets that are cut out, folded and glued, with a tab at each edge that is glued.

A net grows over the longest edges first, so that little is cut: the minimum perimeter heuristic of Straub and Prautzsch
2011, "Creating optimized cut-out sheets for paper models from meshes". Where a triangle would lie on another one, or
off the sheet, the next net begins.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toolkit.core.console import notice
from toolkit.core.errors import ToolkitError
from toolkit.objects.flatten import Region, Surface, lay_triangles
from toolkit.objects.seams import Edge, find_joined, spread_pieces
from toolkit.objects.spec import MOST_PIECES
from toolkit.objects.trim import make_piece, turn_to_fit
from toolkit.objects.wrap import FlatPiece, SeamRecord, TabRecord

MOST_FACES = 2_000
"""Nobody folds more."""
FOLD_DEG = 1.0
"""Edges of a net that are bent by more are folded."""
FLAT_COSINE = 1 - 1e-6
TAB_MM, LEAST_TAB_MM = 7.0, 2.0
"""Depth of a glue tab, and the least where there is little room."""
HAIR = 1e-6
"""Triangles are drawn in by this share before they are compared, so that neighbours do not touch."""


@dataclass(frozen=True)
class Tab:
    """A glue tab.

    Attributes:
        piece: index of the net that it is on.
        edge: face and edge of the mesh that it stands on.
        outline: (4, 2) in mm of the net, from the end of the edge back to its beginning on the outer side.
    """

    piece: int
    edge: Edge
    outline: np.ndarray


def unfold(surface: Surface, sheet_mm: tuple[float, float]) -> list[FlatPiece]:
    """All faces as nets that fold without stretch, largest first; faces larger than the sheet are left out.

    Args:
        surface: in mm.
        sheet_mm: largest net, with a tab's depth taken off all round.

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
    found.sort(key=lambda one: -float(surface.area[one.faces].sum()))
    return [make_piece(surface, region, (wide, high)) for region in found]


def _grow_net(
    surface: Surface, seed: int, left: np.ndarray, first: np.ndarray, sheet_mm: tuple[float, float]
) -> Region:
    """A net over as many of the faces that are left as lie beside each other on the sheet."""
    faces, flats = [seed], np.empty((int(left.sum()), 3, 2))
    flats[0] = first
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
    """(3, 2) where the neighbour across an edge of a face that lies at `flat` comes to lie."""
    other, own = surface.neighbour[face, edge], int(surface.across[face, edge])
    start, end = flat[(edge + 1) % 3], flat[edge]
    along = (end - start) / np.linalg.norm(end - start)
    far, up = surface.apex[other, own]
    turned = np.empty((3, 2))
    turned[own], turned[(own + 1) % 3] = start, end
    turned[(own + 2) % 3] = start + far * along + up * np.array([-along[1], along[0]])
    return turned


def _overlap(one: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(k,) bool: which of the triangles or quadrilaterals (k, c, 2) a convex polygon (c, 2) lies on, by their sides."""
    apart = np.zeros(len(others), bool)
    for polygons in (one[None], others):
        sides = np.roll(polygons, -1, axis=1) - polygons
        across = np.stack([sides[..., 1], -sides[..., 0]], axis=-1)
        across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12)
        mine = np.einsum("kai,ci->kac", across, one)
        theirs = np.einsum("kai,kci->kac", np.broadcast_to(across, (len(others), *across.shape[1:])), others)
        # a line between them that has each on a side of its own (separating axes)
        gap = np.maximum(theirs.min(axis=2) - mine.max(axis=2), mine.min(axis=2) - theirs.max(axis=2))
        apart |= (gap >= -HAIR * np.ptp(one, axis=0).max()).any(axis=1)
    return ~apart


def find_tabs(surface: Surface, pieces: Sequence[FlatPiece]) -> tuple[list[Tab], int]:
    """A glue tab for each pair of edges that meet when folded, on the side that has more room.

    Returns:
        The tabs, and how many pairs have none for want of room.
    """
    owner, flat = spread_pieces(surface, pieces)
    joined = find_joined(surface, owner, flat)
    taken = [piece.flat_mm for piece in pieces]  # what tabs must not lie on
    tabs: list[Tab] = []
    missed = 0
    face, edge = np.nonzero((owner >= 0)[:, None] & (surface.neighbour >= 0) & ~joined)
    for one in sorted(zip(face.tolist(), edge.tolist(), strict=True), key=lambda at: (-surface.length[at], at)):
        other = int(surface.neighbour[one]), int(surface.across[one])
        if owner[other[0]] < 0 or one > other:
            continue
        sides = [(at, _fit_tab(surface, flat, at, taken[owner[at[0]]])) for at in (one, other)]
        (at, outline) = max(sides, key=lambda side: -1.0 if side[1] is None else _depth(side[1]))
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
    """The tabs of each net, named as the seams that they are glued at; says how many edges go without one."""
    tabs, missed = find_tabs(surface, pieces)
    owner, _ = spread_pieces(surface, pieces)
    records: list[list[TabRecord]] = [[] for _ in pieces]
    for tab in tabs:
        meets = int(owner[surface.neighbour[tab.edge]]) + 1
        middle = tab.outline[:2].mean(axis=0)
        # the seam that runs along the edge that the tab stands on
        near = [seam for seam in seams[tab.piece] if seam.piece == meets]
        letter = min(near, key=lambda seam: _way_to(seam, middle)).letter if near else ""
        points = [(round(float(x), 4), round(float(y), 4)) for x, y in tab.outline]
        records[tab.piece].append(TabRecord(piece=meets, letter=letter, outline_mm=points))
    if missed:
        notice(f"{missed} edges have no room for a tab: glue them edge to edge, or back them with a strip")
    return records


def _way_to(seam: SeamRecord, point: np.ndarray) -> float:
    """Distance, mm, from a point to the line from a seam's beginning over its middle to its end."""
    import shapely

    return float(shapely.LineString([seam.from_mm, seam.middle_mm, seam.to_mm]).distance(shapely.Point(point)))


def _fit_tab(surface: Surface, flat: np.ndarray, at: Edge, taken: np.ndarray) -> np.ndarray | None:
    """(4, 2) the deepest tab on an edge that lies on nothing; None where there is no room.

    It is no deeper than the face that it is glued to, and slopes by 45° or more, so that tabs at a corner do not meet.
    """
    start, end = flat[at[0], at[1]], flat[at[0], (at[1] + 1) % 3]
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    out = np.array([along[1], -along[0]])
    partner = int(surface.neighbour[at]), int(surface.across[at])
    deepest = min(TAB_MM, 0.4 * length, 0.8 * float(surface.apex[partner][1]))
    for depth in (deepest, 0.7 * deepest, 0.5 * deepest, 0.3 * deepest):
        if depth < LEAST_TAB_MM:
            return None
        outline = np.stack([
            end, start, start + depth * (along + out), end + depth * (out - along)
        ])  # fmt: skip
        # counter-clockwise as the faces are, a hair off the edge that it stands on
        if not _overlap(outline + 1e-4 * out, taken).any():
            return outline
    return None


def _depth(outline: np.ndarray) -> float:
    """Return how far a tab reaches out."""
    return float(np.linalg.norm(outline[1] - outline[2])) / np.sqrt(2)
