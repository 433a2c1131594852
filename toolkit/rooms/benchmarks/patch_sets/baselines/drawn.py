"""The base of all baselines, and those that need no images: noise, words, QR codes and AprilTags.

A code holds a class's index for its reader (the paper, D.2.1).
"""

import textwrap
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any

import numpy as np

from toolkit.boosters.patch_config import SMALLEST_PX
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError
from toolkit.objects.records import NetworkRecord, PatchRecord
from toolkit.rig.markers import count_markers, get_dictionary
from toolkit.rooms.benchmarks.patch_sets.baselines import APRILTAG, QR

Advance = Callable[[int], None]


@dataclass(frozen=True)
class Choice:
    """The picture of a class.

    Attributes:
        draw: side in pixels -> (n, n, 3) uint8 sRGB; None without a picture.
        code: side in pixels -> facts of the code; None without a code.
        data: for the record: data and image.
        final: for the record: figures.
        passed_over: (path, reason) of images that could not be used.
    """

    draw: Callable[[int], np.ndarray] | None
    code: Callable[[int], dict[str, Any]] | None = None
    data: dict[str, Any] = field(default_factory=dict)
    final: dict[str, float] = field(default_factory=dict)
    passed_over: tuple[tuple[str, str], ...] = ()


class Baseline(ABC):
    """A kind of baseline.

    Attributes:
        method: its name in records.
        seed: of its random draws; 0 without draws.
        settings: of the pictures of all classes.
        networks: that decide on pictures.
        least_px, least_because: the least side of a picture, and why.
    """

    method: str
    seed: int = 0
    settings: dict[str, Any]
    networks: list[NetworkRecord]
    least_px: int = SMALLEST_PX
    least_because: str = ""

    def list_inputs(self, index: int) -> Any:
        """Inputs of the picture of a class beside the settings, for JSON."""
        return None

    def is_current(self, record: PatchRecord) -> bool:
        """Whether the source of a finished picture is unchanged."""
        return True

    def count_work(self, index: int) -> int:
        """Steps of the progress bar for a class."""
        return 1

    @abstractmethod
    def choose(self, index: int, advance: Advance) -> Choice:
        """Choose the picture of a class; `advance` moves the progress bar."""


MEAN, DEVIATION = 0.5, 0.1
"""Mean and standard deviation of the noise in [0, 1], as in the paper's release."""


class FixedPatterns(Baseline):
    """Gaussian noise, independent for each value, drawn by seed and class."""

    method = "fixed pattern of Gaussian noise"

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.networks = []
        self.settings = {"mean": MEAN, "standard_deviation": DEVIATION}

    def choose(self, index: int, advance: Advance) -> Choice:
        """Return the pattern of a class."""

        def draw(size_px: int) -> np.ndarray:
            noise = Draws(self.seed, index, "fixed pattern").of("noise").normal(MEAN, DEVIATION, (size_px, size_px, 3))
            return np.round(noise.clip(0, 1) * 255).astype(np.uint8)

        advance(1)
        return Choice(draw)


LEAST_MODULE_PX = 2
"""Least size of modules that a camera, or a resampling, keeps apart."""
BLACK, WHITE = 0, 255


def fit_module(size_px: int, modules: int, border: int) -> int:
    """Side of a module in pixels."""
    return size_px // (modules + 2 * border)


def draw_modules(black: np.ndarray, border: int, size_px: int) -> np.ndarray:
    """Draw a code (m, m) bool in the middle of a white square, (size_px, size_px, 3) uint8 sRGB.

    `border` is the least number of white modules at each side, which also gets the pixels that modules do not fill.
    """
    module_px = fit_module(size_px, len(black), border)
    code = np.where(black, BLACK, WHITE).astype(np.uint8).repeat(module_px, 0).repeat(module_px, 1)
    picture = np.full((size_px, size_px, 3), WHITE, np.uint8)
    first = (size_px - len(code)) // 2
    picture[first : first + len(code), first : first + len(code)] = code[..., None]
    return picture


LEAST_WORD_PX = 32
"""Least side at which cameras and networks read a name of several letters."""
WORD_SHARE = 0.92
"""Largest share of the side for a word."""
FONT = "DejaVu Sans Bold"


class Words(Baseline):
    """The class's name in black on white, as large as the square holds; networks trained on captions read it.

    A wrong word costs CLIP-like networks 18 to 65 points of accuracy (SCAM, arXiv 2504.04893), so a booster for them
    must be compared with the right word.
    """

    method = "the class's name in black on white"
    least_px, least_because = LEAST_WORD_PX, "a name of several letters cannot be read in fewer"

    def __init__(self, labels: Sequence[str]) -> None:
        self.labels = labels
        self.networks = []
        self.settings = {"font": FONT}

    def choose(self, index: int, advance: Advance) -> Choice:
        """Return the name of a class."""
        advance(1)
        return Choice(partial(draw_word, self.labels[index].replace("_", " ")))


