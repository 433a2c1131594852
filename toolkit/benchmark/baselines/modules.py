"""Black and white modules to pixels, each module a square of the same whole number of pixels."""

import numpy as np

LEAST_MODULE_PX = 2
"""A camera, or a resampling, cannot keep modules of one pixel apart."""
BLACK, WHITE = 0, 255


def smallest_side(modules: int, border: int) -> int:
    """Least side in pixels of a code of so many modules and so many white ones at each side."""
    return LEAST_MODULE_PX * (modules + 2 * border)


def fit_module(size_px: int, modules: int, border: int) -> int:
    """Side of a module in pixels."""
    return size_px // (modules + 2 * border)


def draw_modules(black: np.ndarray, border: int, size_px: int) -> np.ndarray:
    """Draw a code in the middle of a white square; what the modules do not fill goes to the border.

    Args:
        black: (m, m) bool.
        border: white modules at each side, at least.
        size_px: side of the square, `smallest_side` or more.

    Returns:
        (size_px, size_px, 3) uint8 sRGB.
    """
    module_px = fit_module(size_px, len(black), border)
    code = np.where(black, BLACK, WHITE).astype(np.uint8).repeat(module_px, 0).repeat(module_px, 1)
    picture = np.full((size_px, size_px, 3), WHITE, np.uint8)
    first = (size_px - len(code)) // 2
    picture[first : first + len(code), first : first + len(code)] = code[..., None]
    return picture
