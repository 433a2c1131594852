"""A session at the table: the state of its shots, and the photographs that are received, kept or discarded."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import RLock
from typing import Literal

from toolkit.captures.manifest import CaptureRecord, append_record, read_manifest, write_transforms
from toolkit.core.errors import ToolkitError
from toolkit.core.files import delete_file, write_bytes
from toolkit.core.records import hold_folder
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import UnreadableImage, show_path
from toolkit.rig.plan import CapturePlan, Pose, hash_pose, read_plan
from toolkit.rooms.photos.gates.check_captures import list_recorded
from toolkit.rooms.photos.importing.evidence import Evidence
from toolkit.rooms.photos.importing.gather import (
    REPLACED,
    Candidate,
    CaptureKey,
    SourceIndex,
    drop_records,
    find_images,
    find_original,
    index_source,
)
from toolkit.rooms.photos.importing.match import Decision, name_pose
from toolkit.rooms.photos.importing.store import read_subject, store_photo
from toolkit.rooms.photos.photo import read_photo
from toolkit.rooms.photos.shot_order import ShotList, ShotStep, read_shots
from toolkit.rooms.photos.studio.inspection import Inspection, Inspector
from toolkit.rooms.photos.studio.upload import (
    HASH_DIGITS,
    Refused,
    UploadFolders,
    check_writable,
    hash_in_name,
    open_upload,
)

Status = Literal["open", "waiting", "skipped", "done"]
NOT_FOUND, CONFLICT = 404, 409


@dataclass(frozen=True)
class ShotState:
    """A step of the list and its state.

    Attributes:
        status: of a shot. A waiting photograph is uploaded and not yet accepted, and may be a retake.
        path: of the photograph in captures/SOURCE; None without a photograph.
        retake: whether that photograph failed a gate.
    """

    step: ShotStep
    status: Status
    path: str | None
    retake: bool = False


@dataclass(frozen=True)
class Session:
    """Plan, shots and captures/`source` of a workspace; every method may be called from any thread."""

    workspace: Workspace
    plan: CapturePlan
    shots: ShotList
    inspector: Inspector
    source: str = "real"
    _lock: RLock = field(default_factory=RLock, repr=False)

    @property
    def source_dir(self) -> Path:
        """captures/SOURCE."""
        return self.workspace.source_dir(self.source)

    @property
    def folders(self) -> UploadFolders:
        """Folders of uploads and waiting photographs."""
        return UploadFolders(self.workspace.root)

    def find_step(self, number: int) -> ShotStep:
        """Return the step with that number, or raise `Refused` (404)."""
        if not 1 <= number <= len(self.shots.steps):
            raise Refused(NOT_FOUND, f"there is no shot {number}: the list has {len(self.shots.steps)}")
        return self.shots.steps[number - 1]

    def find_pose(self, step: ShotStep) -> Pose:
        """The step's pose in the plan."""
        return next(pose for pose in self.plan.objects[step.object] if pose.id == step.pose_id)

    def list_shots(self) -> list[ShotState]:
        """Every step of the list with its state on the disk."""
        with self._lock:
            index = self._index()
            return [self._look_up(step, index) for step in self.shots.steps]

    def look_up(self, number: int) -> ShotState:
        """A step with its state."""
        with self._lock:
            return self._look_up(self.find_step(number), self._index())

    def find_record(self, shot: ShotState) -> CaptureRecord | None:
        """The manifest's line on the photograph that is there; None if it was put there by hand."""
        return self._index().records.get(shot.path) if shot.path else None

    def receive(self, number: int, upload: Path) -> Inspection | None:
        """Check an upload by its content, let it wait at its shot, and measure it; None if it is stored already.

        Raises:
            Refused: no photograph (415), or a photograph of another shot (409); the upload is deleted.
            ToolkitError: the disk is full.
        """
        step = self.find_step(number)
        try:
            # outside of the lock, as decoding takes long
            photo, pixels = open_upload(upload)
            with self._lock:
                # a phone that lost the answer sends the photograph again
                if self._is_kept(step, photo.sha256):
                    return None
                file = self.folders.put_waiting(step, upload, photo)
            try:
                return self.inspector.inspect(replace(photo, path=file), step, pixels)
            except (OSError, UnreadableImage):
                if file.exists():
                    raise
                raise Refused(
                    CONFLICT, "a later photograph of this shot has taken its place: reload the page"
                ) from None
        finally:
            delete_file(upload)

    def inspect_waiting(self, number: int) -> Inspection | None:
        """Inspect the photograph that waits at a shot, if any."""
        shot = self.look_up(number)
        file = self.folders.find_waiting(shot.step) if shot.status == "waiting" else None
        return self.inspector.inspect(read_photo(file), shot.step) if file else None

    def keep(self, number: int, sha256: str) -> ShotState:
        """Write the waiting photograph with that hash into the captures, as `toolkit import`; twice does no harm.

        Raises:
            Refused: another photograph waits there by now, or none (409).
            ToolkitError: the disk is full or not to be written; the photograph still waits.
        """
        with self._lock, hold_folder(self.source_dir):
            step = self.find_step(number)
            if self._is_kept(step, sha256):
                self.folders.drop_waiting(step)
                return self.look_up(number)
            file = self.folders.find_waiting(step)
            if file is None or hash_in_name(file) != sha256[:HASH_DIGITS]:
                gone = "this photograph no longer waits for a decision: reload the page, or take another"
                raise Refused(CONFLICT, gone)
            # measured again only if the last results are not kept any more
            photo = read_photo(file)
            seen = self.inspector.inspect(photo, step)
            key = CaptureKey(step.object, step.variant, step.pose_id)
            candidate, group = Candidate(photo, photo.name, ()), (step.object, step.variant)
            evidence = Evidence(candidate, group, located=seen.located, no_board=seen.no_board)
            # an unknown booster is recorded as such, and no reason to lose a shot
            subject, _ = read_subject(self.workspace, *group)
            decision = name_pose(Decision(key, "user", seen.match), self.plan)
            # stored before it is dropped: a kill in between leaves it in both, see `_look_up`
            store_photo(self._index(), evidence, decision, subject, lambda *_: seen.checked)
            self.folders.drop_waiting(step)
            self.folders.set_skipped(step, False)
            self.write_lists()
            return self.look_up(number)

    def discard(self, number: int) -> ShotState:
        """Delete the photograph that waits at a shot; the captures stay."""
        with self._lock:
            self.folders.drop_waiting(self.find_step(number))
            return self.look_up(number)

    def skip(self, number: int, skipped: bool) -> ShotState:
        """Put a shot off, or call it back."""
        with self._lock:
            self.folders.set_skipped(self.find_step(number), skipped)
            return self.look_up(number)

    def write_lists(self) -> None:
        """Write `transforms.json` and `retake.txt` again, as an import does at its end."""
        records = [record for _, record in sorted(self._index().records.items())]
        there = [record for record in records if (self.source_dir / record.path).is_file()]
        write_transforms(self.source_dir, there)
        list_recorded(self.workspace, self.source_dir, there)

    def exclusive(self) -> RLock:
        """Return the lock to hold while files are changed."""
        return self._lock

    def _index(self) -> SourceIndex:
        # without hashing gigabytes: import and evaluation check what is whole
        return SourceIndex(self.source_dir, {}, {}, read_manifest(self.source_dir))

    def _look_up(self, step: ShotStep, index: SourceIndex) -> ShotState:
        there = find_images(index, CaptureKey(step.object, step.variant, step.pose_id))
        path = show_path(there[0].relative_to(self.source_dir).parts) if there else None
        record = index.records.get(path) if path else None
        retake = bool(record and record.made.get("retake"))
        waiting = self.folders.find_waiting(step)
        original = find_original(record) if record else None
        # a kill between the two steps of `keep` leaves a kept photograph waiting
        if waiting is not None and (original is None or hash_in_name(waiting) != original[0][:HASH_DIGITS]):
            return ShotState(step, "waiting", path, retake)
        # a photograph of another plan's pose is not this shot; without a plan, or by hand, it counts
        pose_sha256 = record.made.get("pose_sha256") if record else None
        if path and pose_sha256 in (None, hash_pose(self.plan.camera, self.find_pose(step))):
            return ShotState(step, "done", path, retake)
        return ShotState(step, "skipped" if self.folders.skip_mark(step).exists() else "open", None)

    def _is_kept(self, step: ShotStep, sha256: str) -> bool:
        """Whether this photograph is the shot's already; `Refused` if it is another shot's."""
        for record in self._index().records.values():
            if find_original(record) != (sha256, None) or not (self.source_dir / record.path).is_file():
                continue
            if (record.object, record.variant, record.pose_id) == (step.object, step.variant, step.pose_id):
                return True
            stored = f"{record.object} {record.variant} pose {record.pose_id}"
            raise Refused(CONFLICT, f"this photograph is stored already, as {stored}: take or choose another")
        return False


