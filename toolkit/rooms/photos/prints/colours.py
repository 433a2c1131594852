"""Colours of a printed patch in a photograph against the file's: relative to paper, and as a cube of nodes."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy import sparse
from scipy.interpolate import NdBSpline

from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import delta_e2000, lab_of_linear, linear_to_srgb, srgb_to_linear
from toolkit.imaging.printer import SOLIDS, ColourError
from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.objects.spec import Margin
from toolkit.rooms.photos.prints.align import PatchWarp, draw_patch, sample_image
from toolkit.rooms.photos.prints.find import CELL_SHOWS, PatchSighting, shrink_image

COLOUR_PX = 200.0
"""Side at which colours are compared; finer photos are shrunk, which also averages their noise."""
CLIPPED = 250
RING_POINTS = 40
RING = (0.25, 0.75)
"""Part of the white margin's width that is read: the rest may mix with ink or tape."""
PAPER_SPREAD = 0.12
"""Largest root mean square deviation of paper's light from a smooth slope."""
LEAST_WHITE = 0.8
"""Least light of paper, against the brightest of the patch."""
LEAST_PIXELS = 200
WHITE_TEXELS = 0.75
"""Least linear light of the file's darkest channel, as the camera averages it, for texels that show paper."""


@dataclass(frozen=True)
class PrintedColours:
    """A patch's printed colours, pixel by pixel.

    Attributes:
        warp: of the patch in the photo, at the size (h, w) = `shape` of the comparison.
        rows, columns: (k,) the pixels.
        uv: (k, 2) their places on the patch.
        seen: (k, 3) linear light as a share of the paper's at that place.
        white_from: `texels`, `margin` or `strip`, the source of white.
    """

    warp: PatchWarp
    shape: tuple[int, int]
    rows: np.ndarray
    columns: np.ndarray
    uv: np.ndarray
    seen: np.ndarray
    white_from: str

    def draw(self, values: np.ndarray, blur_px: float = 0.0) -> np.ndarray:
        """(k, c) means over the pixels of values (n, n, c) on the patch, through a lens that blurs by `blur_px`."""
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
        white_from: as in `PrintedColours`.
    """

    error: ColourError
    bias: tuple[float, float, float]
    rms: tuple[float, float, float]
    white_from: str


def read_colours(
    image: np.ndarray, sighting: PatchSighting, size_mm: float, strip_white: np.ndarray | None = None,
    patch_pixels: np.ndarray | None = None, margin: Margin = "white",
) -> PrintedColours:  # fmt: skip
    """Read a patch's colours off a photo, relative to paper: texels that the file leaves white.

    With too few of them the white margin counts, and then the colour strip. The margin comes second: a patch that was
    cut tight may lie on a white desk.

    Args:
        image: (h, w, 3) uint8 sRGB.
        sighting: of the patch.
        size_mm: side of the patch, from which the margin's width follows.
        strip_white: (3,) linear light of paper on the colour strip.
        patch_pixels: (n, n, 3) uint8 sRGB, the file; without it no texels are known to be white.
        margin: what is on the paper around the patch; a print over it is no white.

    Raises:
        ToolkitError: there is no white, or too little of the patch shows and is not over-exposed.
    """
    # pixels of the patch that show and are not over-exposed
    # colours need fewer pixels than a place does
    scale = min(1.0, COLOUR_PX / sighting.warp.side_px)
    small, warp = shrink_image(image, scale), sighting.warp.scaled(scale)
    drawn = draw_patch(np.zeros((8, 8, 1), np.float32), warp, small.shape)
    if drawn is None:
        raise ToolkitError("the patch lies outside of the photo")
    # only where the picture agrees with the file: a finger or glare is no ink
    cell = (np.clip(drawn.uv, 0, 0.999) * len(sighting.agreement)).astype(int)
    shows = sighting.agreement[cell[..., 1], cell[..., 0]] >= CELL_SHOWS
    rows, columns = np.nonzero(drawn.inside & shows & (drawn.cut(small) < CLIPPED).all(axis=2))
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
    if white is None and margin == "white":
        brightest = np.percentile(light, 98, axis=0)
        white, white_from = _margin_white(small, warp, TAPE_MARGIN_MM / size_mm, brightest), "margin"
    if white is None:
        if strip_white is None:
            raise ToolkitError(
                "no white is seen: the paper round the patch is cut off, printed over, hidden or over-exposed: leave "
                "5 mm of it, or photograph the page with its colour strip"
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
    """Compare linear light (k, 3), as a share of paper's, with the light that the file means."""
    difference = linear_to_srgb(seen).astype(float) - linear_to_srgb(meant)
    bias, rms = difference.mean(axis=0), np.sqrt((difference**2).mean(axis=0))
    error = measure_error(seen, meant)
    return ColourComparison(error, tuple(bias.tolist()), tuple(rms.tolist()), white_from)


def measure_error(seen: np.ndarray, meant: np.ndarray) -> ColourError:
    """ΔE00 between linear colours (k, 3), 1 the white of both."""
    difference = delta_e2000(lab_of_linear(np.clip(seen, 0, 1.2)), lab_of_linear(np.clip(meant, 0, 1.2)))
    median, p95 = np.percentile(difference, [50, 95])
    return ColourError(median=round(float(median), 3), p95=round(float(p95), 3))


def _slope(uv: np.ndarray) -> np.ndarray:
    return np.c_[uv - 0.5, np.ones(len(uv))]


