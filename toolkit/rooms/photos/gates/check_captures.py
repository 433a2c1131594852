"""The gates over a capture folder: photograph by photograph, then over the whole set; what to retake."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from toolkit.captures.capture import Capture
from toolkit.captures.manifest import GATES_FILE, CaptureRecord, read_manifest
from toolkit.captures.read import CaptureFolder, read_captures
from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.files import delete_file, sha256_file, write_text
from toolkit.core.records import RecordLog, hold_folder
from toolkit.core.work import Work
from toolkit.core.workspace import WRAP_RECORD, Workspace
from toolkit.evaluation.summaries import list_reasons
from toolkit.imaging.read import UnreadableImage
from toolkit.objects.load import load_object
from toolkit.rig import PAIR
from toolkit.rig.board_file import board_file
from toolkit.rig.plan import read_plan
from toolkit.rig.variants import find_booster
from toolkit.rooms.photos.gates import Check, Gate, GateResult
from toolkit.rooms.photos.gates.check_photo import ExpectationBuilder, PhotoCheck, inspect_photo
from toolkit.rooms.photos.gates.check_set import PARTNER, CheckedPhoto, LinesRecord, check_set
from toolkit.rooms.photos.locate import locate_by_board
from toolkit.rooms.photos.photo import Photo, load_pixels, read_photo
from toolkit.rooms.photos.shot_order import ShotStep, read_shots

GATES = Work("gates", 4)


def hash_setup(workspace: Workspace) -> str:
    """Key of the inputs of a photograph's results but the image: the rig, patches, objects."""
    # files of the rig and of the boosters, by content
    rig = (board_file(workspace), workspace.root / "rig" / "lens.json", workspace.plan_file)
    wraps = {f"wrap {name}": folder / WRAP_RECORD for name, folder in workspace.wraps().items()}
    boosters = sorted({**workspace.patches(), **wraps}.items())
    # meshes may be large: their size and time tell a change
    meshes = [(file.name, file.stat()) for file in sorted(workspace.objects_dir.glob("*"))]
    return GATES.key(
        [sha256_file(file) if file.is_file() else None for file in rig],
        [[name, sha256_file(file)] for name, file in boosters],
        [[name, found.st_size, found.st_mtime_ns] for name, found in meshes],
    )


class CheckLine(BaseModel):
    """A line of `gates.jsonl`: results of an image by its path below captures/SOURCE, for a set-up (`hash_setup`)."""

    model_config = ConfigDict(frozen=True)
    setup: str
    path: str
    image_sha256: str
    results: tuple[GateResult, ...]
    lines: LinesRecord | None


def open_gates_log(source_dir: Path) -> RecordLog[CheckLine]:
    """Open the log of results; a photograph whose line is broken is judged again."""
    return RecordLog(Path(source_dir) / GATES_FILE, CheckLine, required=False)


def append_check(source_dir: Path, path: str, image_sha256: str, check: PhotoCheck, setup: str) -> None:
    """Append a photograph's results, see `CheckLine`; raises as `RecordLog.append`."""
    lines = LinesRecord.from_lines(check.lines) if check.lines is not None else None
    open_gates_log(source_dir).append(
        CheckLine(setup=setup, path=path, image_sha256=image_sha256, results=check.results, lines=lines)
    )


def read_checks(source_dir: Path, setup: str) -> dict[tuple[str, str], PhotoCheck]:
    """Results of the same set-up by (path, image's hash), the last of each."""
    return {
        (line.path, line.image_sha256): PhotoCheck(line.results, line.lines.to_lines() if line.lines else None)
        for line in open_gates_log(source_dir).read()
        if line.setup == setup
    }


