"""A print profile, and its colours by NumPy, beside those that training takes by torch."""

import numpy as np

from toolkit.imaging.colour import linear_to_srgb
from toolkit.imaging.printer import ColourError, PrintProfile, ProfileMade, raise_terms, white_paper

TERMS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 1, 1), (0, 0, 2))


def print_colours(profile: PrintProfile, encoded: np.ndarray) -> np.ndarray:
    """(..., 3) sRGB-encoded colours in [0, 1] of the print of a file's colours, in neutral light."""
    terms = raise_terms(encoded, profile.power, profile.exponents)
    return linear_to_srgb(terms @ np.array(profile.coefficients) * np.array(profile.paper_linear))


def copier_profile(**changes) -> PrintProfile:
    """A profile of a printer that there is not."""
    rng = np.random.default_rng(7)
    coefficients = rng.uniform(0.02, 0.14, (len(TERMS), 3))
    fields = {
        "name": "copier", "patch": "racer", "patch_sha256": "ab" * 32, "model": "cubic", "power": 1.8,
        "exponents": TERMS, "coefficients": tuple(map(tuple, coefficients.tolist())), "paper_linear": white_paper(),
        "photos": ("cd" * 32,), "n_samples": 100, "strip_cells": 22, "without": ColourError(median=14, p95=23),
        "held_out": ColourError(median=1.2, p95=3), "made": ProfileMade(on="2026-01-01", with_version="1"),
    }  # fmt: skip
    return PrintProfile(**{**fields, **changes})
