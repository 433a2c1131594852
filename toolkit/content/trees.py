"""Trees and shrubs: a branching trunk and thousands of leaves as small kite-shaped faces."""

import numpy as np

from toolkit.content.modelling import Colour, tube
from toolkit.content.paint import finish, flat, fractal, grain, noise
from toolkit.content.pieces import Looks, Piece, Skin, merge, quads, solid
from toolkit.objects.mesh import Material
from toolkit.worlds.classes import SceneClass

TREE = SceneClass.TREE
GREENS: tuple[Colour, ...] = ((74, 104, 42), (92, 118, 50), (58, 92, 46), (108, 120, 52))
CELLS = 4


def bark(looks: Looks) -> Skin:
    """Furrowed bark, 1 m square."""
    if found := looks.known("bark"):
        return found
    rng, shape = looks.rng("bark"), (256, 256)
    furrow = np.abs(noise(rng, shape, (6, 34))) + 0.5 * np.abs(noise(rng, shape, (14, 60)))
    wood = flat(shape, (104, 90, 76)) * (0.62 + 0.6 * furrow)[..., None] + grain(rng, shape, 6)
    return looks.add(Material("bark", finish(wood), 0.95), (1.0, 1.0))


def leaf_sheet(looks: Looks, tone: int) -> Skin:
    """Leaves of many shades: one kite of foliage in each of `CELLS` x `CELLS` cells."""
    name = f"leaves-{tone}"
    if found := looks.known(name):
        return found
    rng, side = looks.rng(name), 32
    shape = (CELLS * side, CELLS * side)
    shade = np.kron(rng.uniform(0.62, 1.25, (CELLS, CELLS)), np.ones((side, side)))
    warm = np.kron(rng.normal(0, 8, (CELLS, CELLS)), np.ones((side, side)))
    speckle = 1 + 0.35 * fractal(rng, shape, 24, 3)
    leaves = flat(shape, GREENS[tone % len(GREENS)]) * (shade * speckle)[..., None]
    leaves[..., 0] += warm
    return looks.add(Material(name, finish(leaves), 0.8))


def leaves(at: np.ndarray, size_m: float, outward: np.ndarray, skin: Skin, rng: np.random.Generator) -> Piece:
    """Kites (n) round points, turned at random but rather outwards, seen from both sides by the renderer."""
    n = len(at)
    normal = outward * 1.2 + rng.normal(size=(n, 3)) * 0.8 + [0, 0, 0.4]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = np.cross(normal, rng.normal(size=(n, 3)))
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-6)
    across = np.cross(normal, along)
    size = size_m * rng.uniform(0.7, 1.35, (n, 1))
    corners = np.stack(
        [at - 0.6 * size * along, at + 0.4 * size * across, at + 0.7 * size * along, at - 0.4 * size * across], 1
    )
    cell = rng.integers(0, CELLS, (n, 2)) / CELLS
    uv = cell[:, None] + np.array([(0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.2, 0.8)]) / CELLS
    piece = quads(corners, skin, TREE, uv)
    # foliage is lit as a soft whole: normals lean out of the crown
    soft = np.repeat(outward * 1.4 + normal, 4, axis=0)
    soft /= np.maximum(np.linalg.norm(soft, axis=1, keepdims=True), 1e-6)
    flipped = np.einsum("ij,ij->i", soft, piece.normals) < 0
    soft[flipped] = piece.normals[flipped]
    return Piece(piece.vertices, soft.astype(np.float32), piece.uv, piece.faces, piece.material, piece.label)


def street_tree(looks: Looks, variant: int, height: float = 8.0, count: int = 430) -> Piece:
    """A broad-leaved tree: trunk, limbs, and clumps of leaves about the limbs' ends."""
    rng = looks.rng(f"tree-{variant}")
    fork = height * 0.33
    lean = rng.normal(0, 0.15, 2)
    trunk = np.array([
        (0, 0, 0), (*(lean * 0.4), fork * 0.5), (*lean, fork), (*(lean * 1.5), height * 0.6),
        (*(lean * 1.6), height * 0.8),
    ])  # fmt: skip
    parts = tube(trunk, [0.2, 0.16, 0.14, 0.08, 0.03], 6)
    tips = [np.array([*(lean * 1.6), height * 0.84])]
    for k in range(8):
        turn = 2.4 * k + rng.uniform(-0.3, 0.3)
        start = np.array([*lean, fork + (0.05 + 0.045 * k) * height])
        reach = height * rng.uniform(0.2, 0.32) * (1 - 0.05 * k)
        way = np.array([np.cos(turn), np.sin(turn), 0])
        tip = start + way * reach + [0, 0, height * rng.uniform(0.12, 0.26)]
        parts += tube(
            np.array([start, start + way * reach * 0.5 + [0, 0, height * 0.06], tip]), [0.075, 0.05, 0.02], 4, cap=False
        )
        tips.append(tip)
    pieces = [solid(parts, bark(looks), TREE, 60)]
    skin = leaf_sheet(looks, variant)
    centre = np.array([*lean, height * 0.62])
    each = count // len(tips)
    at, away = [], []
    for tip in tips:
        ball = rng.normal(size=(each, 3))
        ball /= np.linalg.norm(ball, axis=1, keepdims=True)
        radius = height * rng.uniform(0.14, 0.2)
        spread = radius * rng.uniform(0.45, 1.0, (each, 1)) ** 0.6
        at.append(tip + ball * spread * [1, 1, 0.8])
        out = at[-1] - centre
        away.append(0.6 * ball + 0.5 * out / np.linalg.norm(out, axis=1, keepdims=True))
    pieces.append(leaves(np.concatenate(at), 0.06 * height, np.concatenate(away), skin, rng))
    return merge(*pieces)


def conifer(looks: Looks, variant: int, height: float = 10.0, count: int = 500) -> Piece:
    """A spruce: tiers of drooping boughs."""
    rng = looks.rng(f"conifer-{variant}")
    trunk = tube(np.array([(0, 0, 0), (0, 0, height * 0.5), (0, 0, height)]), [0.18, 0.1, 0.02], 7)
    z = height * (0.12 + 0.88 * rng.random(count) ** 1.25)
    reach = (1 - z / height) * height * 0.24 + 0.1
    turn = rng.uniform(0, 2 * np.pi, count)
    way = np.column_stack([np.cos(turn), np.sin(turn), np.full(count, -0.25)])
    at = np.column_stack([np.zeros((count, 2)), z]) + way * (reach * rng.uniform(0.35, 1.0, count))[:, None]
    skin = leaf_sheet(looks, 2)
    return merge(solid(trunk, bark(looks), TREE, 60), leaves(at, 0.07 * height, way, skin, rng))


def shrub(looks: Looks, variant: int, radius: float = 0.6, count: int = 90) -> Piece:
    """A round bush."""
    rng = looks.rng(f"shrub-{variant}")
    ball = rng.normal(size=(count, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    ball[:, 2] = np.abs(ball[:, 2])
    at = ball * radius * rng.uniform(0.6, 1.0, (count, 1)) + [0, 0, 0.15 * radius]
    return leaves(at, 0.42 * radius, ball, leaf_sheet(looks, variant), rng)
