"""Fit a print profile: from the colours of a file and its colour strip to those of photographs of its print."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np

from toolkit.imaging.colour import srgb_to_linear
from toolkit.imaging.printer import ColourError, Exponents, raise_terms
from toolkit.printing.marks import STRIP
from toolkit.rig.markers import find_markers
from toolkit.rooms.photos.prints.align import map_points, sample_image
from toolkit.rooms.photos.prints.colours import PrintedColours, measure_error

INSET = 0.2
"""Share of a cell's side that is left out at each edge, where camera blur mixes neighbours."""
SAMPLE_PX = 9
LEAST_CELL_PX = 6.0
CLIPPED = 253
LARGEST_MISS_MM = 0.8


@dataclass(frozen=True)
class StripReading:
    """Colours of the strip's cells in a photo.

    Attributes:
        names: of the swatches.
        file_srgb: (k, 3) uint8, of the file.
        seen_linear: (k, 3) float, linear light of the photo: median over the cell's middle.
        clipped: (k,) bool, whether the photo is over-exposed there.
        homography: (3, 3) from millimetres on the strip, x right and y down, to pixels.
    """

    names: tuple[str, ...]
    file_srgb: np.ndarray
    seen_linear: np.ndarray
    clipped: np.ndarray
    homography: np.ndarray

    @property
    def white_linear(self) -> np.ndarray:
        """(3,) linear light of paper: mean of the cells that the file leaves white."""
        return self.seen_linear[(self.file_srgb == 255).all(axis=1)].mean(axis=0)


def read_strip(image: np.ndarray) -> StripReading | None:
    """Read the strip in (h, w, 3) uint8 sRGB; None without its two markers, or with cells under 6 pixels wide."""
    H = _find_strip(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    if H is None:
        return None
    side = STRIP.swatches[0].side_mm
    corners = map_points(H, STRIP.swatch_corners_mm().reshape(-1, 2)).reshape(-1, 4, 2)
    if np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).min() < LEAST_CELL_PX:
        return None
    # samples inside each cell, away from its border, where ink and lens mix the colours
    steps = ((np.arange(SAMPLE_PX) + 0.5) / SAMPLE_PX - 0.5) * (1 - 2 * INSET) * side
    offsets = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    places = map_points(H, (STRIP.centres_mm[:, None] + offsets).reshape(-1, 2))
    at = places.reshape(len(STRIP.swatches), -1, 2)
    if (at < 0).any() or (at[..., 0] > image.shape[1]).any() or (at[..., 1] > image.shape[0]).any():
        return None
    seen = sample_image(image, at)
    # the median: a speck or a reflection in a cell does not count
    linear = np.median(srgb_to_linear(seen / 255.0), axis=1)
    clipped = (np.median(seen, axis=1) >= CLIPPED).any(axis=1)
    return StripReading(STRIP.names, STRIP.srgb, linear, clipped, H)


def _find_strip(grey: np.ndarray) -> np.ndarray | None:
    """(3, 3) from millimetres on the strip to pixels; None without both of its markers."""
    corners = {number: corner + 0.5 for number, corner in find_markers(STRIP.dictionary, grey, refined=True)}
    wanted = list(STRIP.marker_corners)
    if not all(number in corners for number in wanted):
        return None
    printed = STRIP.marker_corners_mm(wanted).reshape(-1, 2)
    pixels = np.concatenate([corners[number] for number in wanted])
    H, _ = cv2.findHomography(printed, pixels)
    if H is None:
        return None
    # a foreign marker, or a bent strip, does not map back to its own corners
    back = map_points(np.linalg.inv(H), pixels)
    return H if np.abs(back - printed).max() < LARGEST_MISS_MM else None


FOLDS = 5
CELLS = 10
"""Cells each way of the patch; whole cells are held out, as neighbouring pixels are alike."""
MOST_PIXELS = 12_000
POWERS = (1.0, 1.4, 1.8, 2.2, 2.6)
BLURS_PX = (0.0, 0.5, 0.8, 1.2, 1.8)
SIMPLER = 1.03
"""Largest factor between the error of a model with fewer terms and that of the best model."""
STRIP_SHARE = 0.25
"""Weight of a strip, all its cells together, against all of a photo's pixels."""
DARKEST = 0.02
TINY = 1e-6
ROUNDS = 4


def list_terms(degree: int, each: int) -> tuple[Exponents, ...]:
    """Exponents of red, green, blue: none above `each`, their sum at most `degree`."""
    terms = [term for term in product(range(each + 1), repeat=3) if sum(term) <= degree]
    return tuple((r, g, b) for r, g, b in sorted(terms, key=lambda term: (sum(term), term)))