def _margin_white(photo: np.ndarray, warp: PatchWarp, width: float, brightest: np.ndarray) -> np.ndarray | None:
    """(3, 3) light of the white margin as a slope over (u, v): rows u, v and middle; None if it is not paper."""
    steps = np.linspace(0.02, 0.98, RING_POINTS)
    sides = []
    # points on three rings in the white margin
    for away in np.linspace(RING[0] * width, RING[1] * width, 3):
        for edge in (-away, 1 + away):
            line = np.full(RING_POINTS, edge)
            sides += [np.stack([steps, line], 1), np.stack([line, steps], 1)]
    uv = np.concatenate(sides)
    at = warp.to_pixels(uv)
    inside = ((at >= 0.5) & (at <= np.array(photo.shape[1::-1]) - 0.5)).all(axis=1)
    seen = sample_image(photo, at[:, None])[:, 0]
    # in the picture, and not over-exposed
    good = inside & (seen < CLIPPED).all(axis=1)
    if good.sum() < len(uv) / 3:
        return None
    # darker than the patch's own brightest colours: it is no paper, but the table
    fit = _fit_paper(srgb_to_linear(seen[good] / 255.0).astype(float), uv[good])
    return None if fit is None or (fit[2] < LEAST_WHITE * brightest).any() else fit


def _texel_white(light: np.ndarray, meant: np.ndarray, uv: np.ndarray) -> np.ndarray | None:
    """As `_margin_white`, from pixels (k, 3) at (u, v) that the file leaves nearly white; None with too few.

    `meant` is the linear light of the file, as the camera averages it, by which neighbouring ink is divided out.
    """
    paper = meant.min(axis=1) >= WHITE_TEXELS
    cells = np.unique((np.clip(uv[paper], 0, 0.999) * 3).astype(int), axis=0)
    if paper.sum() < LEAST_PIXELS or len(cells) < 5:
        return None  # too few, or all in the same corner, from which a slope would be guessed
    return _fit_paper(light[paper] / meant[paper], uv[paper])


def _fit_paper(light: np.ndarray, uv: np.ndarray) -> np.ndarray | None:
    """(3, 3) a slope over (u, v) through paper's light (k, 3); None if it is not as even as paper."""
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
"""Weight of the cube's squared second differences against a texel's squared miss. On photographs of four printed
patches, 0.03 to 0.1 predict other patches with the least ΔE00."""
SMALLNESS = 0.01
"""Weight of a node's squared distance from an affine map of the usual print."""
TINY = 1e-6
ROUNDS = 3


def cube_weights(colours: np.ndarray, nodes: int = NODES) -> sparse.csr_matrix:
    """(k, nodes³) weights of trilinear interpolation between the nodes round each of (k, 3) colours in [0, 1]."""
    # the matrix ends with the last node that a colour uses: one more colour, dropped again, uses the last of all
    at = np.clip(np.r_[np.asarray(colours, float), np.ones((1, 3))], 0, 1) * (nodes - 1)
    # linear splines: the knots are the nodes, the outermost twice
    knots = np.r_[0, np.arange(nodes), nodes - 1].astype(float)
    return sparse.csr_matrix(NdBSpline.design_matrix(at, (knots,) * 3, 1))[:-1]


@lru_cache(maxsize=2)
def bending(nodes: int = NODES) -> np.ndarray:
    """(nodes³, nodes³) quadratic form of a cube's bending; linear cubes cost nothing.

    It sums the squared second differences along each side, and the mixed differences along each pair of sides.
    """
    identity = sparse.identity(nodes)
    slope = sparse.diags([-1.0, 1.0], [0, 1], shape=(nodes - 1, nodes))
    curve = sparse.diags([1.0, -2.0, 1.0], [0, 1, 2], shape=(nodes - 2, nodes))
    # Kronecker products of small matrices: a difference along some sides, the identity along the others
    cost = sparse.csr_matrix((nodes**3, nodes**3))
    for axis in range(3):
        for own, others, share in ((curve, identity, 1.0), (identity, slope, 0.5)):
            sides = [others] * 3
            sides[axis] = own
            D = share * sparse.kron(sparse.kron(sides[0], sides[1]), sides[2])
            cost = cost + D.T @ D
    return np.asarray(cost.todense())


@lru_cache(maxsize=2)
def usual_print(nodes: int = NODES) -> np.ndarray:
    """(nodes³, 4) 1 and the sRGB-encoded red, green and blue of an offset print of each node.

    Neugebauer's equations mix the solids; real prints look like an affine map of it.
    """
    steps = np.arange(nodes) / (nodes - 1)
    places = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    return np.c_[np.ones(len(places)), cube_weights(places, 2) @ SOLIDS.reshape(8, 3)]


def solve_cube(weights: sparse.csr_matrix, seen: np.ndarray, trust: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit the cube to seen values (k, c) by robust least squares (Cauchy's weights).

    It is an affine map of the usual print plus a smooth and small correction, so that colours that the patch lacks
    come out as inks.

    Args:
        weights: (k, m) from `cube_weights`, or the same blurred over neighbours.
        seen: (k, c) values.
        trust: (k,) weight of each row, 0 for unknown values.

    Returns:
        (m, c) nodes, and (k,) the rows' last weights.
    """
    m = weights.shape[1]
    usual = usual_print(round(m ** (1 / 3)))
    # two parts of the unknowns: the affine map of the usual print, free, and a correction, which costs
    columns = sparse.hstack([weights @ usual, weights]).tocsr()
    rows = columns.T.tocsr()
    cost = np.zeros((m + usual.shape[1],) * 2)
    cost[-m:, -m:] = SMOOTHNESS * bending(round(m ** (1 / 3))) + SMALLNESS * np.eye(m)
    cost += TINY * np.eye(len(cost))
    # robust least squares: texels that miss the fit weigh less in the next round
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
