"""The leaderboard: a page that opens from disk, a CSV file, and a JSON file of each entry."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from pydantic import BaseModel, Field, NonNegativeInt

from toolkit.captures.capture import UNPATCHED
from toolkit.core.errors import ToolkitError
from toolkit.core.files import write_json, write_text
from toolkit.core.statistics import PairedOutcomes, adjust_holm, sign_flip_p
from toolkit.core.tables import encode_csv
from toolkit.evaluation.agreement import say_where, shorten_names
from toolkit.evaluation.contact_sheet import encode_jpeg
from toolkit.evaluation.page import write_page
from toolkit.evaluation.summaries import load_summary, validate_summary
from toolkit.imaging.style import COLOURS, UNPATCHED_COLOUR
from toolkit.rooms.benchmarks.challenge.entry import EntryRecord
from toolkit.rooms.benchmarks.challenge.score import (
    CONDITIONS,
    FOG,
    Judged,
    Score,
    describe_rank,
    read_judged,
    read_picture,
    rescore,
)

PICTURE_PX = 240
TIE = 1e-9


@dataclass(frozen=True)
class Standing:
    """A line of a leaderboard.

    Attributes:
        rank: from 1; entries of equal lower bounds share a rank. None without unseen judges.
        p_next: paired, against the entry below, Holm-corrected over the board; None for the last.
        renderers: in which renderers its gain is significant, see `describe_renderers`.
    """

    rank: int | None
    judged: Judged
    p_next: float | None
    renderers: tuple[str, ...] = ()

    @property
    def score(self) -> Score:
        """Score of the entry."""
        return self.judged.score

    def as_json(self) -> dict[str, Any]:
        """A row of the CSV."""
        return {
            "rank": self.rank, **describe_rank(self.score), "p_next": self.p_next,
            "renderers": "; ".join(self.renderers) or None,
        }  # fmt: skip


def rank_entries(entries: Sequence[Judged]) -> list[Standing]:
    """Rank entries of a class by the lower end of the interval of their gain on unseen networks.

    Neighbours are compared picture by picture, on the judges unseen by both. Each picture, with all judges and
    conditions, is a draw of the sign-flip test.
    """
    # entries without a gain on unseen networks come last, and have no rank
    ranked = sorted(entries, key=lambda entry: (entry.score.rank_ci95 is None, -(entry.score.rank_ci95 or (0, 0))[0]))
    # only neighbours are compared, and the p values are corrected for their number (Holm)
    pairs = [_compare(first, other) for first, other in pairwise(ranked)]
    adjusted = iter(adjust_holm([p for p in pairs if p is not None]))
    p_next = [None if p is None else next(adjusted) for p in pairs]
    places: list[Standing] = []
    for number, entry in enumerate(ranked, 1):
        low = entry.score.rank_ci95[0] if entry.score.rank_ci95 else None
        above = places[-1] if places else None
        # equal lower ends share a rank
        is_tied = above is not None and low is not None and above.score.rank_ci95 is not None and (
            abs(above.score.rank_ci95[0] - low) < TIE
        )  # fmt: skip
        rank = None if low is None else above.rank if above is not None and is_tied else number
        places.append(Standing(rank, entry, p_next[number - 1] if number <= len(p_next) else None))
    return places


def _compare(first: Judged, other: Judged) -> float | None:
    """Sign-flip p on the judges unseen by both; None without such judges or shared pictures."""
    judges = {judge.sha256 for judge in first.score.judges if not judge.seen}
    judges &= {judge.sha256 for judge in other.score.judges if not judge.seen}
    # answers to the booster's pictures by object, pose, judge and condition
    tables = [
        {
            (line.object, line.pose, line.judge_sha256, line.condition): line.correct
            for line in judged.outcomes
            if line.judge_sha256 in judges and line.variant == judged.entry.record.variant
        }
        for judged in (first, other)
    ]
    # differences of shared answers, averaged by picture
    changes: dict[tuple[str, int], list[int]] = {}
    for key in tables[0].keys() & tables[1].keys():
        changes.setdefault(key[:2], []).append(int(tables[0][key]) - int(tables[1][key]))
    return sign_flip_p([float(np.mean(own)) for _, own in sorted(changes.items())]) if changes else None


class _Booster(BaseModel):
    variant: str
    sha256: str


class _SourceBoosters(BaseModel):
    source: str
    boosters: tuple[_Booster, ...]


class _Origin(BaseModel):
    sources: tuple[_SourceBoosters, ...] = ()


class _Gain(BaseModel):
    source: str
    variant: str
    n_pairs: int
    gained: NonNegativeInt
    lost: NonNegativeInt


class _Agreement(BaseModel):
    sources: tuple[str, ...] = Field(min_length=1)
    renderers: tuple[str, ...]
    gains: tuple[_Gain, ...]


class _Network(BaseModel):
    arch: str


class _RendererSummary(BaseModel):
    """What `summary.json` of an evaluation says of renderers, and of the boosters in its images."""

    model: _Network
    rests_on: _Origin | None = None
    renderers: tuple[_Agreement, ...] = ()


def describe_renderers(entry: EntryRecord, summary: _RendererSummary) -> Iterator[str]:
    """Yield `resnet18, 36 pairs: holds in all 3 renderers` for an evaluation of several renderers.

    Args:
        entry: record of the entry.
        summary: of the evaluation, see `toolkit.evaluation.agreement`.
    """
    shown = {
        source.source: {booster.sha256 for booster in source.boosters if booster.variant == entry.variant}
        for source in (summary.rests_on or _Origin()).sources
    }
    # a run counts for an entry only if it shows the entry's own boosters
    for agreement in summary.renderers:
        own = shown.get(agreement.sources[0], set())
        # summaries have the first digits of hashes
        if not own or not all(any(full.startswith(short) for full in entry.boosters.values()) for short in own):
            continue
        names = dict(zip(agreement.sources, shorten_names(agreement.renderers), strict=False))
        rows = [row for row in agreement.gains if row.variant == entry.variant]
        found = {names.get(row.source, row.source): PairedOutcomes(0, row.lost, row.gained, 0) for row in rows}
        if found:
            yield f"{summary.model.arch}, {rows[0].n_pairs} pairs: {say_where(found)[1]}"


def write_board(
    folders: Sequence[Path], out: Path, runs: Sequence[Path] = ()
) -> tuple[list[Standing], list[tuple[str, str]]]:
    """Write `index.html`, `board.csv` and `NAME.json` of each entry whose score follows from its files.

    Args:
        folders: of the entries.
        out: folder of the board.
        runs: folders of evaluations, see `describe_renderers`.

    Returns:
        The places, class by class, and (entry, reason) of each that is left out.

    Raises:
        ToolkitError: no entry is left, or the folder cannot be written.
    """
    # every score is computed again from its outcomes: the stated score is not believed
    entries, refused = [], []
    for folder in folders:
        faults = rescore(folder)
        if faults:
            refused.append((str(folder), faults[0]))
        else:
            entries.append(read_judged(folder))
    # the files below have the entries' names, which some disks read without case
    names = [entry.score.entry.name.lower() for entry in entries]
    for name in {name for name in names if names.count(name) > 1}:
        raise ToolkitError(f"two entries are called '{name}': change a name in its entry.json")
    if not entries:
        raise ToolkitError(f"no entry to rank{f': {refused[0][0]}: {refused[0][1]}' if refused else ''}")
    # only entries of the same division, budget and judges are ranked together
    classes: dict[tuple[object, ...], list[Judged]] = {}
    for entry in entries:
        classes.setdefault(entry.score.class_of, []).append(entry)
    shot = [validate_summary(run, load_summary(run), _RendererSummary) for run in runs]
    boards = [
        [
            replace(one, renderers=tuple(words for each in shot for words in describe_renderers(one.score.entry, each)))
            for one in rank_entries(own)
        ]
        for own in classes.values()
    ]
    places = [place for board in boards for place in board]
    rows = [place.as_json() for place in places]
    # for programs: a JSON file of each entry, and the table
    for place in places:
        write_json(out / f"{place.score.entry.name}.json", place.score.model_dump(mode="json"), out)
    write_text(out / "board.csv", encode_csv(list(rows[0]), (row.values() for row in rows)), out)
    # for people: the page
    context = {
        "title": "Challenge", "boards": [(_name_class(board[0].score), board[0].score, board) for board in boards],
        "pictures": {entry.score.entry.name: _embed_pictures(entry) for entry in entries},
        "curves": {entry.score.entry.name: _count_curve(entry) for entry in entries},
        "conditions": CONDITIONS, "colour": COLOURS[0], "bare_colour": UNPATCHED_COLOUR,
    }  # fmt: skip
    write_page(out / "index.html", "toolkit.rooms.benchmarks.challenge", "board.html.j2", context)
    return places, refused


def _name_class(score: Score) -> str:
    judges = "the division's judges"
    if not score.is_official:
        judges = "judges " + ", ".join(judge.name for judge in score.judges)
    return f"{score.entry.division} division, {score.entry.budget}, version {score.challenge_version}, {judges}"


def _embed_pictures(judged: Judged) -> list[tuple[str, list[str]]]:
    """(object, data URIs) of the pictures of each object with its booster, and of the booster."""
    found = []
    for name in judged.entry.objects:
        shown = read_picture(judged, name), judged.entry.read_booster(name).pixels
        found.append((name, [encode_jpeg(Image.fromarray(pixels), PICTURE_PX) for pixels in shown]))
    return found


def _count_curve(judged: Judged) -> list[tuple[int, float, float]]:
    """(severity, accuracy without and with the booster) by unseen judges; severity 0 is clear."""
    judges = {judge.sha256 for judge in judged.score.judges if not judge.seen}
    right: dict[int, dict[str, list[bool]]] = {}
    for outcome in judged.outcomes:
        if outcome.condition != FOG and outcome.judge_sha256 in judges:
            right.setdefault(outcome.severity, {}).setdefault(outcome.variant, []).append(outcome.correct)
    bare, boosted = UNPATCHED, judged.entry.record.variant
    return [
        (severity, float(np.mean(own[bare])), float(np.mean(own[boosted]))) for severity, own in sorted(right.items())
    ]
