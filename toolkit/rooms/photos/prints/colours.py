"""The colours of a printed patch in a photograph against the file's: paper taken as white, and as a cube of nodes."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy import sparse

from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import delta_e2000, lab_of_linear, linear_to_srgb, srgb_to_linear
from toolkit.imaging.printer import SOLIDS, ColourError
from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.rooms.photos.prints.align import Drawn, PatchWarp, draw_patch, sample_image
from toolkit.rooms.photos.prints.find import CELL_SHOWS, PatchSighting, shrink_image

COLOUR_PX = 200.0
"""Side at which colours are compared; finer photos are shrunk, which also averages their noise."""
CLIPPED = 250
RING_POINTS = 40
RING = (0.25, 0.75)
"""Share of the white margin's width that is looked at: not where ink or tape's edge may mix in."""
PAPER_SPREAD = 0.12
"""Paper counts as paper where its light differs by no more than this, root mean square, from a smooth slope."""
LEAST_WHITE = 0.8
"""And where it is at least this bright, against the brightest of the patch."""
LEAST_PIXELS = 200
WHITE_TEXELS = 0.75
"""Linear light that the file has in its darkest channel, as the camera averages it, where the patch shows paper."""


@dataclass(frozen=True)
class PrintedColours:
    """A patch's printed colours, pixel by pixel.

    Attributes:
        warp: of the patch in the photo, as large as it was compared.
        shape: (h, w) of that photo.
        rows, columns: (k,) the pixels.
        uv: (k, 2) their places on the patch.
        seen: (k, 3) linear light as a share of the paper's at that place.
        white_from: `texels`, `margin` or `strip`: what was taken as white.
    """

    warp: PatchWarp
    shape: tuple[int, int]
    rows: np.ndarray
    columns: np.ndarray
    uv: np.ndarray
    seen: np.ndarray
    white_from: str

    def draw(self, values: np.ndarray, blur_px: float = 0.0) -> np.ndarray:
        """(k, c) what the pixels average of values (n, n, c) on the patch, through a lens that blurs by `blur_px`."""
        drawn = draw_patch(np.ascontiguousarray(values, np.float32), self.warp, self.shape)
        if drawn is None:
            raise ToolkitError("the patch lies outside of the photo")
        picture = drawn.picture
        if blur_px:
            picture = cv2.GaussianBlur(picture, (0, 0), blur_px).reshape(picture.shape)
        return picture[self.rows - drawn.top, self.columns - drawn.left].astype(float)


@dataclass(frozen=True)
class ColourComparison:
    """A print against its file.

    Attributes:
        error: ΔE00 over the pixels.
        bias: (3,) mean of print less file in red, green and blue, sRGB-encoded, so that -0.1 is a tenth darker.
        rms: (3,) root mean square of the same.
        n_pixels: that were compared.
        white_from: as in `PrintedColours`.
    """

    error: ColourError
    bias: tuple[float, float, float]
    rms: tuple[float, float, float]
    n_pixels: int
    white_from: str


def read_colours(
    image: np.ndarray, sighting: PatchSighting, size_mm: float, strip_white: np.ndarray | None = None,
    patch_pixels: np.ndarray | None = None,
) -> PrintedColours:  # fmt: skip
    """Read a patch's colours off a photo, its light evened out by paper: texels that the file leaves white.

    Where it leaves too few, the white margin around it counts, and then the colour strip. What lies beside a patch that
    was cut tight may be a white desk, so the margin comes second.

    Args:
        image: (h, w, 3) uint8 sRGB.
        sighting: of the patch.
        size_mm: side of the patch, which says how wide the margin is beside it.
        strip_white: (3,) linear light of bare paper on the colour strip, used where the margin was cut off or hidden.
        patch_pixels: (n, n, 3) uint8 sRGB, the file; without it nothing is known of white texels.

    Raises:
        ToolkitError: there is no white to go by, or too little of the patch shows and is not over-exposed.
    """
    # pixels of the patch that show and are not over-exposed
    scale = min(1.0, COLOUR_PX / sighting.warp.side_px)
    small, warp = shrink_image(image, scale), sighting.warp.scaled(scale)
    drawn = draw_patch(np.zeros((8, 8, 1), np.float32), warp, small.shape)
    if drawn is None:
        raise ToolkitError("the patch lies outside of the photo")
    rows, columns = _usable(small, drawn, sighting)
    if len(rows) < LEAST_PIXELS:
        raise ToolkitError(
            f"only {len(rows)} pixels of the patch show and are not over-exposed, at least {LEAST_PIXELS} are "
            "needed: take the photo nearer, or darker"
        )
    uv = drawn.uv[rows, columns]
    light = srgb_to_linear(small[rows + drawn.top, columns + drawn.left] / 255.0).astype(float)
    # white by the file's brightest texels, else by the margin, else by the strip
    white, white_from = None, "texels"
    if patch_pixels is not None:
        meant = draw_patch(srgb_to_linear(patch_pixels / 255.0).astype(np.float32), warp, small.shape)
        white = None if meant is None else _texel_white(light, meant.picture[rows, columns], uv)
    if white is None:
        white, white_from = (
            _margin_white(small, warp, TAPE_MARGIN_MM / size_mm, np.percentile(light, 98, axis=0)),
            "margin",
        )
    if white is None:
        if strip_white is None:
            raise ToolkitError(
                "no white to go by: the paper round the patch is cut off, hidden or over-exposed: leave 5 mm of it, or "
                "photograph the page with its colour strip"
            )
        white, white_from = np.vstack([np.zeros((2, 3)), strip_white]), "strip"
    # colours as a share of white, which may change over the sheet
    seen = light / (_slope(uv) @ white)
    rows, columns = rows + drawn.top, columns + drawn.left
    return PrintedColours(warp, small.shape[:2], rows, columns, uv, seen=seen, white_from=white_from)


def compare_colours(colours: PrintedColours, patch_pixels: np.ndarray) -> ColourComparison:
    """Printed-colour error: the print against the file (n, n, 3) uint8 sRGB, pixel by pixel."""
    return compare_light(colours.seen, colours.draw(srgb_to_linear(patch_pixels / 255.0)), colours.white_from)


def compare_light(seen: np.ndarray, meant: np.ndarray, white_from: str) -> ColourComparison:
    """The same of linear light (k, 3), as a share of paper's, against what the file means."""
    difference = linear_to_srgb(seen).astype(float) - linear_to_srgb(meant)
    bias, rms = difference.mean(axis=0), np.sqrt((difference**2).mean(axis=0))
    return ColourComparison(
        measure_error(seen, meant), tuple(bias.tolist()), tuple(rms.tolist()), len(meant), white_from
    )


