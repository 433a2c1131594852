"""Predictions of a classifier for the kept photographs, in a thread beside the page."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any, Literal

from toolkit.captures.capture import Capture
from toolkit.core.console import quietly
from toolkit.core.errors import ToolkitError
from toolkit.evaluation.ground_truth import class_of_spec
from toolkit.evaluation.predict import predict_captures
from toolkit.evaluation.prediction import Prediction
from toolkit.models.network import Classifier
from toolkit.rooms.photos.shot_order import ShotStep
from toolkit.rooms.photos.studio.session import Session

Load = Callable[[], Classifier]
Key = tuple[str, int, int]
LOADED_BY_S = 30.0
"""A network takes some seconds; a disk that hangs shall not hold Ctrl-C for ever."""


@dataclass(frozen=True)
class PredictorState:
    """State of the classifier: its name, or why there is none, and why it cannot judge some objects."""

    status: Literal["loading", "ready", "missing"]
    message: str
    notes: tuple[str, ...] = ()


class Predictor:
    """A thread that loads a classifier once and then classifies each kept photograph once.

    Only kept photographs are classified: a choice of photographs by a network's answers would bias the comparison.
    """

    def __init__(self, session: Session, load: Load) -> None:
        self._session, self._load = session, load
        self._lock, self._wake, self._ended = Lock(), Event(), Event()
        self._state = PredictorState("loading", "the network is being loaded")
        self._known: dict[Key, Prediction] = {}
        self._thread = Thread(target=self._run, name="studio-predictor", daemon=True)

    def start(self) -> None:
        """Begin to load the classifier."""
        self._thread.start()
        self.wake()

    def wake(self) -> None:
        """Look for photographs that are new."""
        self._wake.set()

    def stop(self) -> None:
        """End the thread, after its current step: cut off while it loads, torch would abort the process."""
        self._ended.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(LOADED_BY_S)

    @property
    def state(self) -> PredictorState:
        """State of the classifier."""
        with self._lock:
            return self._state

    def list_rows(self) -> list[dict[str, Any]]:
        """A row per kept photograph that was classified, in the list's order, ready for JSON."""
        rows = []
        for shot in self._session.list_shots():
            key = self._key(shot.path)
            with self._lock:
                found = self._known.get(key) if key else None
            if found is not None:
                rows.append(_describe(shot.step, found))
        return rows

    def _run(self) -> None:
        try:
            classifier = self._load()
        except (ToolkitError, OSError, MemoryError) as error:
            self._say(PredictorState("missing", str(error)))
            return
        self._say(PredictorState("ready", classifier.name))
        while not self._ended.is_set():
            self._wake.wait()
            # cleared first: a photograph that is kept meanwhile wakes it once more
            self._wake.clear()
            try:
                self._classify_new(classifier)
            except (ToolkitError, OSError) as error:  # a folder that is changed at this moment, a full memory
                self._say(PredictorState("ready", classifier.name, (str(error),)))

    def _classify_new(self, classifier: Classifier) -> None:
        # photographs are classified singly, so that each answer shows as soon as it is there
        notes: dict[str, str] = {}
        specs = self._session.workspace.object_specs()
        for shot in self._session.list_shots():
            if self._ended.is_set():
                return
            key, name = self._key(shot.path), shot.step.object
            if key is None or shot.path is None or key in self._known or name in notes:
                continue
            # an object without a class of the network is noted once
            try:
                true = class_of_spec(specs[name], classifier)
            except (ToolkitError, KeyError) as error:
                notes[name] = f"{name} is left out: {error}"
                continue
            file = self._session.source_dir / shot.path
            source = self._session.source
            capture = Capture(source, name, shot.step.variant, shot.step.pose_id, file, path=f"{source}/{shot.path}")
            with quietly():
                (found,) = predict_captures([capture], {name: true}, classifier)
            with self._lock:
                self._known[key] = found
        self._say(PredictorState("ready", classifier.name, tuple(notes.values())))

    def _say(self, state: PredictorState) -> None:
        with self._lock:
            self._state = state

    def _key(self, path: str | None) -> Key | None:
        if path is None:
            return None
        try:
            facts = Path(self._session.source_dir / path).stat()
        except OSError:
            return None  # taken back at this moment
        # a retake has the same path: its time and size tell it apart
        return path, facts.st_mtime_ns, facts.st_size


def _describe(step: ShotStep, found: Prediction) -> dict[str, Any]:
    return {
        "number": step.number, "object": step.object, "variant": step.variant, "pose_id": step.pose_id,
        "label": found.top1_label,
        "probability": found.top1_prob, "true_label": found.true_label, "true_probability": found.true_prob,
        "rank": found.true_rank, "right": found.correct_top1, "trouble": None if found.is_read else found.status,
    }  # fmt: skip
