"""`toolkit import`: from a phone's photographs to a capture folder with object, variant and pose of each."""

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any

from toolkit.captures.manifest import CaptureRecord, write_transforms
from toolkit.core.console import progress
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import delete_file, inside, real_path
from toolkit.core.records import hold_folder
from toolkit.core.text import is_folder_name, list_some
from toolkit.core.workspace import Workspace
from toolkit.evaluation.summaries import list_reasons
from toolkit.imaging.read import UnreadableImage
from toolkit.rig import PAIR
from toolkit.rig.plan import CapturePlan, hash_pose, open_plan
from toolkit.rig.variants import VARIANTS
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.gates import Check
from toolkit.rooms.photos.importing.align import Clues, place_with_gaps
from toolkit.rooms.photos.importing.copies import find_copied
from toolkit.rooms.photos.importing.evidence import Evidence, collect_evidence
from toolkit.rooms.photos.importing.gather import (
    Candidate,
    CaptureKey,
    Gathered,
    SourceIndex,
    describe_imported,
    drop_records,
    find_images,
    find_original,
    gather_photos,
    index_source,
    is_whole,
)
from toolkit.rooms.photos.importing.match import MatchRender, RenderMatcher, name_pose
from toolkit.rooms.photos.importing.pairs import check_classes, describe_moves, match_pairs, read_pairs, settle_moves
from toolkit.rooms.photos.importing.resolve import Ask, Resolved, resolve_photos
from toolkit.rooms.photos.importing.store import Subject, read_subject, store_photo
from toolkit.rooms.photos.locate import Locate, locate_by_board
from toolkit.rooms.photos.photo import load_pixels
from toolkit.rooms.photos.shot_order import ShotStep, read_shots


def check_settings(workspace: Workspace, settings: ImportSettings) -> list[str]:
    """Check names; returns notes for the user. Unknown objects and misspelt variants raise `ToolkitError`."""
    if settings.object is not None:
        workspace.object_spec(settings.object)
    variant = settings.variant
    if variant is None or variant in VARIANTS:
        return []
    if not is_folder_name(variant):
        raise FieldError("expected a name of letters, digits, '-', '_' and '.'", {"variant": variant})
    known = [*VARIANTS, *workspace.patches(), *workspace.textures()]
    # near a known name: a typing error would make another folder
    if variant not in known and get_close_matches(variant, known, n=1, cutoff=0.8):
        raise one_of("variant", variant, known)
    return [f"variant '{variant}' is unknown: the record does not name what is on the object"]


def refuse_captures(workspace: Workspace, paths: Sequence[Path]) -> None:
    """Raise `ToolkitError` for a path in the workspace's captures/, or for a path that holds them."""
    captures = real_path(workspace.captures_dir)
    for path in paths:
        real = real_path(path)
        if real.is_relative_to(captures) or captures.is_relative_to(real):
            raise ToolkitError(f"{path} is, holds or lies in {captures}: name the folder with the camera's photos")


@dataclass(frozen=True)
class Coverage:
    """Photographs of an object in a variant.

    Attributes:
        imported: number of new photographs.
        there: number of poses that have an image.
        missing: poses of the plan that have none.
        mean_error_deg, mean_error_mm: of the cameras that a board located, against their poses; None without.
    """

    object: str
    variant: str
    imported: int
    there: int
    missing: tuple[int, ...]
    mean_error_deg: float | None
    mean_error_mm: float | None


