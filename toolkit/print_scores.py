"""Two numbers that say how a patch will come out of a printer: total variation and non-printability."""

from dataclasses import dataclass

import numpy as np

from toolkit.inks import nearest_printable

NOISE_VARIATION = 1 / 3
"""Total variation of uniform noise: the mean distance of two numbers that are drawn from [0, 1]."""
DULL = 0.05
"""Non-printability beyond which the print looks plainly duller than the screen; uniform noise has 0.09."""


@dataclass(frozen=True)
class PrintScores:
    """Of a patch.

    Attributes:
        total_variation: mean absolute difference of neighbouring texels, right and below, over the channels (Rudin,
            Osher and Fatemi 1992, the anisotropic form): 0 is one flat colour, 0.33 noise.
        non_printability: mean distance, root mean square over the channels, of a texel to the nearest colour that the
            inks of `toolkit.inks` can make: 0 where every colour can be printed. The non-printability score of Sharif
            et al. (2016), with all printable colours for their list of some, and the distance to the nearest
            (Thys et al. 2019) for the product of all distances, which has the same zeros.
    """

    total_variation: float
    non_printability: float

    def describe(self, name: str) -> str:
        """One line: the numbers, and what they mean on paper."""
        grain = "as grainy as noise: texels blur from afar" if self.total_variation > 0.25 else "0 is flat, 0.33 noise"
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
    kinds, count = np.unique(flat, axis=0, return_counts=True)
    distance = np.sqrt(((kinds - nearest_printable(kinds)) ** 2).mean(axis=1))
    return PrintScores(float(np.concatenate(steps).mean()), float((distance * count).sum() / len(flat)))
