"""From booster to page, in millimetres, with the settings of `toolkit print`."""

import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from toolkit.core.config import Config, Flag, Joined
from toolkit.core.errors import FieldError
from toolkit.objects.spec import BASE_DPI, SCALE, Margin
from toolkit.printing.page import LARGEST_MM, SMALLEST_MM, Orientation, Paper, parse_paper

MOST_COPIES = 1000
WIDEST_MARGIN_MM = 100.0
SQUARES = re.compile(r"^\s*(\d{1,4})\s*[x×]\s*(\d{1,4})\s*$", re.IGNORECASE)
SHEET = "A sheet to stand objects on, or the colour strip"
PAGE = "Page"
WRAP = "Pieces of a wrap"
OWN = "Tags and your own pictures"
AnyPaper = Annotated[Paper, BeforeValidator(lambda paper: parse_paper(paper) if isinstance(paper, str) else paper)]


def _read_percent(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    try:
        return float(value.strip().removesuffix("%"))
    except ValueError:
        raise ValueError("expected a percentage such as 250 or 250%") from None


def _read_squares(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    found = SQUARES.match(value)
    if found is None:
        raise ValueError("expected columns x rows such as 7x10")
    return int(found[1]), int(found[2])


class PrintSettings(Config):
    """Settings of a printed patch.

    Example:
        >>> settings = tk.PrintSettings(size_mm=60.0, paper="letter")
        >>> settings.paper.width_mm, settings.copies, settings.margin_mm
        (215.9, 1, 5.0)
    """

    scale_percent: Annotated[
        float | None,
        Field(gt=0),
        BeforeValidator(_read_percent),
        Flag("--scale", metavar="PERCENT", group=PAGE, typed=str),
    ] = Field(
        None,
        description=f"Side of the print = pixels / dpi × scale.  [default: the size in the object's spec, else "
        f"{100 * SCALE:g}]",
    )
    dpi: Annotated[float | None, Field(gt=0), Flag(group=PAGE)] = Field(
        None, description=f"Patch pixels per inch at 100 %.  [default: {BASE_DPI:g}]"
    )
    size_mm: Annotated[float | None, Field(gt=0), Flag(metavar="MM", group=PAGE)] = Field(
        None, description="Side of the printed patch without its white margin; replaces {scale_percent} and {dpi}."
    )
    copies: Annotated[int, Field(ge=1, le=MOST_COPIES), Flag(group=PAGE)] = Field(
        1, description="Copies of each patch, packed on a page if they fit."
    )
    margin_mm: Annotated[float, Field(ge=0, le=WIDEST_MARGIN_MM), Flag(group=PAGE)] = Field(
        5.0, description="Width of the white paper around the patch, for the tape. It lies inside the cut line."
    )
    margin: Annotated[Margin | None, Flag(metavar="white|bleed", group=PAGE)] = Field(
        None,
        description="Print this on the paper around the patch: white leaves it free, bleed continues the print. Use "
        "clear tape with bleed.  [default: as the patch was trained]",
    )
    paper: Annotated[AnyPaper, Flag(metavar="SIZE", group=PAGE, typed=str)] = Field(
        parse_paper("a4"), description="a0 to a5, b3 to b5, letter, legal, tabloid, or a size such as 200x300mm."
    )
    orientation: Annotated[Orientation, Flag(group=PAGE)] = Field(
        "auto", description="auto: whichever needs fewer pages."
    )

    @property
    def states_size(self) -> bool:
        """Whether a size was asked for; else the object's spec decides."""
        # None, not a default: a size that was typed counts before the object's spec, even if it is equal
        return (self.size_mm, self.scale_percent, self.dpi) != (None, None, None)

    def refuse(self, why: str, *names: str) -> None:
        """Raise a `FieldError` that says why for the first of these fields that was changed."""
        usual = PrintSettings()
        for name in names:
            if getattr(self, name) != getattr(usual, name):
                raise FieldError(why, {name: getattr(self, name)})


CutFormat = Literal["svg", "dxf"]


class WrapSettings(Config):
    """Settings of the printed and cut pieces of a wrap."""

    roll_mm: Annotated[float | None, Field(ge=SMALLEST_MM, le=LARGEST_MM), Flag("--roll", metavar="MM", group=WRAP)] = (
        Field(None, description="Width of a roll that replaces the sheets; the first page stays on {paper}.")
    )
    cut: Annotated[CutFormat | None, Flag(metavar="svg|dxf", group=WRAP)] = Field(
        None, description="Also write the outlines alone, in mm, a file for each page."
    )


class OwnSettings(Config):
    """Tags or a picture to print, if any; `PrintSettings` holds the size."""

    tag: Annotated[str | None, Flag(metavar="FAMILY:NUMBERS", group=OWN)] = Field(
        None,
        description="AprilTag or ArUco tags, such as 36h11:0-19 or 4x4_50:3,7. {size_mm} is the side of the black "
        "square.",
    )
    picture: Annotated[Path | None, Flag(metavar="FILE", group=OWN)] = Field(
        None, description="Picture file; it needs no record. {size_mm} is its longer side."
    )
    camera_px: Annotated[int, Field(ge=16, le=100_000), Flag(metavar="PX", group=OWN)] = Field(
        1920, description="Width of your camera's image, for the note on how far away it resolves a texel."
    )
    camera_fov: Annotated[float, Field(ge=1, le=170), Flag(metavar="DEGREES", group=OWN)] = Field(
        60.0, description="Horizontal field of view of that camera."
    )

    @model_validator(mode="after")
    def _check_one(self) -> "OwnSettings":
        if self.tag is not None and self.picture is not None:
            raise FieldError("cannot be combined: leave one out", {"tag": self.tag, "picture": self.picture})
        return self


class SheetSettings(Config):
    """The sheet to print, if any, and its measures; None is chosen to fit.

    Raises:
        FieldError: two sheets are named, or a measure does not belong to the sheet.
    """

    board: Annotated[bool, Flag("--board", group=SHEET)] = Field(
        False, description="A ChArUco board to stand the object on. Camera poses are computed from it."
    )
    ring: Annotated[bool, Flag("--ring", group=SHEET)] = Field(
        False, description="A ring of markers for a turntable, instead of the board."
    )
    colour_strip: Annotated[bool, Flag("--colour-strip", group=SHEET)] = Field(
        False, description="A page with the colour strip alone. A patch's page has the strip if it fits."
    )
    squares: Annotated[
        tuple[int, int] | None,
        BeforeValidator(_read_squares),
        Joined(" × "),
        Flag("--board-squares", metavar="COLUMNSxROWS", group=SHEET, typed=str),
    ] = Field(None, description="Squares of the board.  [default: 12x15]")
    square_mm: Annotated[float | None, Flag(group=SHEET)] = Field(
        None, description="Side of the board's squares.  [default: 26; with {squares}, what fits on a page]"
    )
    ring_mm: Annotated[float | None, Flag(group=SHEET)] = Field(
        None, description="Diameter of the free disc in the ring.  [default: 300]"
    )
    marker_mm: Annotated[float | None, Flag(group=SHEET)] = Field(
        None, description="Side of the markers.  [default: three quarters of a square; in a ring, what fits]"
    )
    ink_percent: Annotated[float | None, Flag("--ink", metavar="PERCENT", group=SHEET)] = Field(
        None,
        description="Darkness of the board or ring. Black (100) distracts networks: use it only to calibrate.  "
        "[default: 10]",
    )

    @model_validator(mode="after")
    def _check(self) -> "SheetSettings":
        asked = [kind for kind in ("board", "ring", "colour_strip") if getattr(self, kind)]
        if len(asked) > 1:
            raise FieldError("cannot be combined: print each by its own command", dict.fromkeys(asked, True))
        belongs = {
            "squares": ["board"], "square_mm": ["board"], "ring_mm": ["ring"], "marker_mm": ["board", "ring"],
            "ink_percent": ["board", "ring"],
        }  # fmt: skip
        for name, kinds in belongs.items():
            if getattr(self, name) is not None and not set(asked) & set(kinds):
                wanted = " or ".join(f"{{{kind}}}" for kind in kinds)
                raise FieldError(f"goes with {wanted}: add that, or leave it out", {name: getattr(self, name)})
        return self

    @property
    def kind(self) -> str | None:
        """`board`, `ring` or `colour-strip`; None for no sheet."""
        return "board" if self.board else "ring" if self.ring else "colour-strip" if self.colour_strip else None
