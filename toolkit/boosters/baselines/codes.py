"""QR codes and AprilTags: a class's index as a code that a reader made for it finds (the paper, D.2.1)."""

from functools import lru_cache, partial
from typing import Any

import cv2
import numpy as np

from toolkit.boosters.baselines.baseline import Advance, Baseline, Choice
from toolkit.core.errors import FieldError

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


QR, APRILTAG = "qr", "apriltag"
PAPER_BORDER = 1
"""White modules around a QR code in the paper's release; the standard, ISO/IEC 18004, asks for four."""
DICTIONARIES = {"36h11": cv2.aruco.DICT_APRILTAG_36h11, "36h10": cv2.aruco.DICT_APRILTAG_36h10}
"""AprilTag's families in OpenCV: 587 tags and 2320, the fewer the farther apart."""
ERROR_CORRECTION = "H"


@lru_cache(maxsize=len(DICTIONARIES))
def tag_dictionary(name: str) -> Any:
    """OpenCV's dictionary of a family."""
    return cv2.aruco.getPredefinedDictionary(DICTIONARIES[name])


def choose_dictionary(classes: int) -> str:
    """The family with the greatest distance between its tags that has one for each class."""
    return next(name for name in DICTIONARIES if classes <= len(tag_dictionary(name).bytesList))


class _Codes(Baseline):
    def __init__(self, modules: int, border: int) -> None:
        if border < 1:
            raise FieldError("expected 1 or more white modules, without which no reader finds it", {"border": border})
        self.modules, self.border = modules, border
        self.networks = []
        self.least_px = smallest_side(modules, border)
        self.least_because = (
            f"{modules} modules and {border} white at each side, {LEAST_MODULE_PX} px for each at the least"
        )

    def _choose(self, black: np.ndarray, about: dict[str, Any]) -> Choice:
        def describe(size_px: int) -> dict[str, Any]:
            return about | {"modules": len(black), "module_px": fit_module(size_px, len(black), self.border)}

        return Choice(partial(draw_modules, black, self.border), describe)


class QrCodes(_Codes):
    """A QR code of each class's index in digits, in the smallest version that holds those of all classes.

    Version 1 holds the digits of 17 figures even at level H, which mends about 30 % of the code, in the same 21 modules
    as the paper's level M with its 15 %: the stronger code is free.
    """

    method = "QR code of the class's index"

    def __init__(self, classes: int, border: int = PAPER_BORDER) -> None:
        super().__init__(len(_draw_qr(classes - 1)), border)
        self.settings = {"border_modules": border, "error_correction": ERROR_CORRECTION}

    def choose(self, index: int, advance: Advance) -> Choice:
        """The code of one class."""
        black = _draw_qr(index)
        version = (len(black) - 17) // 4
        about = {"kind": QR, "text": str(index), "version": version, "error_correction": ERROR_CORRECTION}
        advance(1)
        return self._choose(black, about)


class AprilTags(_Codes):
    """The AprilTag whose id is the class's index, of family 36h11 where that has enough tags, else of 36h10."""

    method = "AprilTag of the class's index"

    def __init__(self, classes: int, border: int = 1) -> None:
        self.dictionary = choose_dictionary(classes)
        super().__init__(tag_dictionary(self.dictionary).markerSize + 2, border)
        self.settings = {"border_modules": border, "dictionary": self.dictionary}

    def choose(self, index: int, advance: Advance) -> Choice:
        """The tag of one class."""
        # one pixel for each module
        black = cv2.aruco.generateImageMarker(tag_dictionary(self.dictionary), index, self.modules) == 0
        advance(1)
        about = {"kind": APRILTAG, "text": str(index), "dictionary": self.dictionary}
        return self._choose(black, about)


def _draw_qr(index: int) -> np.ndarray:
    import segno

    code = segno.make_qr(str(index), error=ERROR_CORRECTION, boost_error=False)
    return np.array(code.matrix, bool)
