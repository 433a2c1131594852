"""Smooth noise that repeats: the pattern of clouds, and of snow on the ground."""

import numpy as np


def paint_noise(rng: np.random.Generator, side_px: int, slope: float, coarsest: float) -> np.ndarray:
    """(side, side) float32 periodic noise, every value in [0, 1] as frequent.

    Args:
        rng: draws it.
        side_px: of the pattern.
        slope: amplitudes fall as frequency^-slope.
        coarsest: waves longer than this part of the side are no stronger.
    """
    waves = np.hypot(np.fft.fftfreq(side_px)[:, None], np.fft.rfftfreq(side_px)[None]) * side_px
    spectrum = np.fft.rfft2(rng.standard_normal((side_px, side_px))) / np.maximum(waves, coarsest) ** slope
    smooth = np.fft.irfft2(spectrum, s=(side_px, side_px))
    rank = np.empty(side_px**2, np.float32)
    rank[np.argsort(smooth, axis=None)] = (np.arange(side_px**2) + 0.5) / side_px**2
    return rank.reshape(side_px, side_px)
