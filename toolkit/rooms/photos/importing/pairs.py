"""Pairs from a table: what each photograph shows by its line, and what a corrected table moves."""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import NamedTuple

import numpy as np

from toolkit.captures.manifest import CaptureRecord
from toolkit.core.errors import ToolkitError
from toolkit.core.foreign_tables import read_foreign_table
from toolkit.core.text import is_file_name, is_folder_name, shorten
from toolkit.core.workspace import Workspace
from toolkit.models.labels import plain_name
from toolkit.objects.spec import read_spec
from toolkit.rig.variants import VARIANTS
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.importing.evidence import Evidence
from toolkit.rooms.photos.importing.gather import (
    Candidate,
    CaptureKey,
    Gathered,
    SourceIndex,
    describe_imported,
    find_original,
)
from toolkit.rooms.photos.importing.match import Decision
from toolkit.rooms.photos.importing.resolve import Ask, Resolved, resolve_occupied
from toolkit.rooms.photos.posed_camera import PosedCamera

COLUMNS = ("file", "object", "variant", "pose")
MOST_BYTES = 16 << 20
MOST_WORD, MOST_DIGITS = 200, 20
"""Longest word for a pose or a class, and longest number of a pose."""


@dataclass(frozen=True)
class PairRow:
    """One line of `pairs.csv`.

    Attributes:
        file: of the photograph, below the folder that is imported; its name alone where that is enough.
        object, variant: what it shows.
        pose: what pairs it with those of other variants: a number, or any words.
        class_name: what the object should be recognised as; empty where its spec or its name says it.
        line: number in the table, from 1.
    """

    file: str
    object: str
    variant: str
    pose: str
    class_name: str = ""
    line: int = 0


def read_pairs(file: Path) -> list[PairRow]:
    """Read `pairs.csv`: a heading with file, object, variant, pose and perhaps class, then a line per photograph.

    Raises:
        ToolkitError: no such file, a column or a value is missing, a name is not allowed, or two lines contradict.
    """
    table = read_foreign_table(file, MOST_BYTES)
    places = {name: table.find([name]) for name in (*COLUMNS, "class")}
    if missing := [name for name in COLUMNS if places[name] is None]:
        raise ToolkitError(f"{file}: line 1: no column {', '.join(missing)}: expected file,object,variant,pose[,class]")
    rows: list[PairRow] = []
    files: set[str] = set()
    shown: dict[tuple[str, str, str], str] = {}
    classes: dict[str, str] = {}
    for number, cells in table.lines:
        where = f"{file}: line {number}"
        # one way to write accents: a Mac's file names have them apart from their letters
        values = {name: "" if at is None or at >= len(cells) else _compose(cells[at]) for name, at in places.items()}
        if empty := [name for name in COLUMNS if not values[name]]:
            raise ToolkitError(f"{where}: no {', '.join(empty)}: expected a value in each of {', '.join(COLUMNS)}")
        row = PairRow(values["file"], values["object"], values["variant"], values["pose"], values["class"], number)
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
    for what, word in (("pose", row.pose), ("class", row.class_name)):
        if len(word) > MOST_WORD or not word.isprintable():
            expected = f"expected at most {MOST_WORD} letters that can be shown"
            raise ToolkitError(f"{where}: {what} '{shorten(word, MOST_WORD)}': {expected}")
    if not is_file_name(row.object):
        raise ToolkitError(f"{where}: object '{row.object}': expected a name of letters, digits, - and _")
    if not is_folder_name(row.variant):
        raise ToolkitError(f"{where}: variant '{row.variant}': expected a name of letters, digits, '.', - and _")


def _compose(text: str) -> str:
    return unicodedata.normalize("NFC", text)


