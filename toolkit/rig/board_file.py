"""Which board is meant: the last printed board, or another in a TOML file; the ring of a turntable."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidatorFunctionWrapHandler, field_validator

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import read_json, read_toml, write_json, write_text
from toolkit.core.workspace import Workspace
from toolkit.rig.board import DEFAULT_BOARD, Board, CharucoBoard, Chessboard, MarkerBoard, MarkerGrid
from toolkit.rig.markers import (
    DICTIONARY,
    RING_FIRST_ID,
    STRIP_FIRST_ID,
    require_ids,
    require_ink,
    require_mm,
)

FEWEST_MARKERS = 8
"""At a low camera the object hides the half of the ring behind it; four markers are left."""


@dataclass(frozen=True)
class MarkerRing(MarkerBoard):
    """Markers in a ring round a free disc, upright towards the middle as seen from outside; checked when it is made.

    The first marker lies at the front (the lower edge of the page), the others follow counter-clockwise from above.
    Sheet positions are counted from the corner of the square round the ring.

    Raises:
        ToolkitError: the markers do not fit side by side, or the dictionary has too few.
    """

    inner_mm: float  # diameter of the free disc that the object stands on
    marker_mm: float  # side of a marker, its black border included
    count: int  # of the markers
    dictionary: str = DICTIONARY  # OpenCV's name of it
    first_id: int = RING_FIRST_ID  # number of the marker at the front
    ink_percent: float = 100.0  # how dark the markers are, 100 is black

    def __post_init__(self) -> None:
        require_ink("ring", self.ink_percent)
        require_mm("ring: inner_mm", self.inner_mm)
        require_mm("ring: marker_mm", self.marker_mm)
        if self.count < FEWEST_MARKERS:
            raise ToolkitError(f"ring: {self.count} markers: expected at least {FEWEST_MARKERS}")
        if self.count > (most := count_that_fit(self.inner_mm, self.marker_mm)):
            raise ToolkitError(
                f"ring: {self.count} markers of {self.marker_mm:g} mm round {self.inner_mm:g} mm: at most {most} fit; "
                "choose a larger ring or smaller markers"
            )
        require_ids("ring", self.dictionary, self.first_id, self.count)

    @property
    def quiet_mm(self) -> float:
        """White paper inside and outside the markers, a module wide."""
        return self.marker_mm / 7

    @property
    def middle_radius_mm(self) -> float:
        """From the ring's middle to a marker's."""
        return self.inner_mm / 2 + self.quiet_mm + self.marker_mm / 2

    @property
    def outer_mm(self) -> float:
        """Diameter of the sheet."""
        half = self.marker_mm / 2
        # a marker's outer corners reach furthest
        return 2 * (math.hypot(self.middle_radius_mm + half, half) + self.quiet_mm)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the square round the sheet."""
        return self.outer_mm, self.outer_mm

    @property
    def marker_ids(self) -> tuple[int, ...]:
        """Numbers of the markers, the front marker first."""
        return tuple(range(self.first_id, self.first_id + self.count))

    def place_markers(self) -> list[tuple[int, np.ndarray, float]]:
        """As `Board` has it; each is upright towards the middle."""
        turns = [2 * math.pi * index / self.count for index in range(self.count)]
        radius, middle = self.middle_radius_mm, self.outer_mm / 2
        return [
            (marker_id, middle + radius * np.array([math.sin(turn), math.cos(turn)]), turn)
            for marker_id, turn in zip(self.marker_ids, turns, strict=True)
        ]

    def describe(self) -> str:
        """A line: what it is made of."""
        last = self.first_id + self.count - 1
        return (
            f"ring of {self.count} ArUco markers, {self.marker_mm:g} mm, round {self.inner_mm:g} mm, "
            f"{self.dictionary} {self.first_id}-{last}, {self.ink_percent:g} % ink"
        )


def count_that_fit(inner_mm: float, marker_mm: float) -> int:
    """The most markers round a free disc that have a module of white paper between them."""
    apothem = inner_mm / 2 + marker_mm / 7  # of the polygon of the markers' inner sides
    # a polygon of n sides of length s has apothem s / (2 tan(pi / n)), solved for n; a side is a marker and a module
    return int(math.pi / math.atan(marker_mm * 8 / 7 / 2 / apothem))


