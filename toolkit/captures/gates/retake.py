"""The list to go back to the table with: what to photograph again, why, and what to do better."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from toolkit.captures.gates.check_set import CheckedPhoto, SetFinding, check_set
from toolkit.captures.gates.result import GateResult
from toolkit.files import write_text

RETAKE_FILE = "retake.txt"


@dataclass(frozen=True)
class Retake:
    """One photograph to take, or to take again.

    Attributes:
        object, variant, pose_id: what it should show.
        why: the gates that it failed, with their numbers.
        advice: what to do, one line per gate.
        path: of the photograph that is there, relative to its source; empty where there is none.
    """

    object: str
    variant: str
    pose_id: int | None
    why: tuple[str, ...]
    advice: tuple[str, ...]
    path: str = ""

    @property
    def label(self) -> str:
        """What to take, in words."""
        pose = f"pose {self.pose_id}" if self.pose_id is not None else self.path or "all"
        return f"{self.object}/{self.variant} {pose}"

    def describe(self) -> str:
        """One line for a person: what to take, why, and what to do better."""
        return f"{self.label}: {'; '.join(self.why)} -> {'; '.join(self.advice)}"

    def to_json(self) -> dict[str, Any]:
        """The same for scripts."""
        return asdict(self)


def retake_list(photos: Sequence[CheckedPhoto], findings: Sequence[SetFinding] | None = None) -> list[Retake]:
    """Everything that failed a gate, one row per photograph, by object, variant and pose.

    Args:
        photos: with the results of their own gates.
        findings: from `check_set` of the same photographs; made here where they are not given.
    """
    findings = check_set(photos) if findings is None else findings
    failed: dict[tuple[str, str, int | None, str], list[GateResult]] = {}
    for photo in photos:
        bad = [result for result in photo.results if result.failed]
        if bad:
            failed[(photo.object, photo.variant, photo.pose_id, photo.path)] = bad
    for finding in findings:
        if finding.result.failed:
            key = (finding.object, finding.variant, finding.pose_id, finding.path)
            failed.setdefault(key, []).append(finding.result)
    ordered = sorted(failed.items(), key=lambda item: (item[0][0], item[0][1], item[0][2] or 0, item[0][3]))
    return [
        Retake(
            name, variant, pose_id, tuple(_measured(result) for result in bad), tuple(result.advice for result in bad),
            path,
        )
        for (name, variant, pose_id, path), bad in ordered
    ]  # fmt: skip


def count_unchecked(photos: Sequence[CheckedPhoto], findings: Sequence[SetFinding]) -> dict[tuple[str, str], int]:
    """How often each gate could not be checked, by (gate, reason), the most frequent first."""
    counts: dict[tuple[str, str], int] = {}
    own = [result for photo in photos for result in photo.results]
    for result in (*own, *(finding.result for finding in findings)):
        if result.status == "not checked":
            key = (result.name, result.advice.removeprefix("not checked: "))
            counts[key] = counts.get(key, 0) + 1
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def write_retake_list(source_dir: Path, rows: Sequence[Retake]) -> Path | None:
    """Write `retake.txt` into captures/SOURCE, one line per photograph; with nothing to retake, the old file goes."""
    return write_retake_lines(source_dir, [row.describe() for row in rows])


def write_retake_lines(source_dir: Path, lines: Sequence[str]) -> Path | None:
    """`write_retake_list` for lines that are made already."""
    file = Path(source_dir) / RETAKE_FILE
    if not lines:
        file.unlink(missing_ok=True)
        return None
    return write_text(file, "".join(f"{line}\n" for line in lines))


def _measured(result: GateResult) -> str:
    return f"{result.name} {result.value:.3g} {result.unit}"
