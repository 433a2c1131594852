"""A print profile's colours by NumPy, beside those that training takes by torch."""

import numpy as np

from toolkit.imaging.colour import linear_to_srgb
from toolkit.imaging.printer import PrintProfile, raise_terms


def print_colours(profile: PrintProfile, encoded: np.ndarray) -> np.ndarray:
    """(..., 3) sRGB-encoded colours in [0, 1] of the print of a file's colours, in neutral light."""
    terms = raise_terms(encoded, profile.power, profile.exponents)
    return linear_to_srgb(terms @ np.array(profile.coefficients) * np.array(profile.paper_linear))