def choose_ring(inner_mm: float, marker_mm: float | None = None) -> MarkerRing:
    """A ring of that free diameter, its markers evenly spread with room of a third of their side between them.

    Args:
        inner_mm: diameter of the free disc.
        marker_mm: side of the markers; None: about a twelfth of the disc, 12 to 40 mm.

    Raises:
        ToolkitError: too few markers fit.
    """
    require_mm("ring: inner_mm", inner_mm)
    # whole millimetres, which a ruler can check
    side = float(min(max(round(inner_mm / 12.5), 12), 40)) if marker_mm is None else marker_mm
    require_mm("ring: marker_mm", side)
    most = count_that_fit(inner_mm, side)
    if most < FEWEST_MARKERS:
        # the same, solved for the free disc
        least = 2 * (side * 8 / 14 / math.tan(math.pi / FEWEST_MARKERS) - side / 7)
        raise ToolkitError(
            f"a ring of {inner_mm:g} mm takes {most} markers of {side:g} mm, expected at least {FEWEST_MARKERS}: "
            f"choose a ring of at least {math.ceil(least)} mm or smaller markers"
        )
    # half of the free disc and a module of white paper: the apothem of the polygon of the markers' inner sides
    apothem = inner_mm / 2 + side / 7
    # a side of the polygon is a marker and a third of it
    roomy = int(math.pi / math.atan(side * 4 / 3 / 2 / apothem))
    # the strip's markers come after the ring's, so the ring may not take their numbers
    return MarkerRing(inner_mm, side, min(max(roomy, FEWEST_MARKERS), STRIP_FIRST_ID - RING_FIRST_ID))


DEFAULT_RING = MarkerRing(inner_mm=300.0, marker_mm=24.0, count=30)


PRINTED = "printed"
"""Name of the board that 'toolkit print --board' made last."""
Kind = Literal["charuco", "aruco-grid", "apriltag-grid", "chessboard"]
MAKERS: dict[Kind, Callable[..., Board]] = {
    "charuco": CharucoBoard, "aruco-grid": MarkerGrid, "apriltag-grid": MarkerGrid, "chessboard": Chessboard,
}  # fmt: skip
NEEDED: dict[Kind, tuple[str, ...]] = {
    "charuco": ("marker_mm", "dictionary"), "aruco-grid": ("marker_mm", "dictionary"),
    "apriltag-grid": ("marker_mm", "dictionary"), "chessboard": (),
}  # fmt: skip
ALLOWED: dict[Kind, tuple[str, ...]] = {
    "charuco": ("first_id", "legacy"), "aruco-grid": ("first_id",), "apriltag-grid": ("first_id",), "chessboard": (),
}  # fmt: skip


class BoardFile(BaseModel):
    """`rig/board.json`: the sheet that is printed and photographed, either a board or a ring."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: Literal[1] = 1
    board: CharucoBoard | None = None
    ring: MarkerRing | None = None

    @field_validator("board", "ring", mode="wrap")
    @classmethod
    def _explain(cls, value: object, read: ValidatorFunctionWrapHandler) -> Board | None:
        try:
            return read(value)
        except ToolkitError as error:
            raise ValueError(str(error)) from None


class BoardSpec(BaseModel):
    """`rig/boards/NAME.toml`: a board that others printed.

    Attributes:
        kind: type of the board.
        columns, rows: number of squares across and down; of markers in a grid.
        square_mm: side of a square. In a grid: from a marker's left edge to the next marker's.
        marker_mm: side of a marker.
        dictionary: dictionary of the markers.
        first_id: number of the first marker.
        legacy: whether a ChArUco board has the pattern from before OpenCV 4.6.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    kind: Kind
    columns: int
    rows: int
    square_mm: float
    marker_mm: float | None = None
    dictionary: str | None = None
    first_id: int | None = None
    legacy: bool | None = None

    def make(self) -> Board:
        """The board.

        Raises:
            ToolkitError: a field is missing or has no sense for its kind, or its sizes cannot be.
        """
        # a file may leave fields out, but only those that its kind does not need
        given = self.model_dump(exclude_none=True, exclude={"kind"})
        needed, allowed = NEEDED[self.kind], ALLOWED[self.kind]
        for name in ("marker_mm", "dictionary", "first_id", "legacy"):
            if name in needed and name not in given:
                raise ToolkitError(f"field '{name}': missing; a board of kind {self.kind} needs it")
            if name in given and name not in (*needed, *allowed):
                raise ToolkitError(f"field '{name}': a board of kind {self.kind} has none: delete the line")
        # the kind says which family of markers is meant, so that a mix-up is told before anything is measured
        of_april = (self.dictionary or "").startswith("DICT_APRILTAG")
        if self.kind in ("aruco-grid", "apriltag-grid") and of_april != (self.kind == "apriltag-grid"):
            other = "apriltag-grid" if of_april else "aruco-grid"
            raise ToolkitError(f"field 'kind': {self.dictionary} on a board of kind {self.kind}: expected {other}")
        return MAKERS[self.kind](**given)

    def to_toml(self) -> str:
        """The text of its file."""

        def show(value: object) -> str:
            return str(value).lower() if isinstance(value, bool) else repr(value).replace("'", '"')

        fields = self.model_dump(exclude_none=True)
        return "".join(f"{name} = {show(value)}\n" for name, value in fields.items())


