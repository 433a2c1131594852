"""From a file's colours to a photograph's, in the form of a cube of nodes: smooth, and as free as printers need."""

from functools import lru_cache

import numpy as np
from scipy import sparse

from toolkit.imaging.printer import SOLIDS

NODES = 7
SMOOTHNESS = 0.03
"""Weight of the cube's squared second differences against one texel's squared miss; of 0.03 to 10, which were tried on
photographs of four printed patches, the least ΔE00 from one to another came of 0.03 to 0.1."""
SMALLNESS = 0.01
"""Likewise of how far a node lies from an affine map of the usual print."""
TINY = 1e-6
ROUNDS = 3


def cube_weights(colours: np.ndarray, nodes: int = NODES) -> sparse.csr_matrix:
    """(k, nodes³) weights of the nodes round each of (k, 3) colours in [0, 1]: what trilinear interpolation takes."""
    at = np.clip(np.asarray(colours, float), 0, 1) * (nodes - 1)
    low = np.minimum(at.astype(int), nodes - 2)
    share = at - low
    rows = np.arange(len(at))
    parts = []
    for step in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(step, share, 1 - share), axis=1)
        node = (low + step) @ [nodes * nodes, nodes, 1]
        parts.append(sparse.csr_matrix((weight, (rows, node)), shape=(len(at), nodes**3)))
    return sum(parts[1:], parts[0]).tocsr()


@lru_cache(maxsize=2)
def bending(nodes: int = NODES) -> np.ndarray:
    """(nodes³, nodes³) what a cube's values are weighed with, so that straight ones cost nothing.

    The sum of squared second differences along each side, and of mixed ones along each pair of sides.
    """
    identity = sparse.identity(nodes)
    slope = sparse.diags([-1.0, 1.0], [0, 1], shape=(nodes - 1, nodes))
    curve = sparse.diags([1.0, -2.0, 1.0], [0, 1, 2], shape=(nodes - 2, nodes))
    cost = sparse.csr_matrix((nodes**3, nodes**3))
    for axis in range(3):
        sides = [identity] * 3
        sides[axis] = curve
        D = sparse.kron(sparse.kron(sides[0], sides[1]), sides[2])
        cost = cost + D.T @ D
        sides = [slope] * 3
        sides[axis] = identity
        D = 0.5 * sparse.kron(sparse.kron(sides[0], sides[1]), sides[2])
        cost = cost + D.T @ D
    return np.asarray(cost.todense())


@lru_cache(maxsize=2)
def usual_print(nodes: int = NODES) -> np.ndarray:
    """(nodes³, 4) a one, and red, green and blue, sRGB-encoded, of what an offset press makes of each node.

    The solids are mixed as Neugebauer's equations say; real prints look like an affine map of it.
    """
    steps = np.arange(nodes) / (nodes - 1)
    places = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    return np.c_[np.ones(len(places)), cube_weights(places, 2) @ SOLIDS.reshape(8, 3)]


def solve_cube(weights: sparse.csr_matrix, seen: np.ndarray, trust: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The cube that fits what was seen, by robust least squares (Cauchy's weights).

    It is an affine map of the usual print, and what is added to it smooth and small: so colours that the patch lacks
    come out as inks would have them.

    Args:
        weights: (k, m) from `cube_weights`, or the same blurred over neighbours.
        seen: (k, c) values.
        trust: (k,) weight of each row, 0 where nothing is known.

    Returns:
        (m, c) nodes, and (k,) the rows' last weights.
    """
    m = weights.shape[1]
    usual = usual_print(round(m ** (1 / 3)))
    columns = sparse.hstack([weights @ usual, weights]).tocsr()
    rows = columns.T.tocsr()
    cost = np.zeros((m + usual.shape[1],) * 2)
    cost[-m:, -m:] = SMOOTHNESS * bending(round(m ** (1 / 3))) + SMALLNESS * np.eye(m)
    cost += TINY * np.eye(len(cost))
    weight = trust.astype(float)
    for _ in range(ROUNDS):
        weighted = columns.multiply(weight[:, None]).tocsr()
        found = np.linalg.solve((rows @ weighted).toarray() + cost, rows @ (weight[:, None] * seen))
        nodes = usual @ found[:-m] + found[-m:]
        miss = np.linalg.norm(seen - weights @ nodes, axis=1)
        scale = 3 * np.median(miss[trust > 0]) + TINY
        weight = trust / (1 + (miss / scale) ** 2)
    return nodes, weight