def mark_failed_gates(folder: CaptureFolder) -> CaptureFolder:
    """Return the captures with the gates that each failed, by the last line of `gates.jsonl` on the very same file."""
    logs: dict[Path, dict[str, CheckLine]] = {}
    captures: list[Capture] = []
    for capture in folder.captures:
        source_dir = capture.source_dir
        if source_dir not in logs:
            logs[source_dir] = {f"{line.path} {line.image_sha256}": line for line in open_gates_log(source_dir).read()}
        line = logs[source_dir].get(f"{capture.path_in_source} {capture.image_sha256}")
        if line is not None:
            # numbers of the photograph's own gates; gates of the whole set are not in that file
            failed = (f"{gate.name} {gate.value:.3g} {gate.unit}" for gate in line.results if gate.failed)
            capture = replace(capture, failed_gates=tuple(failed))
        captures.append(capture)
    return replace(folder, captures=tuple(captures))


RETAKE_FILE = "retake.txt"
MISSING = Gate("missing", 0.0, "photograph", "take it")


@dataclass(frozen=True)
class Retake:
    """A photograph to take, or to take again.

    Attributes:
        why: the gates that it failed, with their numbers.
        advice: what to do, a line per gate.
        path: of the photograph that is there, relative to its source; empty if there is none.
    """

    object: str
    variant: str
    pose_id: int | None
    why: tuple[str, ...]
    advice: tuple[str, ...]
    path: str = ""

    @property
    def label(self) -> str:
        """Words for the photograph to take."""
        pose = f"pose {self.pose_id}" if self.pose_id is not None else self.path or "all"
        return f"{self.object}/{self.variant} {pose}"

    def describe(self) -> str:
        """A line for a person: what to take, why, and what to do better."""
        return f"{self.label}: {'; '.join(self.why)} -> {'; '.join(self.advice)}"


def retake_list(
    photos: Sequence[CheckedPhoto], findings: Sequence[CheckedPhoto] | None = None, walk: Sequence[ShotStep] = ()
) -> list[Retake]:
    """List the photographs that failed a gate or are missing, in the order of the walk.

    A variant without any photograph lacks only the partners of others.

    Args:
        photos: with the results of their gates.
        findings: from `check_set` of the same photographs; made here by default.
        walk: every shot that there should be, see `read_walk`; other photographs come last.
    """
    findings = check_set(photos) if findings is None else findings
    # failed gates of single photographs and of the set
    failed: dict[tuple[str, str, int | None, str], list[GateResult]] = {}
    for checked in (*photos, *findings):
        if bad := [result for result in checked.results if result.failed]:
            failed.setdefault((checked.object, checked.variant, checked.pose_id, checked.path), []).extend(bad)
    begun = {(photo.object, photo.variant) for photo in photos}
    # a pose that failed a gate is not missing besides
    known = {(photo.object, photo.variant, photo.pose_id) for photo in photos} | {key[:3] for key in failed}
    places: dict[tuple[str, str, int | None], int] = {
        (step.object, step.variant, step.pose_id): step.number for step in walk
    }
    # only variants that were begun: a variant that was never shot is not missing pose by pose
    for shot in places:
        if shot[:2] in begun and shot not in known:
            failed[shot[0], shot[1], shot[2], ""] = [MISSING.judge(1)]
    # in the order of the walk, then by object, variant and pose
    last = len(places) + 1
    ordered = sorted(
        failed.items(), key=lambda item: (places.get(item[0][:3], last), *item[0][:2], item[0][2] or 0, item[0][3])
    )
    return [
        Retake(*key[:3], tuple(_measured(result, key[1]) for result in bad), tuple(r.advice for r in bad), path=key[3])
        for key, bad in ordered
    ]


def count_unchecked(photos: Sequence[CheckedPhoto], findings: Sequence[CheckedPhoto]) -> dict[tuple[str, str], int]:
    """Count how often each gate could not be checked, by (gate, reason), the most frequent first."""
    every = (result for checked in (*photos, *findings) for result in checked.results)
    skipped = (result for result in every if result.status == "not checked")
    counts = Counter((result.name, result.advice.removeprefix("not checked: ")) for result in skipped)
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def write_retake_list(source_dir: Path, rows: Sequence[Retake]) -> Path | None:
    """Write `retake.txt` into captures/SOURCE, a line per photograph; with nothing to retake, delete the old file."""
    file = Path(source_dir) / RETAKE_FILE
    if not rows:
        delete_file(file)
        return None
    return write_text(file, "".join(f"{row.describe()}\n" for row in rows))


