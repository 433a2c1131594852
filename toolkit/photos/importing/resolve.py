"""What is open once every photograph was looked at alone: doubts, two of a pose, retakes; and pairs from a table."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes, sha256_file
from toolkit.core.foreign_tables import read_foreign_table
from toolkit.core.text import is_file_name, is_folder_name
from toolkit.imaging.read import show_path
from toolkit.photos import ImportSettings
from toolkit.photos.importing.evidence import Evidence
from toolkit.photos.importing.gather import Candidate, CaptureKey, SourceIndex, describe_imported, find_images
from toolkit.photos.importing.match import Decision, Doubt, MatchRender, decide_pose, measure_match
from toolkit.photos.importing.store import encode_photo
from toolkit.photos.photo import Photo
from toolkit.rig.plan import CapturePlan

Ask = Callable[[str, Sequence[str]], "str | None"]
"""(question, answers that are possible) -> the answer, None for leaving the photograph out."""
Resolved = tuple[Evidence, Decision]
"""A photograph that is to be stored."""


def resolve_photos(
    evidence: Sequence[Evidence], plan: CapturePlan, index: SourceIndex, settings: ImportSettings,
    ask: Ask | None = None, by_render: MatchRender | None = None,
) -> tuple[list[Resolved], list[tuple[str, str]]]:  # fmt: skip
    """Decide for all photographs; what stays open is asked, and refused where nobody answers.

    Returns:
        Photographs to store in that order, and (label, reason) of those that are refused.
    """
    resolved: list[Resolved] = []
    refused: list[tuple[str, str]] = []
    for one in evidence:
        outcome = _decide_one(one, plan, settings, by_render)
        if isinstance(outcome, Doubt) and ask is not None and one.unusable is None:
            outcome = _ask_pose(one, outcome, plan, ask)
        if isinstance(outcome, Doubt):
            refused.append((one.candidate.label, outcome.reason))
        else:
            resolved.append((one, outcome))
    # "replace" says that the latest counts, so two of one pose need no question
    if not settings.replace:
        resolved = _resolve_doubles(resolved, refused, ask)
    return resolve_occupied(resolved, refused, index, settings, ask), refused


def _decide_one(
    one: Evidence, plan: CapturePlan, settings: ImportSettings, by_render: MatchRender | None
) -> Decision | Doubt:
    if one.unusable is not None:
        return Doubt(one.unusable)
    if settings.pose is not None and settings.object and settings.variant:
        key = CaptureKey(settings.object, settings.variant, settings.pose)
        return Decision(key, "user", measure_match(one, key, plan))
    return decide_pose(one, plan, settings.match, by_render)


def _ask_pose(one: Evidence, doubt: Doubt, plan: CapturePlan, ask: Ask) -> Decision | Doubt:
    group = one.find_group()
    if group is None and doubt.choices:
        listed = ", ".join(f"{number} {choice}" for number, choice in enumerate(doubt.choices, 1))
        numbers = [str(number) for number in range(1, len(doubt.choices) + 1)]
        answer = ask(f"{one.candidate.label}: {doubt.reason}. Which is it: {listed}?", numbers)
        if answer is None:
            return doubt
        key = doubt.choices[int(answer) - 1]
        return Decision(key, "user", measure_match(one, key, plan))
    if group is None:
        return doubt
    poses = [str(pose.id) for pose in plan.objects[group[0]]]
    likely = [str(choice.pose_id) for choice in doubt.choices]
    hint = f"; likely {' or '.join(likely)}" if likely else ""
    answer = ask(f"{one.candidate.label}: {doubt.reason}. Which pose of {'/'.join(group)} is it{hint}?", poses)
    if answer is None:
        return doubt
    key = CaptureKey(*group, int(answer))
    return Decision(key, "user", measure_match(one, key, plan))


def _resolve_doubles(resolved: list[Resolved], refused: list[tuple[str, str]], ask: Ask | None) -> list[Resolved]:
    """Of several photographs of one pose keep the one that a person chooses, or none."""
    by_key: dict[CaptureKey, list[Evidence]] = {}
    for one, decision in resolved:
        by_key.setdefault(decision.key, []).append(one)
    kept = {key: ones[0] for key, ones in by_key.items() if len(ones) == 1}
    for key, ones in by_key.items():
        if key in kept:
            continue
        labels = [one.candidate.label for one in ones]
        listed = ", ".join(f"{i} {label}" for i, label in enumerate(labels, 1))
        numbers = [str(i) for i in range(1, len(ones) + 1)]
        answer = ask(f"{len(ones)} photographs show {key}: {listed}. Which one counts?", numbers) if ask else None
        for number, one in zip(numbers, ones, strict=True):
            if number == answer:
                kept[key] = one
                continue
            label = one.candidate.label
            if answer:
                reason = f"{key}: {labels[int(answer) - 1]} was chosen"
            else:
                others = ", ".join(other for other in labels if other != label)
                reason = f"{key} is shown as well by {others}: take one away, or let the latest count (replace)"
            refused.append((label, reason))
    return [(one, decision) for one, decision in resolved if kept.get(decision.key) is one]


def resolve_occupied(
    resolved: list[Resolved], refused: list[tuple[str, str]], index: SourceIndex, settings: ImportSettings,
    ask: Ask | None,
) -> list[Resolved]:  # fmt: skip
    """Photographs for poses that have an image replace it only when they are later, and when that was asked for."""
    kept = []
    for one, decision in resolved:
        candidate, key = one.candidate, decision.key
        there = _find_other(candidate.photo, key, index)
        if there is None:
            kept.append((one, decision))
            continue
        path, record_taken, original = there
        came = f" (from {original})" if original else ""
        taken = candidate.photo.taken
        # wall clocks, since one of the two may have no zone
        if taken and record_taken and _wall(taken) < _wall(record_taken):
            refused.append((candidate.label, f"{key} has the later photograph {path}{came}"))
        elif settings.replace or (
            ask and ask(f"{candidate.label}: {key} has {path}{came}. Replace it, and keep it aside?", ["y"]) == "y"
        ):
            kept.append((one, decision))
        else:
            asked = "a retake replaces it only where that is asked for (replace)"
            refused.append((candidate.label, f"{key} has {path}{came}: {asked}"))
    return kept


def _find_other(photo: Photo, key: CaptureKey, index: SourceIndex) -> tuple[str, datetime | None, str | None] | None:
    """Path, time and original name of another image that is there for the same pose."""
    for file in find_images(index, key):
        path = show_path(file.relative_to(index.source_dir).parts)
        record = index.records.get(path)
        if record is None or record.image_sha256 != sha256_file(file):
            # a run that was killed between image and record left this photograph itself
            # bytes are compared, not names: the image is there and its line is not
            if sha256_file(file) == sha256_bytes(encode_photo(photo)):
                continue
            return path, None, None
        return path, _read_time(record.made.get("taken")), record.made.get("original_name")
    return None


def _read_time(text: object) -> datetime | None:
    try:
        return datetime.fromisoformat(text) if isinstance(text, str) else None
    except ValueError:
        return None


def _wall(taken: datetime) -> datetime:
    return taken.replace(tzinfo=None)


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
        values = {name: "" if at is None or at >= len(cells) else cells[at] for name, at in places.items()}
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
        # "1" and "01" are different words and one number
        unique = len({int(pose) for pose in poses}) == len(poses) if are_numbers else False
        for i, pose in enumerate(poses, 1):
            numbers[name, pose] = int(pose) if unique else i
    return numbers


def match_pairs(
    rows: Sequence[PairRow], candidates: Sequence[Candidate], index: SourceIndex, duplicates: Mapping[str, str]
) -> tuple[list[Resolved], list[tuple[str, str]]]:  # fmt: skip
    """What each new photograph shows by the table, and (label, reason) of those that it does not place.

    `duplicates` are labels of copies, which were left out already.

    Raises:
        ToolkitError: a file of the table is none of the photographs, or several.
    """
    numbers, placed = number_poses(rows), {}
    for row in rows:
        wanted = row.file.replace("\\", "/")
        if wanted in duplicates:
            continue
        found = [one for one in candidates if wanted in (one.label, one.photo.path.name)]
        # a full path wins over the same file name in another folder
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
