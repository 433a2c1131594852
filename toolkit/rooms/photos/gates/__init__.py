"""Whether a photograph is fit to be compared: measured numbers, thresholds with their reasons, and advice.

Here is what a gate says: a number, its threshold, and what to do when it is on the wrong side.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from toolkit.captures.manifest import CaptureRecord
from toolkit.rooms.photos.photo import Photo

Status = Literal["passed", "failed", "not checked"]


@dataclass(frozen=True)
class GateResult:
    """A gate's word on a photograph.

    Attributes:
        name: of the gate.
        value: what was measured; None where it could not be.
        threshold: the largest good value, or the smallest where `at_most` is False.
        unit: of both.
        status: passed, failed, or not checked; the last is never a pass.
        advice: what to do, one line; for `not checked`, why; empty for a pass.
        at_most: whether smaller is better.
    """

    name: str
    value: float | None
    threshold: float
    unit: str
    status: Status
    advice: str
    at_most: bool = True

    @property
    def passed(self) -> bool:
        """Measured, and good enough."""
        return self.status == "passed"

    @property
    def failed(self) -> bool:
        """Measured, and not good enough."""
        return self.status == "failed"

    def describe(self) -> str:
        """One line for a person."""
        if self.value is None:
            return f"{self.name}: {self.advice}"
        limit = f"{'at most' if self.at_most else 'at least'} {self.threshold:g} {self.unit}"
        line = f"{self.name}: {self.value:.3g} {self.unit} ({limit}), {self.status}"
        return f"{line}: {self.advice}" if self.advice else line

    def to_json(self) -> dict[str, Any]:
        """The same for scripts and for `gates.jsonl`."""
        return asdict(self)


Check = Callable[[Photo, np.ndarray, CaptureRecord], Sequence[GateResult]]
"""(photo, its pixels (h, w, 3) uint8, its record) -> what the gates say."""


@dataclass(frozen=True)
class Gate:
    """What is measured and how much of it is good.

    Attributes:
        name, threshold, unit, at_most: as in `GateResult`.
        advice: for a photograph that fails.
    """

    name: str
    threshold: float
    unit: str
    advice: str
    at_most: bool = True

    def judge(self, value: float, advice: str | None = None) -> GateResult:
        """Compare a measured value with the threshold; `advice` says more than the gate's own where it is given."""
        good = value <= self.threshold if self.at_most else value >= self.threshold
        status: Status = "passed" if good else "failed"
        words = "" if good else advice or self.advice
        return GateResult(
            self.name, float(value), self.threshold, self.unit, status, advice=words, at_most=self.at_most
        )

    def skip(self, why: str) -> GateResult:
        """The gate could not be checked; `why` in a few words, such as "no pose"."""
        words = f"not checked: {why}"
        return GateResult(self.name, None, self.threshold, self.unit, "not checked", advice=words, at_most=self.at_most)
