"""Photographs that a table pairs by hand: no plan, no board, variants and poses of any name."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_bytes
from toolkit.core.names import is_file_name, is_folder_name
from toolkit.photos.importing.evidence import Evidence
from toolkit.photos.importing.gather import Candidate
from toolkit.photos.importing.index import CaptureKey, SourceIndex, describe_imported
from toolkit.photos.importing.match import Decision
from toolkit.photos.importing.resolve import Resolved

COLUMNS = ("file", "object", "variant", "pose")
MOST_BYTES = 16 << 20


@dataclass(frozen=True)
class PairRow:
    """One line of `pairs.csv`.

    Attributes:
        file: of the photograph, below the folder that is imported; its name alone where that is enough.
        object, variant: what it shows.
        pose: what pairs it with those of other variants: a number, or any words.
        class_name: what the object should be recognised as; empty where its spec or its name says it.
    """

    file: str
    object: str
    variant: str
    pose: str
    class_name: str = ""


def read_pairs(file: Path) -> list[PairRow]:
    """Read `pairs.csv`: a heading with file, object, variant, pose and perhaps class, then a line per photograph.

    Raises:
        ToolkitError: no such file, a column or a value is missing, a name cannot be one, or two lines contradict.
    """
    try:
        text = read_bytes(file, MOST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ToolkitError(f"{file}: expected a table in UTF-8: save it as CSV UTF-8") from None
    lines = csv.DictReader(io.StringIO(text, newline=""), delimiter=";" if ";" in text.partition("\n")[0] else ",")
    heading = [(name or "").strip().lower() for name in lines.fieldnames or ()]
    if missing := [name for name in COLUMNS if name not in heading]:
        raise ToolkitError(f"{file}: line 1: no column {', '.join(missing)}: expected file,object,variant,pose[,class]")
    lines.fieldnames = heading
    rows: list[PairRow] = []
    files: set[str] = set()
    shown: dict[tuple[str, str, str], str] = {}
    classes: dict[str, str] = {}
    for line in lines:
        where = f"{file}: line {lines.line_num}"
        values = {name: (line.get(name) or "").strip() for name in (*COLUMNS, "class")}
        if empty := [name for name in COLUMNS if not values[name]]:
            raise ToolkitError(f"{where}: no {', '.join(empty)}: expected a value in each of {', '.join(COLUMNS)}")
        row = PairRow(values["file"], values["object"], values["variant"], values["pose"], values["class"])
        _check_row(row, where)
        if row.file in files:
            raise ToolkitError(
                f"{where}: {row.file} is listed twice: one photograph counts for one pose of one variant"
            )
        other = shown.setdefault((row.object, row.variant, row.pose), row.file)
        if other != row.file:
            raise ToolkitError(f"{where}: {row.file} and {other} are both {row.object}/{row.variant} pose {row.pose}")
        if classes.setdefault(row.object, row.class_name) != row.class_name:
            raise ToolkitError(f"{where}: '{row.object}' has another class above: give it the same in every line")
        files.add(row.file)
        rows.append(row)
    if not rows:
        raise ToolkitError(f"{file}: no photograph is listed: expected a line for each below the heading")
    return rows


def _check_row(row: PairRow, where: str) -> None:
    if not is_file_name(row.object):
        raise ToolkitError(f"{where}: object '{row.object}': expected a name of letters, digits, - and _")
    if not is_folder_name(row.variant):
        raise ToolkitError(f"{where}: variant '{row.variant}': expected a name of letters, digits, '.', - and _")


def number_poses(rows: Sequence[PairRow]) -> dict[tuple[str, str], int]:
    """A number for each (object, pose): the pose itself where all of an object's are numbers, else by first mention."""
    names: dict[str, list[str]] = {}
    for row in rows:
        found = names.setdefault(row.object, [])
        if row.pose not in found:
            found.append(row.pose)
    numbers = {}
    for name, poses in names.items():
        are_numbers = all(pose.isdecimal() and 1 <= int(pose) <= 99_999 for pose in poses)
        unique = len({int(pose) for pose in poses}) == len(poses) if are_numbers else False
        for i, pose in enumerate(poses, 1):
            numbers[name, pose] = int(pose) if unique else i
    return numbers


def match_pairs(
    rows: Sequence[PairRow], candidates: Sequence[Candidate], index: SourceIndex, duplicates: Mapping[str, str]
) -> tuple[list[Resolved], list[tuple[str, str]]]:  # fmt: skip
    """What each new photograph shows by the table, and (label, reason) of those that it does not place.

    Args:
        rows: from `read_pairs`.
        candidates: the photographs.
        index: what was imported before.
        duplicates: labels of copies, which were left out already.

    Raises:
        ToolkitError: a file of the table is none of the photographs, or several.
    """
    numbers, placed = number_poses(rows), {}
    for row in rows:
        wanted = row.file.replace("\\", "/")
        if wanted in duplicates:
            continue
        found = [one for one in candidates if wanted in (one.label, one.photo.path.name)]
        found = [one for one in found if one.label == wanted] or found
        if len(found) != 1:
            what = "several photographs have that name: name it with its folder" if found else "no such photograph"
            raise ToolkitError(f"{row.file} in the table of pairs: {what}")
        placed[id(found[0])] = row
    resolved: list[Resolved] = []
    refused = []
    for one in candidates:
        listed = placed.get(id(one))
        if describe_imported(index, one.photo):
            continue
        if listed is None:
            refused.append((one.label, "the table of pairs does not list it"))
            continue
        key = CaptureKey(listed.object, listed.variant, numbers[listed.object, listed.pose])
        decision = Decision(key, "pairs", class_name=listed.class_name, pose_name=listed.pose)
        resolved.append((Evidence(one, (key.object, key.variant)), decision))
    return resolved, refused