def number_poses(rows: Sequence[PairRow], earlier: Sequence[CaptureRecord] = ()) -> dict[tuple[str, str], int]:
    """A number for each (object, pose).

    A pose that was imported before keeps its number. Otherwise it is the pose itself where all of an object's are
    numbers, else the next by first mention.

    Raises:
        ToolkitError: two poses of an object would have one number.
    """
    names: dict[str, dict[str, None]] = {}  # as a set that keeps its order
    for row in rows:
        names.setdefault(row.object, {})[row.pose] = None
    numbers: dict[tuple[str, str], int] = {}
    for name, poses in names.items():
        known = {
            str(record.made["pose"]): record.pose_id
            for record in earlier
            if record.object == name and "pose" in record.made and record.pose_id is not None
        }
        are_numbers = all(pose.isdecimal() and len(pose) <= MOST_DIGITS and 1 <= int(pose) <= 99_999 for pose in poses)
        # "1" and "01" are different words and one number
        if are_numbers and len({int(pose) for pose in poses}) == len(poses):
            own = {pose: int(pose) for pose in poses}
        else:
            taken = set(known.values())
            free = (number for number in count(1) if number not in taken)
            own = {pose: known[pose] if pose in known else next(free) for pose in poses}
        words = {number: word for word, number in known.items()}
        for pose, number in own.items():
            other = words.get(number)
            if other not in (None, pose) and other not in poses:
                raise ToolkitError(
                    f"pose '{pose}' of '{name}' would be number {number}, which an earlier table gave to '{other}': "
                    "call the same pose the same, or import into another source"
                )
            numbers[name, pose] = number
    return numbers


class Matched(NamedTuple):
    """What a table says of the photographs that were given.

    Attributes:
        resolved: those that are to be stored.
        refused: (label, reason) of those that it does not place.
        moved: records of images that leave their places, by the identity of their originals.
    """

    resolved: list[Resolved]
    refused: list[tuple[str, str]]
    moved: dict[tuple[str, int | None], CaptureRecord]


def match_pairs(
    rows: Sequence[PairRow], gathered: Gathered, index: SourceIndex, table: str, known: Sequence[str] = ()
) -> Matched:  # fmt: skip
    """What each photograph shows by the table; an imported photograph is moved if the table says otherwise.

    Args:
        rows: of the table.
        gathered: the photographs.
        index: what was imported before.
        table: the file's name.
        known: names of objects, beside the table's, that a folder may be called by.

    Raises:
        ToolkitError: a file of the table is none of the photographs, or several.
    """
    earlier = list(index.current.values())
    numbers, placed = number_poses(rows, earlier), _find_photographs(rows, gathered)
    # a table without a class goes on with the earlier one's, where no spec has it
    others = [one for one in earlier if one.object not in known]
    classes = {other.object: str(other.made["class"]) for other in others if other.made.get("class")}
    names = ({*known, *(row.object for row in rows)}, {*VARIANTS, *(row.variant for row in rows)})
    found = Matched([], [], {})
    for candidate in gathered.candidates:
        row, record = placed.get(candidate.label), index.current.get(candidate.photo.identity)
        if row is None:
            reason = _explain_unlisted(record, table)
            if reason or describe_imported(index, candidate.photo) is None:
                found.refused.append((candidate.label, reason or "the table of pairs does not list it"))
            continue
        if against := _contradict_folder(candidate, row, names):
            found.refused.append((candidate.label, against))
            continue
        key = CaptureKey(row.object, row.variant, numbers[row.object, row.pose])
        row = replace(row, class_name=row.class_name or classes.get(row.object, ""))
        if record is not None and _is_placed(record, key, row):
            continue
        if record is not None:
            found.moved[candidate.photo.identity] = record
        elif describe_imported(index, candidate.photo):
            continue
        decision = Decision(key, "pairs", class_name=row.class_name, pose_name=row.pose, row=f"{table}:{row.line}")
        located = None if record is None else _recall_camera(record)
        found.resolved.append((Evidence(candidate, (key.object, key.variant), located=located), decision))
    return found


def _recall_camera(record: CaptureRecord) -> PosedCamera | None:
    """Where a photograph's camera stood, as an earlier run measured it: that holds wherever a table puts it."""
    if record.T_world_camera is None or record.camera is None:
        return None
    return PosedCamera(np.array(record.T_world_camera), record.camera)


def _find_photographs(rows: Sequence[PairRow], gathered: Gathered) -> dict[str, PairRow]:
    """The row of each photograph by its label."""
    placed: dict[str, PairRow] = {}
    by_name: dict[str, list[str]] = {}
    for candidate in gathered.candidates:
        for word in {candidate.label, candidate.label.rpartition("/")[2]}:
            by_name.setdefault(word, []).append(candidate.label)
    for row in rows:
        wanted = row.file.replace("\\", "/")
        # a single copy was kept, whichever the table lists
        wanted = gathered.kept.get(wanted, wanted)
        found = by_name.get(wanted, [])
        # a full path wins over the same file name in another folder
        found = [label for label in found if label == wanted] or found
        if len(found) != 1:
            what = "several photographs have that name: name it with its folder" if found else "no such photograph"
            raise ToolkitError(f"{row.file} in the table of pairs: {what}")
        placed.setdefault(found[0], row)
    return placed


