"""Take a photograph that was kept back out of the captures, and put the one before it in its place."""

from pathlib import Path

from toolkit.captures.importing.evidence import Target
from toolkit.captures.importing.ledger import REPLACED, drop_records, find_occupants, find_original, read_ledger
from toolkit.captures.manifest import CaptureRecord, append_record, read_manifest
from toolkit.captures.photos.photo import read_photo
from toolkit.files import write_bytes
from toolkit.studio.errors import Refused
from toolkit.studio.session import CONFLICT, Session, Shot


def take_back(session: Session, number: int) -> Shot:
    """Undo `keep`: the photograph waits at its shot again, and a shot that it had replaced is there again.

    Raises:
        Refused: nothing is there, or it was put there by hand (409).
        ToolkitError: the disk is full or not to be written.
    """
    with session.exclusive():
        step = session.find_step(number)
        root = session.source_dir
        ledger = read_ledger(root)
        target = Target(step.object, step.variant, step.pose_id)
        there = find_occupants(ledger, target)
        record = session.find_record(session.look_up(number))
        if not there or record is None:
            what = "was put there by hand: delete the file itself" if there else "is not there"
            raise Refused(CONFLICT, f"the photograph of shot {number} {what}")
        file = root / record.path
        # a copy first: it is in one of the two places at every moment
        upload = write_bytes(session.places.new_incoming(), file.read_bytes())
        session.places.put_waiting(step, upload, read_photo(upload))
        before = _find_before(root, record)
        file.unlink()
        drop_records(root, {record.path})
        if before is not None:
            _bring_back(root, before, record)
        session.write_lists()
        return session.look_up(number)


def _find_before(root: Path, record: CaptureRecord) -> CaptureRecord | None:
    """The record of the photograph that this one replaced; None where it was the first."""
    kept = [
        one
        for one in read_manifest(root / REPLACED).values()
        if (one.object, one.variant, one.pose_id) == (record.object, record.variant, record.pose_id)
        and (root / REPLACED / one.path).is_file()
    ]
    originals = [find_original(one) for one in kept]
    own = find_original(record)
    kept = kept[: originals.index(own)] if own in originals else kept
    return kept[-1] if kept else None


def _bring_back(root: Path, before: CaptureRecord, record: CaptureRecord) -> None:
    old = root / REPLACED / before.path
    path = str(Path(record.path).with_suffix(old.suffix).as_posix())
    write_bytes(root / path, old.read_bytes())
    append_record(root, before.model_copy(update={"path": path}))
