"""Gates of a photograph: a measured number, its threshold with its reason, and advice if it fails."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from toolkit.captures.manifest import CaptureRecord
from toolkit.rooms.photos.photo import Photo

Status = Literal["passed", "failed", "not checked"]


@dataclass(frozen=True)
class GateResult:
    """A gate's result for a photograph.

    Attributes:
        value: what was measured; None if nothing could be.
        threshold: the largest good value, or the smallest if `at_most` is False.
        unit: of both.
        status: passed, failed, or not checked; the last is never a pass.
        advice: a line of what to do; for `not checked`, why; empty for a pass.
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
        """A line for a person."""
        if self.value is None:
            return f"{self.name}: {self.advice}"
        limit = f"{'at most' if self.at_most else 'at least'} {self.threshold:g} {self.unit}"
        line = f"{self.name}: {self.value:.3g} {self.unit} ({limit}), {self.status}"
        return f"{line}: {self.advice}" if self.advice else line


Check = Callable[[Photo, np.ndarray, CaptureRecord], Sequence[GateResult]]
"""(photo, its pixels (h, w, 3) uint8, its record) -> the results of the gates."""


@dataclass(frozen=True)
class Gate:
    """A measure and its threshold, with fields as in `GateResult`, and advice for a photograph that fails."""

    name: str
    threshold: float
    unit: str
    advice: str
    at_most: bool = True

    def judge(self, value: float, advice: str | None = None) -> GateResult:
        """Compare a measured value with the threshold; `advice` takes the place of the gate's own."""
        good = value <= self.threshold if self.at_most else value >= self.threshold
        return self._make(float(value), "passed" if good else "failed", "" if good else advice or self.advice)

    def skip(self, why: str) -> GateResult:
        """Return that the gate could not be checked; `why` in a few words, such as "no pose"."""
        return self._make(None, "not checked", f"not checked: {why}")

    def _make(self, value: float | None, status: Status, advice: str) -> GateResult:
        return GateResult(self.name, value, self.threshold, self.unit, status, advice, at_most=self.at_most)