def _measured(result: GateResult, variant: str) -> str:
    if result.name == PARTNER.name:
        return f"{variant} photo missing"
    value = "" if result.value is None else f" {result.value:.3g}"
    return f"{result.name}{value} {result.unit}".rstrip()


def read_walk(workspace: Workspace) -> list[ShotStep]:
    """Return the shots of `rig/shots.json` in order; without a list that fits the plan, both shots of each pair."""
    with suppress(ToolkitError):
        plan = read_plan(workspace.plan_file)
        with suppress(ToolkitError):
            return read_shots(workspace.root / "rig" / "shots.json", plan).steps
        shots = product(sorted(plan.objects), sorted(PAIR))
        every = [(name, variant, pose.id) for name, variant in shots for pose in plan.objects[name]]
        return [ShotStep(number, *shot) for number, shot in enumerate(every, 1)]
    return []


def list_recorded(workspace: Workspace, source_dir: Path, records: Sequence[CaptureRecord]) -> "CheckReport":
    """Write `retake.txt` from the known results of imported photographs, without reading the photographs again."""
    known = read_checks(source_dir, hash_setup(workspace))
    photos = []
    for record in records:
        found = known.get((record.path, record.image_sha256 or "")) or PhotoCheck(_read_recorded(record), None)
        shown = (record.object, record.variant, record.pose_id)
        photos.append(CheckedPhoto(*shown, found.results, found.lines, path=record.path))
    return summarise(source_dir, photos, (), printed_sides(workspace, photos), read_walk(workspace))


def _read_recorded(record: CaptureRecord) -> tuple[GateResult, ...]:
    """Gates that a photograph failed when it was kept."""
    advice, gates = record.made.get("retake"), record.made.get("gates")
    values = gates if isinstance(gates, dict) else {}
    failed = [str(line).partition(": ") for line in advice] if isinstance(advice, list) else []
    return tuple(GateResult(name, values.get(name), 0.0, "", "failed", words) for name, _, words in failed)


@dataclass(frozen=True)
class CheckReport:
    """Results of a source: photo by photo and over the whole set, what to retake, and what could not be checked.

    Attributes:
        unchecked: (gate, reason, number of photographs).
        unreadable: (path, reason) of images that do not decode.
    """

    photos: tuple[CheckedPhoto, ...]
    findings: tuple[CheckedPhoto, ...]
    retakes: tuple[Retake, ...]
    unchecked: tuple[tuple[str, str, int], ...]
    unreadable: tuple[tuple[str, str], ...]

    def to_json(self) -> dict[str, Any]:
        """Every gate of every photograph, for scripts."""

        def name(photo: CheckedPhoto) -> dict[str, Any]:
            return {key: getattr(photo, key) for key in ("path", "object", "variant", "pose_id")}

        return {
            "photos": [name(photo) | {"gates": [asdict(result) for result in photo.results]} for photo in self.photos],
            "set": [name(finding) | {"gate": asdict(finding.results[0])} for finding in self.findings],
            "retakes": [asdict(row) for row in self.retakes],
            "not_checked": [{"gate": gate, "reason": why, "photos": n} for gate, why, n in self.unchecked],
            "unreadable": list_reasons(self.unreadable),
        }


def make_check(workspace: Workspace, source: str = "real") -> Check:
    """Return a function for `import_photos` that judges a photograph and keeps the result in `gates.jsonl`."""
    expecter = ExpectationBuilder(workspace)
    source_dir, setup = workspace.source_dir(source), hash_setup(workspace)

    def check(photo: Photo, pixels: np.ndarray, record: CaptureRecord) -> tuple[GateResult, ...]:
        found = inspect_photo(pixels, expecter.expect_record(record))
        append_check(source_dir, record.path, record.image_sha256 or photo.sha256, found, setup)
        return found.results

    return check


