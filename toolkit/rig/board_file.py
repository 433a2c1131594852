"""Which board is meant: the one that was printed last, or one of others, described in a TOML file."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidatorFunctionWrapHandler, field_validator

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import read_json, read_toml, write_json, write_text
from toolkit.core.workspace import Workspace
from toolkit.rig.board import DEFAULT_BOARD, Board, CharucoBoard, Chessboard, MarkerGrid
from toolkit.rig.ring import MarkerRing

PRINTED = "printed"
"""What the board is called that 'toolkit print --board' made last."""
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
        kind: what it is made of.
        columns, rows: squares across and down; of a grid, markers.
        square_mm: side of a square; of a grid, from a marker's left edge to the next one's.
        marker_mm, dictionary, first_id: of the markers.
        legacy: of a ChArUco board, the pattern before OpenCV 4.6.
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
        given = self.model_dump(exclude_none=True, exclude={"kind"})
        needed, allowed = NEEDED[self.kind], ALLOWED[self.kind]
        for name in ("marker_mm", "dictionary", "first_id", "legacy"):
            if name in needed and name not in given:
                raise ToolkitError(f"field '{name}': missing; a board of kind {self.kind} needs it")
            if name in given and name not in (*needed, *allowed):
                raise ToolkitError(f"field '{name}': a board of kind {self.kind} has none: delete the line")
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
    """Where boards of others are described."""
    return workspace.root / "rig" / "boards"


def board_file(workspace: Workspace) -> Path:
    """Where the board is described that is worked with."""
    return workspace.board or workspace.root / "rig" / "board.json"


def with_board(workspace: Workspace, board: str | Path | None) -> Workspace:
    """The same workspace with another board than the one that was printed last.

    Args:
        workspace: whose `rig/boards` is looked into.
        board: a name in it, or a TOML file; None or `PRINTED` for the printed one.

    Raises:
        ToolkitError: there is none, or the file is broken.
    """
    if board in (None, PRINTED):
        return replace(workspace, board=None)
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
    found = replace(workspace, board=path.resolve())
    read_board(found)
    return found


def write_board(workspace: Workspace, board: Board) -> Path:
    """Write `rig/board.json`, for `read_board`; returns the file."""
    kind = "board" if isinstance(board, CharucoBoard) else "ring"
    return write_json(workspace.root / "rig" / "board.json", {"schema_version": 1, kind: dict(vars(board))})


def write_spec(path: Path, spec: BoardSpec) -> Path:
    """Write `rig/boards/NAME.toml`; returns the file."""
    return write_text(path, spec.to_toml())


def read_board(workspace: Workspace) -> Board:
    """The board of `with_board`, else the one that `toolkit print --board` or `--ring` printed last, else the default.

    Raises:
        ToolkitError: the file is broken, names both a board and a ring or neither, or its sizes cannot be.
    """
    file = board_file(workspace)
    if workspace.board is not None:
        spec = read_toml(file, BoardSpec)
        try:
            return spec.make()
        except ToolkitError as error:
            raise ToolkitError(f"{file}: {error}") from None
    if not file.is_file():
        return DEFAULT_BOARD
    found = read_json(file, BoardFile)
    if (found.board is None) == (found.ring is None):
        raise ToolkitError(f"{file}: expected either 'board' or 'ring': print the sheet again, or delete the file")
    return found.board or found.ring or DEFAULT_BOARD
