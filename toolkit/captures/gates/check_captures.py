"""The gates over a capture folder, as `toolkit import` runs them: photograph by photograph, then over the whole set."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit.captures.gates.check_photo import Expectation, PhotoCheck, inspect_photo
from toolkit.captures.gates.check_set import CheckedPhoto, SetFinding, check_set
from toolkit.captures.gates.expect import Expecter, make_view
from toolkit.captures.gates.ledger import append_check, hash_setup, read_checks
from toolkit.captures.gates.result import GateResult
from toolkit.captures.gates.retake import Retake, count_unchecked, retake_list, write_retake_list
from toolkit.captures.manifest import CaptureRecord, read_manifest
from toolkit.captures.photos.photo import Photo, load_pixels, read_photo
from toolkit.captures.read import Capture, read_captures
from toolkit.captures.variants import Print, find_booster
from toolkit.console import progress
from toolkit.errors import ToolkitError
from toolkit.files import sha256_file
from toolkit.images import UnreadableImage
from toolkit.objects.load import load_object
from toolkit.workspace import Workspace

if TYPE_CHECKING:
    from toolkit.captures.importing.store import Check


@dataclass(frozen=True)
class CheckReport:
    """What the gates say of a source.

    Attributes:
        photos: with their own results.
        findings: over the whole set.
        retakes: what should be photographed again, and why.
        unchecked: (gate, reason, how many photographs) of what could not be checked.
        unreadable: (path, reason) of images that do not decode.
    """

    photos: tuple[CheckedPhoto, ...]
    findings: tuple[SetFinding, ...]
    retakes: tuple[Retake, ...]
    unchecked: tuple[tuple[str, str, int], ...]
    unreadable: tuple[tuple[str, str], ...]

    def to_json(self) -> dict[str, Any]:
        """The same for scripts; every gate of every photograph."""
        return {
            "photos": [
                {
                    "path": photo.path, "object": photo.object, "variant": photo.variant, "pose_id": photo.pose_id,
                    "gates": [result.to_json() for result in photo.results],
                }
                for photo in self.photos
            ],
            "set": [
                {
                    "path": one.path, "object": one.object, "variant": one.variant, "pose_id": one.pose_id,
                    "gate": one.result.to_json(),
                }
                for one in self.findings
            ],
            "retakes": [row.to_json() for row in self.retakes],
            "not_checked": [{"gate": gate, "reason": why, "photos": n} for gate, why, n in self.unchecked],
            "unreadable": [{"path": path, "reason": why} for path, why in self.unreadable],
        }  # fmt: skip


def make_check(workspace: Workspace, source: str = "real") -> "Check":
    """The gates as `import_photos` takes them: each photograph is judged, and the result kept in `gates.jsonl`.

    Args:
        workspace: whose objects, patches and board are meant.
        source: folder below captures/.
    """
    expecter = Expecter(workspace)
    source_dir, setup = workspace.captures_dir / source, hash_setup(workspace)

    def check(photo: Photo, pixels: np.ndarray, record: CaptureRecord) -> tuple[GateResult, ...]:
        found = inspect_photo(pixels, expecter.expect_record(record))
        append_check(source_dir, record.path, record.image_sha256 or photo.sha256, found, setup)
        return found.results

    return check


def check_captures(workspace: Workspace, source: str = "real", quiet: bool = False) -> CheckReport:
    """Judge every photograph of a source that was not judged before, then all together, and write `retake.txt`.

    Photographs that somebody sorted into the folders by hand are judged too: their cameras are found from the board. A
    run that is stopped goes on where it was.

    Args:
        workspace: whose captures are meant.
        source: folder below captures/.
        quiet: no progress bar.

    Raises:
        ToolkitError: there are no captures, or a manifest, board or lens file is broken.
    """
    source_dir = workspace.captures_dir / source
    if not source_dir.is_dir():
        raise ToolkitError(f"{source_dir} does not exist: import photographs first, with 'toolkit import PHOTOS/'")
    captures = read_captures(source_dir).captures
    setup = hash_setup(workspace)
    records, known = read_manifest(source_dir), read_checks(source_dir, setup)
    judge = _Judge(workspace)
    photos: list[CheckedPhoto] = []
    unreadable: list[tuple[str, str]] = []
    with progress("checking photographs", len(captures), quiet) as bar:
        for capture in captures:
            path = capture.path.partition("/")[2]
            try:
                if capture.refused is not None:
                    raise UnreadableImage(capture.file, capture.refused)
                sha256 = sha256_file(capture.file)
                found = known.get((path, sha256))
                if found is None:
                    found = judge.judge(capture, records.get(path), sha256)
                    append_check(source_dir, path, sha256, found, setup)
                photos.append(_as_checked(capture, found, path))
            except UnreadableImage as error:
                unreadable.append((path, error.reason))
            bar.advance(note=path)
    return summarise(source_dir, photos, unreadable, printed_sides(workspace, photos))


def printed_sides(workspace: Workspace, photos: Sequence[CheckedPhoto]) -> dict[tuple[str, str], float]:
    """The side in mm that each patch should have been printed with, by object and variant, where it is known."""
    sides = {}
    for name, variant in {(photo.object, photo.variant) for photo in photos if photo.lines is not None}:
        with suppress(ToolkitError):  # an object or a patch that the workspace does not know: nothing to compare with
            booster = find_booster(workspace, load_object(workspace.object_spec(name)), variant)
            if isinstance(booster, Print):
                sides[name, variant] = booster.size_mm
    return sides


def summarise(
    source_dir: Path, photos: Sequence[CheckedPhoto], unreadable: Sequence[tuple[str, str]] = (),
    sides_mm: Mapping[tuple[str, str], float] | None = None,
) -> CheckReport:  # fmt: skip
    """Check photographs as a set and write `captures/SOURCE/retake.txt`."""
    findings = check_set(photos, sides_mm)
    retakes = retake_list(photos, findings)
    write_retake_list(source_dir, retakes)
    unchecked = tuple((gate, why, n) for (gate, why), n in count_unchecked(photos, findings).items())
    return CheckReport(tuple(photos), tuple(findings), tuple(retakes), unchecked, tuple(unreadable))


class _Judge:
    """Judges images of a capture folder, with what its manifest says, or with what the board says."""

    def __init__(self, workspace: Workspace) -> None:
        from toolkit.captures.importing.locate import locate_by_board

        self._expecter = Expecter(workspace)
        self._locate = locate_by_board(workspace)

    def judge(self, capture: Capture, record: CaptureRecord | None, sha256: str) -> PhotoCheck:
        photo = read_photo(capture.file)
        pixels = load_pixels(photo)
        if record is not None and record.image_sha256 == sha256 and record.T_world_camera is not None:
            return inspect_photo(pixels, self._expecter.expect_record(record))
        return inspect_photo(pixels, self._expect_sorted(capture, photo, pixels))

    def _expect_sorted(self, capture: Capture, photo: Photo, pixels: np.ndarray) -> Expectation:
        """Of an image whose camera no manifest knows."""
        located = self._locate(photo, pixels)
        if isinstance(located, str):
            return self._expecter.expect(capture.object, capture.variant, capture.pose_id, None, located)
        view = make_view(located.T_world_camera, located.intrinsics, located.distortion)
        return self._expecter.expect(capture.object, capture.variant, capture.pose_id, view)


def _as_checked(capture: Capture, found: PhotoCheck, path: str) -> CheckedPhoto:
    return CheckedPhoto(capture.object, capture.variant, capture.pose_id, found.results, found.lines, path)
