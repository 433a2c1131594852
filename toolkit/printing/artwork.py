"""The patch's pixels as vector rectangles.

Vectors, not an image: viewers and print drivers smooth an enlarged image whatever its `/Interpolate` says (pdf.js,
Preview and most drivers do), and rasterisers move an image's corners to whole device pixels. A filled rectangle has
its edge where it should be at any resolution.

Rectangles that merely touch show a hairline of paper between them wherever a rasteriser smooths edges, since each
covers a part of the device pixel on their common edge. So each reaches half a patch pixel under its right and lower
neighbours, which are painted later: a device pixel on an edge then holds a mixture of the two colours and nothing else.
"""

from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

FORM = "patch"
UNDERLAP_PX = 0.5


def find_runs(row: np.ndarray) -> list[tuple[int, int]]:
    """Spans [first, end) of equal colour in a row of (n, 3) pixels."""
    edges = np.flatnonzero(np.any(row[1:] != row[:-1], axis=1)) + 1
    bounds = [0, *edges.tolist(), len(row)]
    return list(pairwise(bounds))


def pixel_operators(pixels: np.ndarray) -> list[str]:
    """PDF operators that paint (n, n, 3) uint8 pixels over the square from (0, 0) to (n, n), first row on top."""
    side = len(pixels)
    operators = []
    for index, row in enumerate(pixels):
        top = side - index
        bottom = top - 1 - (UNDERLAP_PX if index < side - 1 else 0)
        for first, end in find_runs(row):
            red, green, blue = (f"{value / 255:.5g}" for value in row[first].tolist())
            right = end + (UNDERLAP_PX if end < side else 0)
            operators.append(f"{red} {green} {blue} rg {first} {bottom:g} {right - first:g} {top - bottom:g} re f")
    return operators


@cache
def srgb_profile() -> bytes:
    """An ICC profile of sRGB, the same bytes every time (LittleCMS writes the time into it)."""
    from PIL import ImageCms

    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    profile[24:36] = bytes.fromhex("07d0 0001 0001 0000 0000 0000")  # dateTimeNumber, ICC.1:2010 table 17
    profile[84:100] = bytes(16)  # profile ID, optional: it is a hash over the rest
    return bytes(profile)


def define_patch(canvas: "Canvas", pixels: np.ndarray) -> None:
    """Store the patch once in the file, for `place_patch` to show; (n, n, 3) uint8, sRGB-encoded.

    `DefaultRGB` makes its colours sRGB to every reader, not the device's own RGB (ISO 32000-1, 8.6.5.6).
    """
    from reportlab.pdfbase.pdfdoc import PDFArray, PDFDictionary, PDFName, PDFResourceDictionary, PDFStream

    document, side = canvas._doc, len(pixels)
    icc = PDFStream(PDFDictionary({"N": 3, "Alternate": PDFName("DeviceRGB")}), srgb_profile())
    space = PDFArray([PDFName("ICCBased"), document.Reference(icc)])
    # One pixel of room: a box on the very edge would smooth that edge a second time.
    canvas.beginForm(FORM, -1, -1, side + 1, side + 1)
    canvas._code.extend(pixel_operators(pixels))
    canvas.endForm(Resources=PDFResourceDictionary(ColorSpace={"DefaultRGB": space}))


def place_patch(canvas: "Canvas", x: float, y: float, side_mm: float, n_px: int) -> None:
    """Show the patch with its lower left corner at (x, y), millimetres."""
    canvas.saveState()
    canvas.translate(x, y)
    canvas.scale(side_mm / n_px, side_mm / n_px)
    canvas.doForm(FORM)
    canvas.restoreState()
