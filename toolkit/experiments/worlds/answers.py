"""What the network said of every picture, on disk by the hash of what the picture is made of."""

import hashlib
import json
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from toolkit.core.records import RecordLog
from toolkit.engine.resume import RecordCache
from toolkit.worlds.weather import make_weather

METHOD_VERSION = 1
"""Raised when the same inputs give other answers."""
WeatherKey = tuple[str, int]
"""Name and severity."""
Answer = tuple[int, float, float, int]
"""First guess, its probability, the truth's probability, and the truth's rank from 1."""


class FrameAnswers(BaseModel):
    """One line of `answers.jsonl`: what was said of one frame in some weathers.

    Attributes:
        frame: hash of what the frame in clear air, its grain and the network are made of.
        answers: by what `name_weather` calls the weather.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    frame: str = Field(pattern=r"^[0-9a-f]{64}$")
    answers: dict[str, Answer]


@dataclass(frozen=True)
class Answers:
    """What was said of every camera's picture of one variant in one weather, in the order of the cameras.

    Attributes:
        top1_index: (n,) int, first guess.
        top1_prob, true_prob: (n,) its probability and the truth's.
        true_rank: (n,) int, place of the truth among the guesses, from 1.
    """

    top1_index: np.ndarray
    top1_prob: np.ndarray
    true_prob: np.ndarray
    true_rank: np.ndarray

    @classmethod
    def of(cls, rows: Iterable[Answer]) -> "Answers":
        """From single answers."""
        columns = list(zip(*rows, strict=True))
        return cls(*(np.array(one) for one in columns))

    def right(self, guesses: int) -> np.ndarray:
        """(n,) bool: whether the truth is among so many first guesses."""
        return self.true_rank <= guesses


def name_weather(weather: WeatherKey) -> str:
    """`fog 3: visibility 40 m, extinction 74.9 /km`: another ladder makes other pictures."""
    return f"{weather[0]} {weather[1]}: {make_weather(*weather).describe()}"


def make_answer(order: np.ndarray, probabilities: np.ndarray, true_index: int) -> Answer:
    """From classes by falling probability and the probability of each; six digits are kept."""
    first = int(order[0])
    rank = int(np.flatnonzero(order == true_index)[0]) + 1
    return first, float(f"{probabilities[first]:.6g}"), float(f"{probabilities[true_index]:.6g}"), rank


def hash_inputs(*inputs: object) -> str:
    """Hash of a list that JSON can hold."""
    return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()


AnswerKey = tuple[str, str]
"""Hash of a frame, and what `name_weather` calls the weather."""


def read_answers(file: Path, wanted: Collection[AnswerKey]) -> RecordCache[AnswerKey, Answer, FrameAnswers]:
    """The answers that are wanted and there; those of a line that is broken are computed again."""
    log = RecordLog(file, FrameAnswers, required=False, compact=True)
    return RecordCache(log, lambda line: [((line.frame, name), one) for name, one in line.answers.items()], wanted)
