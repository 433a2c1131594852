"""Pairs from a table: a line names object, variant and pose of a photograph; a corrected table moves images."""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import NamedTuple

from toolkit.captures.manifest import CaptureRecord
from toolkit.core.errors import ToolkitError
from toolkit.core.foreign_tables import read_foreign_table
from toolkit.core.text import is_file_name, is_folder_name, shorten
from toolkit.core.workspace import Workspace
from toolkit.models.labels import plain_name
from toolkit.objects.spec import read_spec
from toolkit.rig.variants import VARIANTS
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.gates.check_photo import view_of_record
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

COLUMNS = ("file", "object", "variant", "pose")
MOST_BYTES = 16 << 20
MOST_WORD, MOST_DIGITS = 200, 20
"""Longest word for a pose or a class, and longest number of a pose."""


@dataclass(frozen=True)
class PairRow:
    """A line of `pairs.csv`.

    Attributes:
        file: of the photograph, below the imported folder, or its name alone.
        pose: a number or any words, the same for all photographs of a pair.
        class_name: of the object; empty to use its spec or its name.
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
    # the class is optional, and columns may stand in any order
    places = {name: table.find([name]) for name in (*COLUMNS, "class")}
    if missing := [name for name in COLUMNS if places[name] is None]:
        raise ToolkitError(f"{file}: line 1: no column {', '.join(missing)}: expected file,object,variant,pose[,class]")
    rows: list[PairRow] = []
    files: set[str] = set()
    shown: dict[tuple[str, str, str], str] = {}
    classes: dict[str, str] = {}
    for number, cells in table.lines:
        where = f"{file}: line {number}"
        # composed accents: a Mac's file names have them apart from their letters
        texts = [unicodedata.normalize("NFC", cell) for cell in cells]
        values = {name: "" if at is None or at >= len(texts) else texts[at] for name, at in places.items()}
        if empty := [name for name in COLUMNS if not values[name]]:
            raise ToolkitError(f"{where}: no {', '.join(empty)}: expected a value in each of {', '.join(COLUMNS)}")
        row = PairRow(values["file"], values["object"], values["variant"], values["pose"], values["class"], number)
        _check_row(row, where)
        if row.file in files:
            raise ToolkitError(
                f"{where}: {row.file} is listed twice: a photograph counts for a single pose and variant"
            )
        # a file, a pose of a variant, and the class of an object are unique
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


def number_poses(rows: Sequence[PairRow], earlier: Sequence[CaptureRecord] = ()) -> dict[tuple[str, str], int]:
    """Number each (object, pose): as before, else by the pose itself if all of an object's are numbers, else in order.

    Raises:
        ToolkitError: two poses of an object would have the same number.
    """
    names: dict[str, dict[str, None]] = {}  # as a set that keeps its order
    for row in rows:
        # poses in the order in which the table names them
        names.setdefault(row.object, {})[row.pose] = None
    numbers: dict[tuple[str, str], int] = {}
    for name, poses in names.items():
        # numbers that an earlier table gave: images of them exist
        known = {
            str(record.made["pose"]): record.pose_id
            for record in earlier
            if record.object == name and "pose" in record.made and record.pose_id is not None
        }
        are_numbers = all(pose.isdecimal() and len(pose) <= MOST_DIGITS and 1 <= int(pose) <= 99_999 for pose in poses)
        # "1" and "01" are different words for the same number
        if are_numbers and len({int(pose) for pose in poses}) == len(poses):
            own = {pose: int(pose) for pose in poses}
        # words are numbered in order; known words keep their number
        else:
            taken = set(known.values())
            free = (number for number in count(1) if number not in taken)
            own = {pose: known[pose] if pose in known else next(free) for pose in poses}
        # a number must not change its meaning while images of it are there
        words = {number: word for word, number in known.items()}
        for pose, number in own.items():
            other = words.get(number)
            if other not in (None, pose) and other not in poses:
                raise ToolkitError(
                    f"pose '{pose}' of '{name}' would be number {number}, which an earlier table gave to '{other}': "
                    "give a pose the same name, or import into another source"
                )
            numbers[name, pose] = number
    return numbers


class Matched(NamedTuple):
    """Photographs to store by a table, and (label, reason) of the others.

    Attributes:
        moved: records of images that leave their places, by the identity of their originals.
    """

    resolved: list[Resolved]
    refused: list[tuple[str, str]]
    moved: dict[tuple[str, int | None], CaptureRecord]


def match_pairs(
    rows: Sequence[PairRow], gathered: Gathered, index: SourceIndex, table: str, known: Sequence[str] = ()
) -> Matched:  # fmt: skip
    """Match photographs with a table's rows; imported photographs may move to other places.

    Args:
        rows: of the table.
        gathered: the photographs.
        index: earlier imports.
        table: the file's name.
        known: names of objects, beside the table's, that a folder may have.

    Raises:
        ToolkitError: a file of the table is none of the photographs, or several.
    """
    earlier = list(index.current.values())
    numbers, placed = number_poses(rows, earlier), _find_photographs(rows, gathered)
    # a table without a class uses that of an earlier table, if no spec has it
    others = [record for record in earlier if record.object not in known]
    classes = {other.object: str(other.made["class"]) for other in others if other.made.get("class")}
    names = ({*known, *(row.object for row in rows)}, {*VARIANTS, *(row.variant for row in rows)})
    found = Matched([], [], {})
    for candidate in gathered.candidates:
        row, record = placed.get(candidate.label), index.current.get(candidate.photo.identity)
        if row is None:
            # an image of this table that it no longer lists stays in the way
            if record is not None and str(record.made.get("row", "")).rpartition(":")[0] == table:
                unlisted = f"imported before as {record.path}, and {table} lists it no longer"
                found.refused.append((candidate.label, f"{unlisted}: delete that file, or list it again"))
            elif describe_imported(index, candidate.photo) is None:
                found.refused.append((candidate.label, "the table of pairs does not list it"))
            continue
        if against := _contradict_folder(candidate, row, names):
            # a folder that names another object or variant speaks against the table
            found.refused.append((candidate.label, against))
            continue
        key = CaptureKey(row.object, row.variant, numbers[row.object, row.pose])
        row = replace(row, class_name=row.class_name or classes.get(row.object, ""))
        if record is not None:
            # the image lies in its place already, under the same class and pose
            same = (record.object, record.variant, record.pose_id) == (key.object, key.variant, key.pose_id)
            is_class = row.class_name in ("", record.made.get("class", ""))
            if same and is_class and record.made.get("pose", row.pose) == row.pose:
                continue
            found.moved[candidate.photo.identity] = record
        elif describe_imported(index, candidate.photo):
            continue
        decision = Decision(key, "pairs", class_name=row.class_name, pose_name=row.pose, row=f"{table}:{row.line}")
        # a camera that an earlier run measured holds in every place
        located = None if record is None else view_of_record(record)
        found.resolved.append((Evidence(candidate, (key.object, key.variant), located=located), decision))
    return found


def _find_photographs(rows: Sequence[PairRow], gathered: Gathered) -> dict[str, PairRow]:
    """The row of each photograph by its label."""
    placed: dict[str, PairRow] = {}
    by_name: dict[str, list[str]] = {}
    for candidate in gathered.candidates:
        for word in {candidate.label, candidate.label.rpartition("/")[2]}:
            by_name.setdefault(word, []).append(candidate.label)
    lines: dict[str, int] = {}
    for row in rows:
        said = row.file.replace("\\", "/")
        # a single copy was kept, whichever the table lists
        wanted = gathered.kept.get(said, said)
        found = by_name.get(wanted, [])
        # a full path wins over the same file name in another folder
        found = [label for label in found if label == wanted] or found
        if len(found) != 1:
            what = "several photographs have that name: name it with its folder" if found else "no such photograph"
            raise ToolkitError(f"{row.file} in the table of pairs: {what}")
        placed.setdefault(found[0], row)
        # a copy that is listed too is reported as a duplicate, a second name of the same file is a contradiction
        if said not in gathered.kept and (line := lines.setdefault(found[0], row.line)) != row.line:
            raise ToolkitError(f"lines {line} and {row.line} of the table of pairs both name {found[0]}: keep one")
    return placed


def _contradict_folder(candidate: Candidate, row: PairRow, names: tuple[set[str], set[str]]) -> str:
    """Why the photograph's folders contradict its row, or nothing."""
    for kind, known, said in zip(("object", "variant"), names, (row.object, row.variant), strict=True):
        folder = next((word for word in reversed(candidate.folders) if word in known), said)
        if folder != said:
            return f"its folder names the {kind} '{folder}', line {row.line} of the table '{said}'"
    return ""