def boards_dir(workspace: Workspace) -> Path:
    """Folder of other people's boards."""
    return workspace.root / "rig" / "boards"


def board_file(workspace: Workspace) -> Path:
    """File of the current board."""
    return workspace.board or workspace.root / "rig" / "board.json"


def with_board(workspace: Workspace, board: str | Path | None) -> Workspace:
    """The same workspace with another board than the last printed board.

    Args:
        board: a name in it, or a TOML file; None or `PRINTED` for the printed board.

    Raises:
        ToolkitError: there is none, or the file is broken.
    """
    if board in (None, PRINTED):
        return replace(workspace, board=None)
    # a bare word is a name in the workspace, anything else a path
    path = Path(board)
    if path.suffix != ".toml" and len(path.parts) == 1:
        path = boards_dir(workspace) / f"{board}.toml"
        if not path.is_file():
            known = [PRINTED, *sorted(file.stem for file in boards_dir(workspace).glob("*.toml"))]
            if len(known) > 1:
                raise one_of("board", str(board), known)
            raise ToolkitError(
                f"no board called '{board}': {boards_dir(workspace)} holds none; 'toolkit calibrate --find-board "
                "PHOTOS/' makes one from photographs, or name a TOML file"
            )
    # read now, so that a broken file is told before any work
    found = replace(workspace, board=path.resolve())
    read_board(found)
    return found


def swap_sides(board: Board) -> Board | None:
    """The board with as many columns as it has rows, and the other way round; None if it has no others to swap."""
    columns, rows = getattr(board, "columns", None), getattr(board, "rows", None)
    if not isinstance(columns, int) or not isinstance(rows, int) or columns == rows:
        return None
    try:
        return replace(board, columns=rows, rows=columns)  # type: ignore[type-var]
    except ToolkitError:  # such a board cannot be
        return None


def write_board(workspace: Workspace, board: Board) -> Path:
    """Write `rig/board.json`, for `read_board`; returns the file."""
    kind = "board" if isinstance(board, CharucoBoard) else "ring"
    return write_json(workspace.root / "rig" / "board.json", {"schema_version": 1, kind: dict(vars(board))})


def write_spec(path: Path, spec: BoardSpec) -> Path:
    """Write `rig/boards/NAME.toml`; returns the file."""
    return write_text(path, spec.to_toml())


def read_board(workspace: Workspace) -> Board:
    """The board of `with_board`, else the last that `toolkit print --board` or `--ring` printed, else the default.

    Raises:
        ToolkitError: the file is broken, names both a board and a ring or neither, or its sizes cannot be.
    """
    # the file of `toolkit print` is JSON, a board that somebody else printed is TOML
    file = board_file(workspace)
    if workspace.board is not None:
        spec = read_toml(file, BoardSpec)
        try:
            return spec.make()
        except ToolkitError as error:
            raise ToolkitError(f"{file}: {error}") from None
    if not file.is_file():
        return DEFAULT_BOARD
    # the last sheet that was printed, of either kind
    found = read_json(file, BoardFile)
    if (found.board is None) == (found.ring is None):
        raise ToolkitError(f"{file}: expected either 'board' or 'ring': print the sheet again, or delete the file")
    return found.board or found.ring or DEFAULT_BOARD
