"""Seams, at which edges of pieces meet, and lines along which a piece is folded."""

from collections.abc import Iterable, Sequence

import numpy as np

from toolkit.core.text import name_letter
from toolkit.rooms.wraps.cutting.flatten import Surface
from toolkit.rooms.wraps.wrap import FlatPiece, Point, SeamRecord

LEAST_SEAM_MM = 8.0
"""Shorter ones need no letter."""
FOLD_DEG = 30.0
"""Edges bent more sharply than this are folds."""
SAME_MM = 1e-6
"""Corners closer than this on a piece are one."""


def find_seams(surface: Surface, pieces: Sequence[FlatPiece]) -> list[list[SeamRecord]]:
    """Find the seams of each piece, each with a letter for both of its sides."""
    # the border of each piece as closed loops of edges
    owner, flat = spread_pieces(surface, pieces)
    joined = find_joined(surface, owner, flat)
    loops = [_walk_round(surface, piece.faces, joined) for piece in pieces]
    # a run is a stretch of a loop that meets the same piece; both sides' runs make the seam
    run = np.full((*owner.shape, 3), -1)
    count = 0
    for around in loops:
        for loop in around:
            partner = [_partner(surface, owner, edge) for edge in loop]
            for part in _split_loop(loop, partner):
                for edge in part:
                    run[edge] = count
                count += 1
    # letters in the order of the walk; a seam's other side meets the same key and gets the same letter
    letters: dict[tuple[int, int], str] = {}
    seams: list[list[SeamRecord]] = []
    for around in loops:
        own: list[SeamRecord] = []
        for loop in around:
            keys = [_seam_of(surface, owner, run, edge) for edge in loop]
            for part in _split_loop(loop, keys):
                key = _seam_of(surface, owner, run, part[0])
                path = np.array([flat[f, e] for f, e in part] + [flat[part[-1][0], (part[-1][1] + 1) % 3]])
                way = np.r_[0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
                if key is None or way[-1] < LEAST_SEAM_MM:
                    continue
                letter = letters.setdefault(key, name_letter(len(letters)))
                # the middle of the seam, by length, for its letter
                middle = (float(np.interp(way[-1] / 2, way, path[:, i])) for i in range(2))
                other = int(owner[surface.neighbour[part[0]]])
                ends = [_point(path[0]), _point(path[-1]), _point(middle)]
                own.append(SeamRecord(
                    piece=other + 1, letter=letter, from_mm=ends[0], to_mm=ends[1], middle_mm=ends[2]
                ))  # fmt: skip
        seams.append(own)
    return seams


def find_folds(
    surface: Surface, piece: FlatPiece, least_deg: float = FOLD_DEG
) -> tuple[list[tuple[Point, Point]], list[tuple[Point, Point]]]:
    """Find edges inside a piece that are bent by more, from and to in mm; and those that are valleys."""
    owner, flat = spread_pieces(surface, [piece])
    joined = find_joined(surface, owner, flat)
    face, edge = np.nonzero(joined[piece.faces])
    face = piece.faces[face]
    other = surface.neighbour[face, edge]
    # an edge inside the piece, once, where the faces turn by more
    cosine = (surface.normals[face] * surface.normals[other]).sum(axis=1)
    sharp = (face < other) & (cosine < np.cos(np.radians(least_deg)))
    face, edge, other = face[sharp], edge[sharp], other[sharp]
    # a valley's other face rises above this face
    apex = surface.corners[other, (surface.across[face, edge] + 2) % 3]
    rises = ((apex - surface.corners[face, edge]) * surface.normals[face]).sum(axis=1) > 0
    lines = [(_point(flat[f, e]), _point(flat[f, (e + 1) % 3])) for f, e in zip(face, edge, strict=True)]
    return lines, [line for line, up in zip(lines, rises, strict=True) if up]


def find_joined(surface: Surface, owner: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """(m, 3) bool: edges whose two faces are together on the same piece; `owner` and `flat` as of `spread_pieces`."""
    face, edge = np.nonzero((surface.neighbour >= 0) & (owner >= 0)[:, None])
    other, own = surface.neighbour[face, edge], surface.across[face, edge]
    gap = np.abs(flat[face, edge] - flat[other, (own + 1) % 3]).max(axis=1)
    gap = np.maximum(gap, np.abs(flat[face, (edge + 1) % 3] - flat[other, own]).max(axis=1))
    joined = np.zeros(surface.neighbour.shape, bool)
    joined[face, edge] = (owner[face] == owner[other]) & (gap <= SAME_MM)
    return joined


Edge = tuple[int, int]


def spread_pieces(surface: Surface, pieces: Sequence[FlatPiece]) -> tuple[np.ndarray, np.ndarray]:
    """(m,) index of the piece of each face of the mesh, -1 for none, and (m, 3, 2) its place on the piece."""
    owner, flat = np.full(len(surface.faces), -1), np.zeros((len(surface.faces), 3, 2))
    for number, piece in enumerate(pieces):
        owner[piece.faces], flat[piece.faces] = number, piece.flat_mm
    return owner, flat


def _walk_round(surface: Surface, faces: np.ndarray, joined: np.ndarray) -> list[list[Edge]]:
    """Return the loops of edges round a piece, each face and edge, in order."""
    # edges of the piece that no face of the same piece lies behind
    rows, edges = np.nonzero(~joined[faces])
    left = set(zip(faces[rows].tolist(), edges.tolist(), strict=True))
    loops = []
    while left:
        # the least edge begins, so that the same mesh gives the same loops
        first = edge = min(left)
        loop = []
        while edge in left:
            left.remove(edge)
            loop.append(edge)
            face, side = edge[0], (edge[1] + 1) % 3
            while joined[face, side]:  # turn about the corner, from face to face
                face, side = int(surface.neighbour[face, side]), (int(surface.across[face, side]) + 1) % 3
            edge = (face, side)
        loops.append(loop)
        assert edge == first
    return loops


def _split_loop(loop: list[Edge], labels: Sequence[object]) -> list[list[Edge]]:
    """Split a loop into parts of the same label; the part across its beginning stays whole."""
    cuts = [k for k in range(len(loop)) if labels[k] != labels[k - 1]]
    if not cuts:
        return [loop]
    return [
        loop[start:end] if start < end else loop[start:] + loop[:end]
        for start, end in zip(cuts, [*cuts[1:], cuts[0]], strict=True)
    ]


def _partner(surface: Surface, owner: np.ndarray, edge: Edge) -> int:
    other = int(surface.neighbour[edge])
    return int(owner[other]) if other >= 0 else -1


def _seam_of(surface: Surface, owner: np.ndarray, run: np.ndarray, edge: Edge) -> tuple[int, int] | None:
    """Return the numbers of the two runs that meet at an edge; None without a piece across it."""
    if _partner(surface, owner, edge) < 0:
        return None
    runs = int(run[edge]), int(run[surface.neighbour[edge], surface.across[edge]])
    return min(runs), max(runs)


def _point(place: Iterable[float]) -> Point:
    x, y = place
    return round(float(x), 4), round(float(y), 4)