def draw_word(text: str, size_px: int) -> np.ndarray:
    """(size_px, size_px, 3) uint8 sRGB: a text in black on white, broken at blanks if that makes it larger."""
    from PIL import Image, ImageDraw

    image = Image.new("L", (size_px, size_px), WHITE)
    pen, room = ImageDraw.Draw(image), WORD_SHARE * size_px
    # every way to break the text into lines, and the largest font that fits
    words, best = text.split(), (0.0, text)
    lengths = {len(" ".join(words[k:end])) for k in range(len(words)) for end in range(k + 1, len(words) + 1)}
    for most in sorted(lengths):
        lines = textwrap.fill(" ".join(words), most, break_long_words=False, break_on_hyphens=False)
        left, top, right, bottom = pen.multiline_textbbox((0, 0), lines, font=_font(100), align="center")
        size = 100 * room / max(right - left, bottom - top)
        best = max(best, (size, lines))
    # centred by the box of the text, not by its lines
    font = _font(max(1, int(best[0])))
    left, top, right, bottom = pen.multiline_textbbox((0, 0), best[1], font=font, align="center")
    place = (size_px - left - right) / 2, (size_px - top - bottom) / 2
    pen.multiline_text(place, best[1], fill=BLACK, font=font, align="center")
    return np.repeat(np.asarray(image)[..., None], 3, axis=2)


@lru_cache(maxsize=64)
def _font(size_px: int) -> Any:
    import matplotlib
    from PIL import ImageFont

    # matplotlib brings its font along, so that a word looks the same on every machine
    return ImageFont.truetype(f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSans-Bold.ttf", size_px)


PAPER_BORDER = 1
"""White modules around a QR code in the paper's release; the standard, ISO/IEC 18004, asks for four."""
DICTIONARIES = {"36h11": "DICT_APRILTAG_36h11", "36h10": "DICT_APRILTAG_36h10"}
"""AprilTag's families in OpenCV: 587 tags and 2320, the fewer the farther apart."""
# the highest of QR's four levels, which costs nothing here: see `QrCodes`
ERROR_CORRECTION = "H"


def choose_dictionary(classes: int) -> str:
    """Return the family with the greatest distance between tags that has enough tags for all classes."""
    return next(name for name, family in DICTIONARIES.items() if classes <= count_markers(family))


class _Codes(Baseline):
    def __init__(self, modules: int, border: int) -> None:
        if border < 1:
            raise FieldError("expected 1 or more white modules, without which no reader finds it", {"border": border})
        self.modules, self.border = modules, border
        self.networks = []
        self.least_px = LEAST_MODULE_PX * (modules + 2 * border)
        self.least_because = (
            f"{modules} modules and {border} white at each side, at least {LEAST_MODULE_PX} px for each"
        )

    def _choose(self, black: np.ndarray, about: dict[str, Any]) -> Choice:
        def describe(size_px: int) -> dict[str, Any]:
            return about | {"modules": len(black), "module_px": fit_module(size_px, len(black), self.border)}

        return Choice(partial(draw_modules, black, self.border), describe)


class QrCodes(_Codes):
    """A QR code of each class's index in digits, in the smallest version that holds those of all classes.

    Version 1 holds 17 digits even at level H, which mends about 30 % of the code. It has the same 21 modules as the
    paper's level M, which mends 15 %.
    """

    method = "QR code of the class's index"

    def __init__(self, classes: int, border: int = PAPER_BORDER) -> None:
        # the largest index has the most digits: its version holds all others
        super().__init__(len(_draw_qr(classes - 1)), border)
        self.settings = {"border_modules": border, "error_correction": ERROR_CORRECTION}

    def choose(self, index: int, advance: Advance) -> Choice:
        """Return the code of a class."""
        black = _draw_qr(index)
        # a side has 17 + 4 · version modules (ISO/IEC 18004)
        version = (len(black) - 17) // 4
        about = {"kind": QR, "text": str(index), "version": version, "error_correction": ERROR_CORRECTION}
        advance(1)
        return self._choose(black, about)


class AprilTags(_Codes):
    """The AprilTag whose id is the class's index, of family 36h11 if that has enough tags, else of 36h10."""

    method = "AprilTag of the class's index"

    def __init__(self, classes: int, border: int = 1) -> None:
        self.dictionary = choose_dictionary(classes)
        # the bits, and a black frame of a module at each side
        super().__init__(get_dictionary(DICTIONARIES[self.dictionary]).markerSize + 2, border)
        self.settings = {"border_modules": border, "dictionary": self.dictionary}

    def choose(self, index: int, advance: Advance) -> Choice:
        """Return the tag of a class."""
        import cv2

        # a pixel for each module
        black = cv2.aruco.generateImageMarker(get_dictionary(DICTIONARIES[self.dictionary]), index, self.modules) == 0
        advance(1)
        about = {"kind": APRILTAG, "text": str(index), "dictionary": self.dictionary}
        return self._choose(black, about)


def _draw_qr(index: int) -> np.ndarray:
    import segno

    # not above the level in the record
    code = segno.make_qr(str(index), error=ERROR_CORRECTION, boost_error=False)
    return np.array(code.matrix, bool)
