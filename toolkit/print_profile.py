"""A print profile: what one printer, its inks and its paper make of a file's colours, as measured on photographs.

The printed colour, in linear light and as a share of the bare paper's, is a polynomial in the powers of the file's
sRGB-encoded red, green and blue. With the exponents 0 and 1 it is Neugebauer's equation (1937): a mixture of the eight
printed solids, weighted by the area that each covers, the power being what the driver and dot gain make of a tone.
"""

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from toolkit.colour import linear_to_srgb, srgb_to_linear
from toolkit.files import read_json, write_json
from toolkit.inks import PAPER

Exponents = tuple[int, int, int]
Triple = tuple[float, float, float]
HIGHEST_DEGREE = 3


class ColourError(BaseModel):
    """CIEDE2000 differences: their median and their 95th percentile."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    median: float = Field(ge=0)
    p95: float = Field(ge=0)

    def __str__(self) -> str:
        return f"ΔE00 {self.median:.1f} (95 % below {self.p95:.1f})"


class ProfileMade(BaseModel):
    """When, with what and by whom a profile was made."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    on: str
    with_version: str
    by: str | None = None


class PrintProfile(BaseModel):
    """`print/profiles/NAME.json`.

    Attributes:
        name: of the profile: printer, paper, or the patch that it was measured on.
        patch: name of that patch, and `patch_sha256` the hash of its PNG.
        model: which polynomial was chosen, in a word.
        power: that the encoded file colour is raised to.
        exponents: of red, green and blue, for each term.
        coefficients: of each term, for the printed red, green and blue.
        paper_linear: linear light of the paper itself; the profile's colours are shares of it.
        photos: hashes of the photographs.
        n_samples: pixels and strip cells that were fitted to.
        strip_cells: cells of the colour strip among them.
        without: how far the print is from the file, paper taken as white.
        held_out: how far the print is from what the profile says, on parts of the patch that it was not fitted to.
        made: when, with what, by whom.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
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
    """Linear light of `toolkit.inks.PAPER`: a photo cannot tell how white a paper is, only what is darker than it."""
    red, green, blue = (float(value) for value in srgb_to_linear(PAPER))
    return red, green, blue


def raise_terms(encoded: np.ndarray, power: float, exponents: tuple[Exponents, ...]) -> np.ndarray:
    """(..., k) the polynomial's terms at sRGB-encoded colours (..., 3) in [0, 1]."""
    raised = np.asarray(encoded, float) ** power
    return np.stack([np.prod(raised ** np.array(term), axis=-1) for term in exponents], axis=-1)


def print_colours(profile: PrintProfile, encoded: np.ndarray) -> np.ndarray:
    """sRGB-encoded (..., 3) in [0, 1]: what comes out of the printer for a file's colours, in neutral light."""
    terms = raise_terms(encoded, profile.power, profile.exponents)
    return linear_to_srgb(terms @ np.array(profile.coefficients) * np.array(profile.paper_linear))


def read_print_profile(file: Path) -> PrintProfile:
    """Read and validate a profile.

    Raises:
        ToolkitError: the file is missing, no JSON, or a field is wrong.
    """
    return read_json(file, PrintProfile)


def write_print_profile(file: Path, profile: PrintProfile) -> Path:
    """Write a profile as JSON."""
    return write_json(file, profile.model_dump(mode="json"))