def measure_error(seen: np.ndarray, meant: np.ndarray) -> ColourError:
    """ΔE00 between linear colours (k, 3), 1 the white of both."""
    difference = delta_e2000(lab_of_linear(np.clip(seen, 0, 1.2)), lab_of_linear(np.clip(meant, 0, 1.2)))
    median, p95 = np.percentile(difference, [50, 95])
    return ColourError(median=round(float(median), 3), p95=round(float(p95), 3))


def _usable(photo: np.ndarray, drawn: Drawn, sighting: PatchSighting) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns in the cut of pixels that show the patch, unhidden and not over-exposed."""
    cells = len(sighting.agreement)
    cell = (np.clip(drawn.uv, 0, 0.999) * cells).astype(int)
    shows = sighting.agreement[cell[..., 1], cell[..., 0]] >= CELL_SHOWS
    rows, columns = np.nonzero(drawn.inside & shows & (drawn.cut(photo) < CLIPPED).all(axis=2))
    return rows, columns


def _slope(uv: np.ndarray) -> np.ndarray:
    return np.c_[uv - 0.5, np.ones(len(uv))]


def _margin_white(photo: np.ndarray, warp: PatchWarp, width: float, brightest: np.ndarray) -> np.ndarray | None:
    """(3, 3) light of the white margin as a slope over (u, v): rows u, v and middle; None where it is not paper."""
    steps = np.linspace(0.02, 0.98, RING_POINTS)
    sides = []
    for away in np.linspace(RING[0] * width, RING[1] * width, 3):
        for edge in (-away, 1 + away):
            sides += [
                np.stack([steps, np.full(RING_POINTS, edge)], 1),
                np.stack([np.full(RING_POINTS, edge), steps], 1),
            ]
    uv = np.concatenate(sides)
    at = warp.to_pixels(uv)
    inside = ((at >= 0.5) & (at <= np.array(photo.shape[1::-1]) - 0.5)).all(axis=1)
    seen = sample_image(photo, at[:, None])[:, 0]
    good = inside & (seen < CLIPPED).all(axis=1)
    if good.sum() < len(uv) / 3:
        return None
    fit = _fit_paper(srgb_to_linear(seen[good] / 255.0).astype(float), uv[good])
    return None if fit is None or (fit[2] < LEAST_WHITE * brightest).any() else fit


def _texel_white(light: np.ndarray, meant: np.ndarray, uv: np.ndarray) -> np.ndarray | None:
    """As `_margin_white`, from pixels (k, 3) of the patch that the file leaves nearly white; None where they are few.

    Args:
        light: (k, 3) linear light.
        meant: (k, 3) linear light of the file, as the camera averages it: what ink lies beside is divided out.
        uv: (k, 2) places on the patch.
    """
    paper = meant.min(axis=1) >= WHITE_TEXELS
    cells = np.unique((np.clip(uv[paper], 0, 0.999) * 3).astype(int), axis=0)
    if paper.sum() < LEAST_PIXELS or len(cells) < 5:
        return None  # too few, or all in one corner, from which a slope would be guessed
    return _fit_paper(light[paper] / meant[paper], uv[paper])


def _fit_paper(light: np.ndarray, uv: np.ndarray) -> np.ndarray | None:
    """(3, 3) a slope over (u, v) through paper's light (k, 3); None where it is not as even as paper."""
    terms, weight = _slope(uv), np.ones(len(light))
    for _ in range(12):
        fit = np.linalg.lstsq(terms * weight[:, None], light * weight[:, None], rcond=None)[0]
        miss = (light - terms @ fit).mean(axis=1)
        # what hides paper is darker than it: the brighter side is trusted more
        scale = np.maximum(np.median(np.abs(miss)), 0.01) * np.where(miss < 0, 1.0, 3.0)
        weight = 1 / (1 + (miss / scale) ** 2)
    # relative to the light in the middle, so that dark and bright photographs are judged alike
    spread = np.sqrt((weight * miss**2).sum() / weight.sum()) / fit[2].mean()
    # the slope may not cross zero within the patch, or it was fitted to something else
    corners = _slope(np.array([[0, 0], [1, 0], [0, 1], [1, 1.0]])) @ fit
    return None if spread > PAPER_SPREAD or (corners <= 0.01).any() else fit


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
    # the eight corners of the cell that the colour lies in; weights are products of the shares along each side
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
    # Kronecker products: one small difference matrix for the side that is differenced, identities for the others
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
        # three times the median: half of the texels lie well within it whatever the noise
        scale = 3 * np.median(miss[trust > 0]) + TINY
        weight = trust / (1 + (miss / scale) ** 2)
    return nodes, weight