def measure_coverage(
    index: SourceIndex, whole: Sequence[CaptureRecord], plan: CapturePlan, imported: Sequence[CaptureRecord],
    name: str | None = None,
) -> tuple[Coverage, ...]:  # fmt: skip
    """Count poses of `name`, and of each object with images in the source, in each of its variants and in the pair."""
    own: dict[tuple[str, str], list[CaptureRecord]] = defaultdict(list)
    for record in whole:
        own[record.object, record.variant].append(record)
    now = Counter((record.object, record.variant) for record in imported)
    rows = []
    for object_name in sorted({*(group[0] for group in own), *filter(None, [name])} & set(plan.objects)):
        ids = [pose.id for pose in plan.objects[object_name]]
        # the pair is always listed, so that a half that was never shot shows as missing
        others = {variant for other, variant in own if other == object_name} - set(PAIR)
        for variant in (*PAIR, *sorted(others)):
            group = (object_name, variant)
            # images count, however they got there
            there = {pose_id for pose_id in ids if find_images(index, CaptureKey(*group, pose_id))}
            rows.append(Coverage(
                *group, now[group], len(there), tuple(pose for pose in ids if pose not in there),
                mean_error_deg=_mean(own[group], "pose_error_deg"), mean_error_mm=_mean(own[group], "pose_error_mm"),
            ))  # fmt: skip
    return tuple(rows)


def count_variants(
    index: SourceIndex, whole: Sequence[CaptureRecord], imported: Sequence[CaptureRecord]
) -> tuple[Coverage, ...]:  # fmt: skip
    """`measure_coverage` of photographs without a plan: missing are the poses of the object's other variants."""
    # poses that any variant of the object has
    poses: dict[str, set[int]] = {}
    there: dict[tuple[str, str], set[int]] = {}
    for record in whole:
        if record.pose_id is not None:
            poses.setdefault(record.object, set()).add(record.pose_id)
            there.setdefault((record.object, record.variant), set()).add(record.pose_id)
    now = Counter((record.object, record.variant) for record in imported)
    return tuple(
        Coverage(*group, now[group], len(found), tuple(sorted(poses[group[0]] - found)), None, None)
        for group, found in sorted(there.items())
    )


def _mean(records: Sequence[CaptureRecord], key: str) -> float | None:
    values = [float(value) for record in records if isinstance(value := record.made.get(key), int | float)]
    return sum(values) / len(values) if values else None


SHOWN_OTHERS = 5
BLACK_INK = 0.35
"""Light of the board's ink as a share of its paper's; a board in 10 % of ink has 0.7 and more."""