MODELS: dict[str, tuple[Exponents, ...]] = {
    "matrix": list_terms(1, 1),
    "solids": list_terms(3, 1),
    "quadratic": list_terms(2, 2),
    "cubic": list_terms(3, 3),
}
"""From few terms to many: 3×3 and offset; the eight solids (Neugebauer); all of degree two; all of degree three."""


@dataclass(frozen=True)
class FittedColours:
    """A fitted transform, see `PrintProfile`; `tried` has the held-out median ΔE00 of the best power of each model."""

    model: str
    power: float
    exponents: tuple[Exponents, ...]
    coefficients: np.ndarray
    without: ColourError
    held_out: ColourError
    n_samples: int
    strip_cells: int
    tried: dict[str, float]


@dataclass(frozen=True)
class _Samples:
    """Rows of the fit: pixels of every photo, then cells of every strip.

    Attributes:
        terms: by power, (k, terms of `MODELS["cubic"]`) mean of every term over each row.
        meant: (k, 3) linear light that the file means.
        seen: (k, 3) linear light as a share of paper's.
        weight: (k, 1) of each row.
        fold: (k,) part of the patch; -1 for the strip, which is never held out.
    """

    terms: dict[float, np.ndarray]
    meant: np.ndarray
    seen: np.ndarray
    weight: np.ndarray
    fold: np.ndarray


def fit_colours(
    colours: Sequence[PrintedColours], patch_pixels: np.ndarray, strips: Sequence[StripReading] = ()
) -> FittedColours:
    """Fit the colour transform from file to print, and choose its form by parts of the patch that are held out.

    A pixel averages texels in linear light. The transform is linear in its coefficients, so its terms are averaged
    alike, and least squares give the coefficients. They are weighted to the eye, and Cauchy's weights exclude glare and
    shadow.

    Args:
        colours: of the patch in photos of the same print.
        patch_pixels: (n, n, 3) uint8 sRGB, the file.
        strips: the colour strip in such photos; its colours are shares of its own white.
    """
    return _fit_samples(_gather(colours, patch_pixels, strips))


