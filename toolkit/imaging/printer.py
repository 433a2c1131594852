"""Colours on paper: a printer's inks, a profile measured on photographs, and how well a patch will print."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from toolkit.core.config import FileRecord
from toolkit.core.files import read_json, write_json
from toolkit.core.lazy import scipy
from toolkit.imaging.colour import srgb_to_linear

SOLIDS = np.array(
    [
        [[[0.311, 0.289, 0.282], [0.308, 0.345, 0.562]], [[0.064, 0.560, 0.355], [0.000, 0.617, 0.850]]],
        [[[0.840, 0.296, 0.304], [0.859, 0.309, 0.554]], [[0.982, 0.870, 0.202], [0.950, 0.950, 0.969]]],
    ]
)
"""[r, g, b] of the file, each 0 or 1 -> sRGB colour on paper. [0, 0, 0] is black ink, [1, 1, 1] is paper."""
PAPER = SOLIDS[1, 1, 1]


def nearest_printable(colours: np.ndarray) -> np.ndarray:
    """(k, 3) printable colours nearest to (k, 3) colours, sRGB-encoded.

    Halftones mix solids, so printable colours fill the convex hull of `SOLIDS`.
    """
    import igl

    nearest = np.array(colours, float)
    corners, triangles, planes = _hull()
    # a point inside of the hull lies below all of its triangles
    outside = np.flatnonzero((nearest @ planes[:, :3].T + planes[:, 3]).max(axis=1) > 0)
    if len(outside):
        nearest[outside] = igl.point_mesh_squared_distance(nearest[outside], corners, triangles)[2]
    return nearest


@lru_cache(maxsize=1)
def _hull() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The hull of `SOLIDS`: corners (8, 3), triangles (f, 3), and their planes (f, 4): outward normal, offset."""
    corners = SOLIDS.reshape(8, 3)
    hull = scipy.spatial.ConvexHull(corners)
    return corners, hull.simplices.astype(np.int64), hull.equations


DULL = 0.05
"""Non-printability beyond which the print looks plainly duller than the screen; uniform noise has 0.09."""


@dataclass(frozen=True)
class PrintScores:
    """Print scores of a patch.

    Attributes:
        total_variation: mean absolute difference of neighbouring texels, right and below, over the channels (Rudin,
            Osher and Fatemi 1992, the anisotropic form): 0 is a flat colour, 0.33 noise.
        non_printability: mean distance, root mean square over the channels, of a texel to the nearest printable colour
            (Sharif et al. 2016, and Thys et al. 2019).
    """

    total_variation: float
    non_printability: float

    def describe(self, name: str) -> str:
        """Describe the numbers and their meaning on paper in a line."""
        grain = "as noise: texels blur at a distance" if self.total_variation > 0.25 else "0 is flat, 0.33 noise"
        inks = (
            "its strongest colours come out duller than on the screen"
            if self.non_printability > DULL
            else "near to what inks on plain paper can show"
        )
        return (
            f"{name}: total variation {self.total_variation:.2f} ({grain}), "
            f"non-printability {self.non_printability:.2f} ({inks})"
        )


def score_print(pixels: np.ndarray) -> PrintScores:
    """Score (n, n, 3) uint8 sRGB pixels, n at least 2."""
    colours = pixels.astype(float) / 255
    steps = [np.abs(np.diff(colours, axis=axis)).ravel() for axis in (0, 1)]
    flat = colours.reshape(-1, 3)
    # each colour is looked up once
    kinds, count = np.unique(flat, axis=0, return_counts=True)
    distance = np.sqrt(((kinds - nearest_printable(kinds)) ** 2).mean(axis=1))
    return PrintScores(float(np.concatenate(steps).mean()), float((distance * count).sum() / len(flat)))


Exponents = tuple[int, int, int]
Triple = tuple[float, float, float]
HIGHEST_DEGREE = 3


class ColourError(FileRecord, allow_inf_nan=False):
    """CIEDE2000 differences: their median and their 95th percentile."""

    median: float = Field(ge=0)
    p95: float = Field(ge=0)

    def __str__(self) -> str:
        return f"ΔE00 {self.median:.1f} (95 % below {self.p95:.1f})"


class ProfileMade(FileRecord):
    """When, with what and by whom a profile was made."""

    on: str
    with_version: str
    by: str | None = None


class PrintProfile(FileRecord, allow_inf_nan=False):
    """`print/profiles/NAME.json`.

    Attributes:
        name: name of the profile: printer, paper, or the patch that was measured.
        patch, patch_sha256: name of that patch and hash of its PNG.
        model: name of the fitted polynomial.
        power: exponent for the encoded colours of the file.
        exponents: exponents of red, green and blue in each term.
        coefficients: coefficients of each term for the printed red, green and blue.
        paper_linear: linear light of the paper; the profile's colours are shares of it.
        photos: hashes of the photographs.
        n_samples: number of fitted pixels and strip cells.
        strip_cells: number of fitted cells of the colour strip.
        without: error of the print against the file, with the paper as white.
        held_out: error of the print against the profile, on parts of the patch outside the fit.
        made: time, program and author.
    """

    schema_version: Literal[1] = 1
    name: str = Field(min_length=1)
    patch: str
    patch_sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    model: str
    power: float = Field(ge=1, le=4)
    exponents: tuple[Exponents, ...] = Field(min_length=1, max_length=20)
    coefficients: tuple[Triple, ...]
    paper_linear: Triple
    photos: tuple[str, ...] = Field(min_length=1)
    n_samples: int = Field(gt=0)
    strip_cells: int = Field(ge=0)
    without: ColourError
    held_out: ColourError
    made: ProfileMade

    @model_validator(mode="after")
    def _agree(self) -> "PrintProfile":
        if len(self.coefficients) != len(self.exponents):
            raise ValueError(f"expected {len(self.exponents)} coefficients, as exponents, got {len(self.coefficients)}")
        if any(min(term) < 0 or sum(term) > HIGHEST_DEGREE for term in self.exponents):
            raise ValueError(f"expected exponents from 0 that add up to at most {HIGHEST_DEGREE}")
        if len(set(self.exponents)) < len(self.exponents):
            raise ValueError("expected exponents that differ")
        if not all(0.2 <= value <= 1.2 for value in self.paper_linear):
            raise ValueError("expected paper_linear from 0.2 to 1.2")
        return self


def white_paper() -> Triple:
    """Linear light of `PAPER`: a photo shows colours only relative to its white."""
    red, green, blue = (float(value) for value in srgb_to_linear(PAPER))
    return red, green, blue


def raise_terms(encoded: np.ndarray, power: float, exponents: tuple[Exponents, ...]) -> np.ndarray:
    """(..., k) the polynomial's terms at sRGB-encoded colours (..., 3) in [0, 1]."""
    raised = np.asarray(encoded, float) ** power
    return np.stack([np.prod(raised ** np.array(term), axis=-1) for term in exponents], axis=-1)


def read_print_profile(file: Path) -> PrintProfile:
    """Read and validate a profile.

    Raises:
        ToolkitError: the file is missing, no JSON, or a field is wrong.
    """
    return read_json(file, PrintProfile)


def write_print_profile(file: Path, profile: PrintProfile) -> Path:
    """Write a profile as JSON."""
    return write_json(file, profile.model_dump(mode="json"))