def _is_placed(record: CaptureRecord, key: CaptureKey, row: PairRow) -> bool:
    """Whether an image lies where a row says, as what the row says."""
    same = (record.object, record.variant, record.pose_id) == (key.object, key.variant, key.pose_id)
    is_class = row.class_name in ("", record.made.get("class", ""))
    return same and is_class and record.made.get("pose", row.pose) == row.pose


def _explain_unlisted(record: CaptureRecord | None, table: str) -> str:
    """Why an image that a table placed before stays in the way, where the table lists it no longer."""
    if record is None or str(record.made.get("row", "")).rpartition(":")[0] != table:
        return ""
    return f"imported before as {record.path}, and {table} lists it no longer: delete that file, or list it again"


def _contradict_folder(candidate: Candidate, row: PairRow, names: tuple[set[str], set[str]]) -> str:
    """What the photograph's folders say against its row."""
    for kind, known, said in zip(("object", "variant"), names, (row.object, row.variant), strict=True):
        folder = next((word for word in reversed(candidate.folders) if word in known), said)
        if folder != said:
            return f"its folder says {kind} '{folder}', line {row.line} of the table says '{said}'"
    return ""


def check_classes(workspace: Workspace, rows: Sequence[PairRow], index: SourceIndex, listed: Sequence[str]) -> None:
    """Refuse a class that the object's spec or an earlier table contradicts.

    Args:
        workspace: whose specs are meant.
        rows: of the table.
        index: what was imported before.
        listed: paths of images that the table places anew.

    Raises:
        ToolkitError: names both classes and what to do.
    """
    specs = workspace.object_specs()
    for name, said in dict.fromkeys((row.object, row.class_name) for row in rows if row.class_name):
        known = str(read_spec(specs[name]).class_name) if name in specs else said
        if plain_name(said) != plain_name(known):
            raise ToolkitError(
                f"'{name}' has the class '{said}' in the table of pairs, and '{known}' in {specs[name]}: correct one "
                "of them, or call the photographed object otherwise"
            )
        for record in index.current.values():
            # other photographs keep the class that the spec had then
            is_said = record.object == name and "row" in record.made
            before = str(record.made.get("class", said)) if is_said else said
            if record.path not in listed and plain_name(said) != plain_name(before):
                raise ToolkitError(
                    f"'{name}' has the class '{said}' in the table of pairs, and '{before}' in an earlier one "
                    f"({record.made.get('row', record.path)}): list all its photographs again, or correct the class"
                )


def settle_moves(
    matched: Matched, index: SourceIndex, settings: ImportSettings, ask: Ask | None
) -> tuple[list[Resolved], list[CaptureRecord]]:
    """Photographs whose places are free, or become free; and records of the images that leave theirs.

    An image that cannot leave stays in the way of the next, so places are settled until nothing changes.
    """
    moved = dict(matched.moved)
    while True:
        refused: list[tuple[str, str]] = []
        leaving = {record.path for record in moved.values()}
        kept = resolve_occupied(matched.resolved, refused, index, settings, ask, leaving)
        still = {item.candidate.photo.identity for item, _ in kept}
        if moved.keys() <= still:
            matched.refused.extend(refused)
            return kept, list(moved.values())
        moved = {identity: record for identity, record in moved.items() if identity in still}


MOST_MOVES = 20
"""Lines about single images."""


def describe_moves(moved: Sequence[CaptureRecord], imported: Sequence[CaptureRecord]) -> list[str]:
    """A line for each image that a corrected table moved; `moved` are their records of before."""
    lines = []
    earlier = {find_original(record): record for record in moved}
    for record in imported:
        before = earlier.get(find_original(record))
        if before is not None:
            changes = [] if before.path == record.path else [f"from {before.path} to {record.path}"]
            old, new = (state.made.get("class", "none") for state in (before, record))
            changes += [] if old == new else [f"class {old} to {new}"]
            names = [str(state.made.get("pose", "none")) for state in (before, record)]
            changes += [] if names[0] == names[1] else [f"pose '{names[0]}' to '{names[1]}'"]
            lines.append(f"{record.made.get('original_name')}: moved {', '.join(changes)}, as the table says now")
    more = [f"{len(lines) - MOST_MOVES} more were moved likewise"] if len(lines) > MOST_MOVES else []
    return [*lines[:MOST_MOVES], *more]