@dataclass(frozen=True)
class ImportResult:
    """Result of an import into captures/SOURCE.

    Attributes:
        imported: records of the new photographs.
        before: (label, where) of photographs that were imported before.
        duplicates: (label, reason) of photographs that were given twice.
        refused: (label, reason) of photographs that could not be imported.
        coverage: per object and variant.
        notes: for the user.
    """

    source_dir: Path
    imported: tuple[CaptureRecord, ...]
    before: tuple[tuple[str, str], ...]
    duplicates: tuple[tuple[str, str], ...]
    refused: tuple[tuple[str, str], ...]
    coverage: tuple[Coverage, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The same for scripts."""
        return {
            "folder": str(self.source_dir),
            "imported": [record.model_dump() for record in self.imported],
            "before": list_reasons(self.before),
            "duplicates": list_reasons(self.duplicates),
            "refused": list_reasons(self.refused),
            "coverage": [{**vars(row), "missing": list(row.missing)} for row in self.coverage],
            "notes": list(self.notes),
        }


def import_photos(
    workspace: Workspace, paths: Sequence[Path], settings: ImportSettings | None = None, *,
    locate: Locate | None = None, check: Check | None = None, ask: Ask | None = None,
    by_render: MatchRender | None = None,
) -> ImportResult:  # fmt: skip
    """Import photographs into captures/SOURCE; earlier imports stay, and nothing in doubt is guessed.

    Each photograph is whole on disk and in the manifest before the next begins, so interrupted runs resume. Originals
    are read, never written.

    Args:
        workspace: its plan, board, lenses and captures are used.
        paths: folders, photographs, videos.
        settings: options of the import.
        locate: finds a photograph's camera; by default from the workspace's board.
        check: the gates for every photograph; their numbers are kept with it.
        ask: puts questions to a person; None without a person.
        by_render: finds the pose of a photograph without other evidence; by default, by rendering every pose.

    Raises:
        ToolkitError: nothing to import, an unknown object, a broken plan, shot list or manifest, settings that
            contradict each other, or a disk that is full or read-only.
    """
    settings = settings or ImportSettings()
    # two imports at once would give a pose to two photographs
    with hold_folder(workspace.source_dir(settings.source)):
        return _import_photos(
            workspace,
            [Path(path) for path in paths],
            settings,
            locate=locate,
            check=check,
            ask=ask,
            by_render=by_render,
        )


def _import_photos(
    workspace: Workspace, paths: Sequence[Path], settings: ImportSettings, *, locate: Locate | None,
    check: Check | None, ask: Ask | None, by_render: MatchRender | None,
) -> ImportResult:  # fmt: skip
    # refuse what cannot work before anything is read
    notes = check_settings(workspace, settings)
    refuse_captures(workspace, paths)
    if settings.pairs is not None:
        locate = locate or (locate_by_board(workspace) if workspace.board else None)
        return _import_pairs(workspace, paths, settings, settings.pairs, locate=locate, check=check, ask=ask)
    # the plan and its shot list, the photographs, and earlier imports
    plan = open_plan(workspace, [settings.object] if settings.object else None)
    steps = _read_steps(workspace, plan, settings, notes)
    gathered = gather_photos(paths, settings.every_s)
    index = index_source(workspace.source_dir(settings.source))
    _check_pose(plan, settings, gathered)
    # evidence of each photograph; gaps in the order are bridged by what the pictures show
    locate, matcher = locate or locate_by_board(workspace), RenderMatcher(workspace, plan)
    by_render = by_render or matcher
    evidence = collect_evidence(gathered.candidates, plan, steps, index, settings, locate=locate, rank=matcher.rank)
    if settings.match == "auto" and settings.first_shot is None and settings.pose is None:
        clues = Clues(workspace, plan, matcher)
        evidence = place_with_gaps(evidence, plan, steps, index, clues, again=settings.replace)
    # a pose for each, then into the captures
    resolved, refused = resolve_photos(evidence, plan, index, settings, ask, by_render=by_render)
    resolved = [(item, name_pose(decision, plan)) for item, decision in drop_copies(resolved, refused)]
    imported, broken = _store_all(workspace, index, resolved, settings, check, notes=notes)
    # photographs without a measured board count as pale: there is nothing to warn of
    black = sum(record.made.get("board_ink", 1.0) < BLACK_INK for record in imported)
    if black:
        puzzle = f"the board is printed in black in {black} photographs, and networks take it for a puzzle"
        notes.append(f"{puzzle}: print a pale board with 'toolkit print --board --ink 10'")
    notes += _question_order(gathered, [item for item, decision in resolved if decision.matched_by == "order"])
    notes += _list_other_plans(index, plan, {record.object for record in imported})
    coverage = partial(measure_coverage, plan=plan, imported=imported, name=settings.object)
    return _finish(index, gathered, imported, [*refused, *broken], notes=notes, coverage=coverage)


def _import_pairs(
    workspace: Workspace, paths: Sequence[Path], settings: ImportSettings, table: Path, *, locate: Locate | None,
    check: Check | None, ask: Ask | None,
) -> ImportResult:  # fmt: skip
    """Import the pairs of a table, without a plan; a board, if named, gives the cameras alone."""
    rows, notes = read_pairs(table), list[str]()
    gathered = gather_photos(paths, settings.every_s)
    index = index_source(workspace.source_dir(settings.source))
    # rows of the photographs, and images that leave their places
    matched = match_pairs(rows, gathered, index, table.name, list(workspace.object_specs()))
    placed = {item.candidate.photo.identity for item, _ in matched.resolved}
    listed = [record.path for identity, record in index.current.items() if identity in placed]
    check_classes(workspace, rows, index, listed)
    resolved, moved = settle_moves(matched, index, settings, ask)
    # a board only adds the camera: object, variant and pose come from the table
    refused = matched.refused
    if locate is not None:
        resolved = _locate_pairs(resolved, locate, notes)
    # two rows with the same picture under different names
    resolved = drop_copies(resolved, refused)
    stored = {item.candidate.photo.identity for item, _ in resolved}
    moved = [record for record in moved if find_original(record) in stored]
    # a run that is stopped after this imports the photographs that move again
    for record in moved:
        delete_file(inside(index.source_dir, record.path))
        index.records.pop(record.path, None)
    drop_records(index.source_dir, {record.path for record in moved})
    imported, broken = _store_all(workspace, index, resolved, settings, check, notes=notes)
    notes += describe_moves(moved, imported)
    coverage = partial(count_variants, imported=imported)
    return _finish(index, gathered, imported, [*refused, *broken], notes=notes, coverage=coverage)


def _question_order(gathered: Gathered, ordered: Sequence[Evidence]) -> list[str]:
    """Notes on photographs that their order alone places."""
    if not ordered:
        return []
    notes = (
        [] if gathered.by_time else ["not all photographs have times that can be compared: they are ordered by name"]
    )
    labels = {item.candidate.label for item in ordered}
    ties = [tie for tie in gathered.find_ties() if labels & set(tie)]
    if ties:
        more = f", and {len(ties) - 1} more such groups" if len(ties) > 1 else ""
        notes.append(f"taken at the same time, and so ordered by name: {', '.join(ties[0])}{more}")
    by_order = [(item, item.candidate.label, item.ordered.pose_id) for item in ordered if item.ordered is not None]
    if wrong := [f"{label}: pose {item.looks}, not {pose}" for item, label, pose in by_order if item.looks is not None]:
        notes.append(
            f"{len(wrong)} of {len(ordered)} photographs look like another pose than that of their order ({wrong[0]}): "
            "look at them, or match them by 'auto'"
        )
    if named := [
        f"{label}: pose {pose} by its order" for item, label, pose in by_order if item.named not in (None, pose)
    ]:
        notes.append(
            f"{len(named)} of {len(ordered)} photographs have another pose in their name than by their order "
            f"({named[0]}): match them by 'name', if the names are right"
        )
    unseen = sum(not item.is_compared and item.located is None and item.named is None for item in ordered)
    if unseen:
        notes.append(
            f"{unseen} of {len(ordered)} photographs are placed by their order alone: they look like no render of "
            "the object, or it cannot be rendered"
        )
    return notes


def _list_other_plans(index: SourceIndex, plan: CapturePlan, names: Collection[str]) -> list[str]:
    """Notes on objects and variants with photographs that were imported by another plan."""
    hashes = {(name, pose.id): hash_pose(plan.camera, pose) for name in names for pose in plan.objects[name]}
    others = Counter(
        (record.object, record.variant)
        for record in index.records.values()
        if record.object in names
        and record.made.get("pose_sha256") not in (None, hashes.get((record.object, record.pose_id or 0)))
    )
    return [
        f"{name}/{variant}: {count} photographs are of another plan: the same pose numbers now mean other places"
        for (name, variant), count in sorted(others.items())
    ]


def _locate_pairs(resolved: Sequence[Resolved], locate: Locate, notes: list[str]) -> list[Resolved]:
    """Add the cameras of photographs that show the board."""
    made: list[Resolved] = []
    with progress("finding the board", len(resolved)) as bar:
        for evidence, decision in resolved:
            photo, label = evidence.candidate.photo, evidence.candidate.label
            with suppress(UnreadableImage):  # storing it reports the fault
                found = locate(photo, load_pixels(photo))
                if isinstance(found, str):
                    notes.append(f"{label}: its camera is not known: {found}")
                else:
                    evidence = replace(evidence, located=found)
            made.append((evidence, decision))
            bar.advance(note=label)
    return made


def _finish(
    index: SourceIndex, gathered: Gathered, imported: Sequence[CaptureRecord], refused: Sequence[tuple[str, str]], *,
    notes: list[str], coverage: Callable[[SourceIndex, Sequence[CaptureRecord]], tuple[Coverage, ...]],
) -> ImportResult:  # fmt: skip
    """Write the cameras' file, and return the result; `index` is from before the import."""
    # what this run imported is not counted as imported before
    new = {record.made.get("original_sha256") for record in imported}
    before = [
        (candidate.label, where)
        for candidate in gathered.candidates
        if candidate.photo.sha256 not in new and (where := describe_imported(index, candidate.photo))
    ]
    if gathered.others:
        notes.append(f"not photographs, left alone: {list_some(gathered.others, SHOWN_OTHERS)}")
    # read again, as the files have changed since the old index
    after = index_source(index.source_dir)
    whole = [record for _, record in sorted(after.records.items()) if is_whole(index.source_dir, record)]
    if whole:
        write_transforms(index.source_dir, whole)
    return ImportResult(
        index.source_dir, imported=tuple(imported), before=tuple(before), duplicates=gathered.duplicates,
        refused=(*gathered.unreadable, *refused), coverage=coverage(after, whole), notes=tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def drop_copies(resolved: Sequence[Resolved], refused: list[tuple[str, str]]) -> list[Resolved]:
    """Return the first of the photographs with equal pixels in an object's variant; refuse the others."""
    kept: list[Resolved] = []
    seen: dict[tuple[str, str], list[Candidate]] = {}
    for evidence, decision in resolved:
        own, candidate = seen.setdefault((decision.key.object, decision.key.variant), []), evidence.candidate
        number = find_copied(candidate.photo, [other.photo for other in own])
        if number is not None:
            copied = f"a copy of {own[number].label}: the same photograph counts once, take another"
            refused.append((candidate.label, copied))
            continue
        own.append(candidate)
        kept.append((evidence, decision))
    return kept


def _read_steps(workspace: Workspace, plan: CapturePlan, settings: ImportSettings, notes: list[str]) -> list[ShotStep]:
    file = workspace.root / "rig" / "shots.json"
    if not file.is_file():
        return []
    try:
        return read_shots(file, plan).steps
    except ToolkitError as error:
        # object and variant were said, so the list is not needed to know what is shown
        if not (settings.object and settings.variant):
            raise
        notes.append(f"the shot list is not used: {error}")
        return []


def _check_pose(plan: CapturePlan, settings: ImportSettings, gathered: Gathered) -> None:
    if settings.pose is None or settings.object is None:
        return
    ids = [pose.id for pose in plan.objects[settings.object]]
    if settings.pose not in ids:
        raise FieldError(f"the plan of '{settings.object}' has poses {min(ids)} to {max(ids)}", {"pose": settings.pose})
    if len(gathered.candidates) > 1:
        raise FieldError(f"is of a single photograph, {len(gathered.candidates)} were given", {"pose": settings.pose})


def _store_all(
    workspace: Workspace, index: SourceIndex, resolved: Sequence[Resolved], settings: ImportSettings,
    check: Check | None, notes: list[str],
) -> tuple[list[CaptureRecord], list[tuple[str, str]]]:  # fmt: skip
    """Store photographs in turn; returns their records, and (label, reason) of photographs that broke meanwhile."""
    subjects: dict[tuple[str, str], Subject] = {}
    records: dict[str, CaptureRecord] = {}
    broken: list[tuple[str, str]] = []
    copied = False
    with progress("importing", len(resolved)) as bar:
        for evidence, decision in resolved:
            # object and booster are read once for each variant
            candidate, key = evidence.candidate, decision.key
            group = (key.object, key.variant)
            if group not in subjects:
                subjects[group], unknown = read_subject(workspace, *group)
                if unknown:
                    notes.append(f"{'/'.join(group)}: what is on the object is not recorded: {unknown}")
            subject = subjects[group]
            try:
                record, linked = store_photo(index, evidence, decision, subject, check=check, link=settings.link)
            except UnreadableImage as error:
                broken.append((candidate.label, error.reason))
            except FileNotFoundError:
                broken.append((candidate.label, "it was removed after it was read"))
            else:
                records[record.path] = index.records[record.path] = record
                copied |= settings.link and not linked
            bar.advance(note=str(key))
    if copied:
        notes.append("some photographs were copied, not linked: raw previews, frames of videos, files of another disk")
    return list(records.values()), broken