def open_session(
    workspace: Workspace,
    source: str = "real",
    make_inspector: Callable[[Workspace, CapturePlan], Inspector] = Inspector,
) -> Session:
    """Open the session of a workspace by its plan, its shot list, and earlier photographs.

    Raises:
        ToolkitError: there is no plan or no shot list, they are broken, or nothing can be written.
    """
    file = workspace.root / "rig" / "shots.json"
    if not workspace.plan_file.is_file():
        raise ToolkitError(f"{workspace.plan_file} is not there: plan the shots with 'toolkit plan --shot-list'")
    if not file.is_file():
        raise ToolkitError(f"{file} is not there: make the list of shots with 'toolkit plan --shot-list'")
    plan = read_plan(workspace.plan_file)
    session = Session(workspace, plan, read_shots(file, plan), make_inspector(workspace, plan), source)
    # faults of the disk show before anybody takes a photograph
    check_writable(session.folders)
    session.folders.sweep()
    session.list_shots()  # reports a broken manifest now, not when the first photograph is kept
    return session


def undo_keep(session: Session, number: int) -> ShotState:
    """Undo `keep`: the photograph waits at its shot again, and a photograph that it replaced is there again.

    Raises:
        Refused: nothing is there, or it was put there by hand (409).
        ToolkitError: the disk is full or not to be written.
    """
    with session.exclusive(), hold_folder(session.source_dir):
        step = session.find_step(number)
        root = session.source_dir
        # read again: an import may have run since
        index = index_source(root)
        key = CaptureKey(step.object, step.variant, step.pose_id)
        there = find_images(index, key)
        record = session.find_record(session.look_up(number))
        if not there or record is None:
            what = "was put there by hand: delete the file itself" if there else "is not there"
            raise Refused(CONFLICT, f"the photograph of shot {number} {what}")
        file = root / record.path
        # a copy first: it is always in either folder
        upload = write_bytes(session.folders.new_incoming(), file.read_bytes())
        session.folders.put_waiting(step, upload, read_photo(upload))
        before = _find_before(root, record)
        delete_file(file)
        drop_records(root, {record.path})
        # the photograph that was replaced comes back
        if before is not None:
            old = root / REPLACED / before.path
            path = str(Path(record.path).with_suffix(old.suffix).as_posix())
            write_bytes(root / path, old.read_bytes())
            append_record(root, before.model_copy(update={"path": path}))
        session.write_lists()
        return session.look_up(number)


def _find_before(root: Path, record: CaptureRecord) -> CaptureRecord | None:
    """The record of the photograph that this photograph replaced, if any."""
    shown = (record.object, record.variant, record.pose_id)
    every = [old for old in read_manifest(root / REPLACED).values() if (old.object, old.variant, old.pose_id) == shown]
    kept = [old for old in every if (root / REPLACED / old.path).is_file()]
    originals = [find_original(photograph) for photograph in kept]
    own = find_original(record)
    kept = kept[: originals.index(own)] if own in originals else kept
    return kept[-1] if kept else None