def fit_texels(patches: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> FittedColours:
    """Fit the transform to texels of several photographs, and choose its form by whole files that are held out.

    With a single file parts of it are held out.

    Args:
        patches: of each photograph, the file (n, n, 3) uint8 sRGB, the linear light of its texels (n², 3) as a share of
            paper's, and weights (n²,), 0 for hidden texels.
    """
    # photographs of the same file share a fold, or a file would be predicted from itself
    kinds = [file.tobytes() for file, _, _ in patches]
    which = [sorted(set(kinds)).index(kind) for kind in kinds]
    files, folds = [], []
    for (file, _, trust), number in zip(patches, which, strict=True):
        n = file.shape[0]
        rows, columns = np.mgrid[:n, :n] * CELLS // n
        # a step of two columns a row: neighbouring cells never lie in one fold
        cells = ((columns + 2 * rows) % FOLDS).ravel()
        folds.append((cells if len(set(which)) == 1 else np.full(n * n, number))[trust > 0])
        files.append(file.reshape(-1, 3)[trust > 0] / 255.0)
    stated = np.concatenate(files)
    seen = np.concatenate([part[trust > 0] for _, part, trust in patches])
    # terms for every power that is tried
    terms = {power: raise_terms(stated, power, MODELS["cubic"]) for power in POWERS}
    weight = np.ones((len(stated), 1))
    return _fit_samples(_Samples(terms, srgb_to_linear(stated), seen, weight, np.concatenate(folds)))


def _fit_samples(samples: _Samples) -> FittedColours:
    """Fit the form and power that best predict the held-out parts to all samples."""
    # cells of the colour strip have fold -1: they are fitted to, and never held out
    of_patch = samples.fold >= 0
    answers = {(name, power): _cross_validate(samples, power, MODELS[name]) for name in MODELS for power in POWERS}
    # the best power of each form, then the simplest form that predicts about as well as the best
    best_power = {name: min(POWERS, key=lambda power: answers[name, power].median) for name in MODELS}
    tried = {name: answers[name, power].median for name, power in best_power.items()}
    # from few terms to many, so that the first that is good enough is the simplest
    name = next(name for name in MODELS if tried[name] <= SIMPLER * min(tried.values()))
    power, exponents = best_power[name], MODELS[name]
    coefficients = _solve(_columns(samples, power, exponents), samples.seen, samples.weight)
    return FittedColours(
        name, power, exponents, coefficients, measure_error(samples.seen[of_patch], samples.meant[of_patch]),
        held_out=answers[name, power], n_samples=len(of_patch), strip_cells=int((~of_patch).sum()), tried=tried,
    )  # fmt: skip


def _gather(colours: Sequence[PrintedColours], patch_pixels: np.ndarray, strips: Sequence[StripReading]) -> _Samples:
    most = max(1, MOST_PIXELS // len(colours))
    file = patch_pixels / 255.0
    rows: dict[float, list[np.ndarray]] = {power: [] for power in POWERS}
    meant, seen, weight, fold = [], [], [], []
    # pixels of the patch in each photo, spread evenly
    for part in colours:
        kept = np.linspace(0, len(part.seen) - 1, min(most, len(part.seen))).round().astype(int)
        blur_px = _find_blur(part, file, kept)
        for power in POWERS:
            rows[power].append(part.draw(raise_terms(file, power, MODELS["cubic"]), blur_px)[kept])
        meant.append(part.draw(srgb_to_linear(file), blur_px)[kept])
        seen.append(part.seen[kept])
        weight.append(np.ones(len(kept)))
        cell = (np.clip(part.uv[kept], 0, 0.999) * CELLS).astype(int)
        fold.append((cell[:, 0] + 2 * cell[:, 1]) % FOLDS)
    # cells of the strips that are not over-exposed
    pixels = sum(len(part) for part in seen)
    for strip in strips:
        good = ~strip.clipped
        if not good.any():
            continue
        stated = strip.file_srgb[good] / 255.0
        for power in POWERS:
            rows[power].append(raise_terms(stated, power, MODELS["cubic"]))
        meant.append(srgb_to_linear(stated))
        seen.append(strip.seen_linear[good] / strip.white_linear)
        # divided by cells and strips: together they weigh `STRIP_SHARE` of all pixels
        weight.append(np.full(good.sum(), STRIP_SHARE * pixels / len(strips) / good.sum()))
        fold.append(np.full(good.sum(), -1))
    return _Samples(
        {power: np.concatenate(parts) for power, parts in rows.items()}, np.concatenate(meant), np.concatenate(seen),
        np.concatenate(weight)[:, None], np.concatenate(fold),
    )  # fmt: skip


def _find_blur(part: PrintedColours, file: np.ndarray, kept: np.ndarray) -> float:
    """Return the blur of the lens, pixels, at which a matrix fits the photo best."""

    def mean_square_error(blur_px: float) -> float:
        # a matrix is enough to compare blurs: it fits the inks equally badly at each blur
        terms = np.c_[np.ones(len(kept)), part.draw(srgb_to_linear(file), blur_px)[kept]]
        fit = np.linalg.lstsq(terms, part.seen[kept], rcond=None)[0]
        return float(((part.seen[kept] - terms @ fit) ** 2).mean())

    return min(BLURS_PX, key=mean_square_error)


def _columns(samples: _Samples, power: float, exponents: tuple[Exponents, ...]) -> np.ndarray:
    known = MODELS["cubic"]
    return samples.terms[power][:, [known.index(term) for term in exponents]]


def _cross_validate(samples: _Samples, power: float, exponents: tuple[Exponents, ...]) -> ColourError:
    """Error on every part of the patch of the fit to the other parts."""
    terms = _columns(samples, power, exponents)
    said = np.zeros_like(samples.seen)
    for fold in np.unique(samples.fold[samples.fold >= 0]):
        held = samples.fold == fold
        fit = _solve(terms[~held], samples.seen[~held], samples.weight[~held])
        said[held] = terms[held] @ fit
    of_patch = samples.fold >= 0
    return measure_error(samples.seen[of_patch], said[of_patch])


def _solve(terms: np.ndarray, seen: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(terms, 3) coefficients by weighted least squares, glare and shadow left out."""
    # a step in the dark looks larger than the same step in the light: lightness is a cube root
    eye = weight / (np.maximum(seen, 0) + DARKEST) ** (4 / 3)
    trust = np.ones((len(seen), 1))
    fit = np.zeros((terms.shape[1], 3))
    for _ in range(ROUNDS):
        for channel in range(3):
            both = eye[:, channel, None] * trust
            normal = terms.T @ (terms * both)
            # a ridge in proportion to the system: terms that the patch lacks stay small
            ridge = TINY * np.trace(normal) / len(normal) * np.eye(len(normal))
            fit[:, channel] = np.linalg.solve(normal + ridge, terms.T @ (seen[:, channel, None] * both)[:, 0])
        miss = np.sqrt((eye / weight * (seen - terms @ fit) ** 2).sum(axis=1))
        trust = 1 / (1 + (miss / (3 * np.median(miss) + 1e-6)) ** 2)[:, None]
    return fit