def check_classes(workspace: Workspace, rows: Sequence[PairRow], index: SourceIndex, listed: Sequence[str]) -> None:
    """Raise `ToolkitError` for a class that the object's spec or an earlier table contradicts.

    `listed` are the paths of images that the table places again.
    """
    specs = workspace.object_specs()
    for name, said in dict.fromkeys((row.object, row.class_name) for row in rows if row.class_name):
        known = str(read_spec(specs[name]).class_name) if name in specs else said
        if plain_name(said) != plain_name(known):
            raise ToolkitError(
                f"'{name}' has the class '{said}' in the table of pairs, and '{known}' in {specs[name]}: correct "
                "either, or give the photographed object another name"
            )
        for record in index.current.values():
            # other photographs keep the class that the spec had then
            is_said = record.object == name and "row" in record.made
            before = str(record.made.get("class", said)) if is_said else said
            if record.path not in listed and plain_name(said) != plain_name(before):
                raise ToolkitError(
                    f"'{name}' has the class '{said}' in the table of pairs, and '{before}' in an earlier table "
                    f"({record.made.get('row', record.path)}): list all its photographs again, or correct the class"
                )


def settle_moves(
    matched: Matched, index: SourceIndex, settings: ImportSettings, ask: Ask | None
) -> tuple[list[Resolved], list[CaptureRecord]]:
    """Return photographs whose places are or become free, and records of the images that leave theirs.

    An image that cannot leave stays in the way of the next, so this repeats until nothing changes.
    """
    # each round may put an image back that another waits for
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


def describe_moves(moved: Sequence[CaptureRecord], imported: Sequence[CaptureRecord]) -> list[str]:
    """A line for each image that a corrected table moved; `moved` are their earlier records."""
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
            lines.append(f"{record.made.get('original_name')}: moved {', '.join(changes)} by the new table")
    more = [f"{len(lines) - MOST_MOVES} more images were moved"] if len(lines) > MOST_MOVES else []
    return [*lines[:MOST_MOVES], *more]