def check_captures(workspace: Workspace, source: str = "real") -> CheckReport:
    """Judge every photograph of a source that was not judged before, then all together, and write `retake.txt`.

    The board gives the cameras of photographs that were sorted by hand. Interrupted runs resume.

    Raises:
        ToolkitError: there are no captures, or a manifest, board or lens file is broken.
    """
    source_dir = workspace.source_dir(source)
    if not source_dir.is_dir():
        raise ToolkitError(f"{source_dir} does not exist: import photographs first, with 'toolkit import PHOTOS/'")
    # two checks, or a check and an import, never write at once
    with hold_folder(source_dir):
        return _check_captures(workspace, source_dir)


def _check_captures(workspace: Workspace, source_dir: Path) -> CheckReport:
    # also photographs beside those of the manifest: the evaluation decides what counts
    captures = read_captures(source_dir, trust_files=True).captures
    setup = hash_setup(workspace)
    records, known = read_manifest(source_dir), read_checks(source_dir, setup)
    expecter, locate = ExpectationBuilder(workspace), locate_by_board(workspace)

    def judge(capture: Capture, record: CaptureRecord | None, sha256: str) -> PhotoCheck:
        photo = read_photo(capture.file)
        pixels = load_pixels(photo)
        # a manifest's camera is believed only for the very image that it was written for
        if record is not None and record.image_sha256 == sha256 and record.T_world_camera is not None:
            return inspect_photo(pixels, expecter.expect_record(record))
        # sorted by hand, or changed since: the camera is found anew by the board
        found = locate(photo, pixels)
        view, why = (None, found) if isinstance(found, str) else (found, "")
        return inspect_photo(pixels, expecter.expect(capture.object, capture.variant, capture.pose_id, view, why))

    # results of an earlier check are kept for the same file and set-up
    photos: list[CheckedPhoto] = []
    unreadable: list[tuple[str, str]] = []
    with progress("checking photographs", len(captures)) as bar:
        for capture in captures:
            path = capture.path.partition("/")[2]
            try:
                if capture.refused is not None:
                    raise UnreadableImage(capture.file, capture.refused)
                sha256 = sha256_file(capture.file)
                found = known.get((path, sha256))
                if found is None:
                    found = judge(capture, records.get(path), sha256)
                    append_check(source_dir, path, sha256, found, setup)
                shown = (capture.object, capture.variant, capture.pose_id)
                photos.append(CheckedPhoto(*shown, found.results, found.lines, path=path))
            except UnreadableImage as error:
                unreadable.append((path, error.reason))
            bar.advance(note=path)
    return summarise(source_dir, photos, unreadable, printed_sides(workspace, photos), read_walk(workspace))


def printed_sides(workspace: Workspace, photos: Sequence[CheckedPhoto]) -> dict[tuple[str, str], tuple[float, ...]]:
    """Return the side in mm that each patch should have, sheet by sheet, by object and variant."""
    sides = {}
    for name, variant in {(photo.object, photo.variant) for photo in photos if photo.lines is not None}:
        with suppress(ToolkitError):  # an object or a patch that the workspace does not know: nothing to compare with
            booster = find_booster(workspace, load_object(workspace.object_spec(name)), variant)
            if booster is not None and booster.sizes_mm:
                sides[name, variant] = booster.sizes_mm
    return sides


def summarise(
    source_dir: Path, photos: Sequence[CheckedPhoto], unreadable: Sequence[tuple[str, str]] = (),
    sides_mm: Mapping[tuple[str, str], Sequence[float]] | None = None, walk: Sequence[ShotStep] = (),
) -> CheckReport:  # fmt: skip
    """Check photographs as a set and write `captures/SOURCE/retake.txt`, see `retake_list`."""
    findings = check_set(photos, sides_mm)
    retakes = retake_list(photos, findings, walk)
    write_retake_list(source_dir, retakes)
    unchecked = tuple((gate, why, n) for (gate, why), n in count_unchecked(photos, findings).items())
    return CheckReport(tuple(photos), tuple(findings), tuple(retakes), unchecked, tuple(unreadable))
