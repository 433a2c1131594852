"""Two runs, or two tables of any program, on the same images: what each got right, the exact test, what flipped.

`eval/index.html` has all runs of a workspace on one page, with filters, and their flips side by side.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from toolkit import __version__
from toolkit.captures.read import POOLED
from toolkit.core.errors import ToolkitError
from toolkit.core.files import load_json, real_path
from toolkit.core.statistics import PairedOutcomes, mcnemar_mid_p, sign_flip_p
from toolkit.core.tables import (
    build_table,
    format_p,
    format_percent,
    format_points,
    format_points_interval,
    format_test,
)
from toolkit.core.workspace import Workspace
from toolkit.evaluation.contact_sheet import Card, describe_place, make_thumbnails
from toolkit.evaluation.metrics import (
    Comparison,
    Pair,
    estimate_difference,
    explain_pooling,
    gather,
    index_poses,
    list_flips,
    rank_variant,
)
from toolkit.evaluation.origin import explain_replaced
from toolkit.evaluation.page import write_page
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.predictions_csv import find_captures_dir, has_own_file, hash_images, read_predictions
from toolkit.evaluation.run_files import SUMMARY
from toolkit.evaluation.summaries import Run, describe_condition, tell_networks_apart
from toolkit.evaluation.verdict import describe_unsure

MAX_FLIPS = 60
HEADS = ("images", "A %", "B %", "B − A (95 %)", "both", "A only", "B only", "p")
THUMBNAIL_PX = 144
MAX_FLIPS_OF_RUN, MAX_FLIPS_OF_ALL = 16, 320
"""Gained and lost alike of one run; and of all, so that the page stays below 5 MB."""
FILTERS = {
    "kind": "experiment", "run": "run", "network": "network", "object": "object", "variant": "variant",
    "condition": "weather or corruption", "source": "source",
}  # fmt: skip


@dataclass(frozen=True)
class RunComparison:
    """Two runs on the images that both of them read.

    Attributes:
        first, second: the runs.
        pairs: each image as both saw it, in the order of the first.
        rows: by variant and object, pooled rows last.
        unshared: how many images only the first read, and only the second.
        cluster_of: of each pair, what it shares with others; empty where nothing says so.
        cluster_by: what says so, in words.
        notes: what else differs between the two, and how labels were read.
    """

    first: Run
    second: Run
    pairs: tuple[Pair, ...]
    rows: tuple[Comparison, ...]
    unshared: tuple[int, int]
    cluster_of: tuple[str, ...] = ()
    cluster_by: str = ""
    notes: tuple[str, ...] = ()

    @cached_property
    def over_clusters(self) -> dict[str, Any] | None:
        """The gain over clusters: how many, its interval, and the exact p of the signs of their mean changes."""
        if len(set(self.cluster_of)) < 2:
            return None
        _, member = np.unique(self.cluster_of, return_inverse=True)
        right = np.array([(pair.first.correct_top1, pair.second.correct_top1) for pair in self.pairs], float)
        gain, ci95 = estimate_difference(right[:, 1], right[:, 0], member)
        # a sign-flip test takes one number from each cluster: its mean change
        change = np.bincount(member, right[:, 1] - right[:, 0]) / np.bincount(member)
        return {"clusters": len(change), "gain": gain, "gain_ci95": ci95, "sign_flip_p": sign_flip_p(change.tolist())}

    @property
    def pooled(self) -> PairedOutcomes:
        """The outcomes of all images."""
        return self.rows[-1].outcomes

    @property
    def flips(self) -> list[Pair]:
        """Images that one got right and the other wrong: gained before lost, the surest first."""
        found = [pair for pair in self.pairs if pair.is_gained or pair.is_lost]
        return sorted(found, key=lambda pair: (pair.is_lost, -abs(pair.change)))

    @property
    def verdict(self) -> str:
        """The result in words."""
        found = self.pooled
        better = self.second if found.second_is_better else self.first if found.first_is_better else None
        if better is None:
            words = describe_unsure(found)
            return f"{self.second.name}: {words[0].lower()}{words[1:]}"
        return f"{better.name} is right more often"

    @property
    def sentence(self) -> str:
        """The numbers behind the verdict."""
        found = self.pooled
        shares = [f"{count} of {found.n}" for count in (found.n_first, found.n_second)]
        return (
            f"On the same images {self.first.name} is right on {shares[0]} and {self.second.name} on {shares[1]}: "
            f"{found.only_second} became right and {found.only_first} became wrong ({format_test(found.mcnemar_p)})."
        )

    @property
    def cluster_sentence(self) -> str:
        """The same over clusters, or why the p value may be too small."""
        over = self.over_clusters
        if not self.cluster_of:
            return (
                "Each image counts as one independent draw. If several images show one object, name the column that "
                "says which (cluster)."
            )
        if over is None:
            return (
                f"All {len(self.pairs)} images belong together by {self.cluster_by}: the result is about this one, and "
                "says nothing about others."
            )
        limits = f" ({format_points_interval(over['gain_ci95'])})" if over["gain_ci95"] else ""
        return (
            f"Over {over['clusters']} clusters by {self.cluster_by}, each one independent draw: "
            f"{format_points(over['gain'])} points{limits}, sign-flip p {format_p(over['sign_flip_p'])}."
        )

    def as_json(self) -> dict[str, Any]:
        """The result, as `toolkit compare --json` prints it."""
        return {
            "schema_version": 1, "first": self.first.name, "second": self.second.name, "verdict": self.verdict,
            "only_in_first": self.unshared[0], "only_in_second": self.unshared[1],
            "notes": list(self.notes), "cluster_by": self.cluster_by or None,
            "rows": [_describe_row(row) for row in self.rows], "over_clusters": self.over_clusters,
            "flips": [_describe_flip(pair) for pair in self.flips], "toolkit_version": __version__,
        }  # fmt: skip


def _describe_row(row: Comparison) -> dict[str, Any]:
    found = row.outcomes
    return {
        "object": row.object, "variant": row.second, "n": found.n, "both": found.both,
        "only_first": found.only_first, "only_second": found.only_second, "neither": found.neither,
        "gain": found.gain, "gain_ci95": list(found.gain_ci95), "mcnemar_p": found.mcnemar_p,
        "mcnemar_mid_p": mcnemar_mid_p(found.only_second, found.only_first),
    }  # fmt: skip


def _describe_flip(pair: Pair) -> dict[str, Any]:
    kind = "gained" if pair.is_gained else "lost"
    said = {"first_says": pair.first.top1_label, "second_says": pair.second.top1_label}
    return {"kind": kind, "path": pair.first.capture.path, "path_in_second": pair.second.capture.path, **said}


def compare_runs(workspace: Workspace, first: Run, second: Run, captures_dir: Path | None = None) -> RunComparison:
    """Pair the images of two runs, and count.

    An image is the same where both runs name the same file of one capture folder, else where the files hold the same
    bytes, as for copies in another source or in a sweep's folder.

    Args:
        workspace: that the runs are of.
        first, second: from `open_run`, with predictions.
        captures_dir: where the images of both lie; by default of each run's own.

    Raises:
        ToolkitError: a run has no predictions or damaged ones, or they share no image that both read.
    """
    folders = [captures_dir or find_captures_dir(workspace, run) for run in (first, second)]
    said = [read_predictions(run, folder) for run, folder in zip((first, second), folders, strict=True)]
    # a path means the same picture only in one folder, or in one world seen by the same cameras
    is_one = real_path(folders[0]) == real_path(folders[1]) or _have_one_world(first, second)
    pairs = _pair_images(said[0], said[1], folders, is_one)
    if not pairs:
        raise ToolkitError(
            f"{first.name} and {second.name} share no image that both could read: compare runs over the same captures"
        )
    left = [sum(one.is_read for one in own) - len(pairs) for own in said]
    # images of one object share what makes it easy or hard
    objects = tuple(pair.first.capture.object for pair in pairs)
    rows = tuple(_count_rows(pairs))
    replaced = [
        line for run, own, folder in zip((first, second), said, folders, strict=True)
        for line in explain_replaced(run, own, folder)
    ]  # fmt: skip
    pooling = explain_pooling([row for row in rows if row.second != POOLED])
    notes = (*replaced, *list_differences(first, second, pairs), *pooling)
    return RunComparison(
        first, second, tuple(pairs), rows, (left[0], left[1]), cluster_of=objects, cluster_by="object", notes=notes
    )


def list_differences(first: Run, second: Run, pairs: Sequence[Pair]) -> Iterator[str]:
    """A sentence on each thing that both runs should share and do not: true classes, labels, preprocessing."""
    one, other = first.network, second.network
    apart = [pair for pair in pairs if pair.first.true_label != pair.second.true_label]
    if apart:
        yield (
            f"the true class differs in {len(apart)} of {len(pairs)} images: '{apart[0].first.true_label}' in "
            f"{first.name}, '{apart[0].second.true_label}' in {second.name} ({apart[0].first.capture.path})"
        )
    renamed = _find_renamed(pairs)
    if renamed is not None or one.labels_sha256 != other.labels_sha256 != "" != one.labels_sha256:
        whose = ", though their weights are the same file" if one.sha256 and one.sha256 == other.sha256 else ""
        what = f": output {renamed[0]} is '{renamed[1]}' and '{renamed[2]}'" if renamed else ""
        yield f"the networks of {first.name} and {second.name} have different lists of labels{whose}{what}"
    if one.preprocessing and other.preprocessing and one.preprocessing != other.preprocessing:
        whose = f"{one.preprocessing} in {first.name}; {other.preprocessing} in {second.name}"
        yield f"the networks see images differently: {whose}"
    if one.name == other.name != "" and one.network_id and other.network_id and one.network_id != other.network_id:
        ids = f"{one.network_id} in {first.name}, {other.network_id} in {second.name}"
        yield f"two networks are called {one.name}: {ids}"


def _find_renamed(pairs: Sequence[Pair]) -> tuple[int, str, str] | None:
    """An output that both runs name, each in its way; None where no image shows one."""
    names: tuple[dict[int, str], dict[int, str]] = {}, {}
    for pair in pairs:
        for known, one in zip(names, (pair.first, pair.second), strict=True):
            known[one.true_index] = one.true_label
            if one.top1_index is not None and one.top1_label is not None:
                known[one.top1_index] = one.top1_label
    shared = sorted(index for index in names[0].keys() & names[1].keys() if index >= 0)
    return next(((k, names[0][k], names[1][k]) for k in shared if names[0][k] != names[1][k]), None)


def _have_one_world(first: Run, second: Run) -> bool:
    """Whether two runs saw one world under one sky from the same cameras, so that a path means the same picture."""
    if first.kind != "world-eval" or second.kind != "world-eval":
        return False
    return _describe_cameras(first) == _describe_cameras(second)


def _describe_cameras(run: Run) -> tuple[object, ...]:
    about, cameras = load_json(run.folder / SUMMARY).get("about", {}), run.folder / "cameras.csv"
    # without its table of cameras a run is like no other
    where = cameras.read_bytes() if cameras.is_file() else run.name
    return where, *(about.get(key) for key in ("world_sha256", "sky", "camera"))


def _pair_images(
    first: list[Prediction], second: list[Prediction], folders: Sequence[Path], is_one: bool
) -> list[Pair]:
    """The images that both read; `is_one`: a path means the same image in both."""
    pairs: dict[str, Pair] = {}
    if is_one:
        by_path = {one.capture.path: one for one in second}
        pairs = {one.capture.path: Pair(one, by_path[one.capture.path]) for one in first if one.capture.path in by_path}
    taken = {pair.second.capture.path for pair in pairs.values()}
    left = [[one for one in first if one.capture.path not in pairs]]
    left.append([one for one in second if one.capture.path not in taken])
    if all(left):
        keyed = [_key_by_bytes(own, folder) for own, folder in zip(left, folders, strict=True)]
        same = [Pair(one, keyed[1][key]) for key, one in keyed[0].items() if key in keyed[1]]
        pairs |= {pair.first.capture.path: pair for pair in same}
    found = [pairs[one.capture.path] for one in first if one.capture.path in pairs]
    return [pair for pair in found if pair.first.is_read and pair.second.is_read]


def _key_by_bytes(predictions: list[Prediction], folder: Path) -> dict[tuple[str, str, int], Prediction]:
    """By object, hash of the file, and its number among these; an image that is gone has no key."""
    seen: Counter[tuple[str, str]] = Counter()
    keyed = {}
    for prediction, sha256 in zip(predictions, hash_images(predictions, folder), strict=True):
        # what is corrupted when it is read shares its file's bytes with the source that it is made of
        if sha256 is not None and has_own_file(prediction, folder):
            # the same bytes may lie there twice: the first is paired with the first
            key = (prediction.capture.object, sha256)
            seen[key] += 1
            keyed[prediction.capture.object, sha256, seen[key]] = prediction
    return keyed


def _count_rows(pairs: Iterable[Pair]) -> list[Comparison]:
    def keys_of(pair: Pair) -> list[tuple[str, str]]:
        one = pair.first.capture
        return [(variant, name) for variant in (one.variant, POOLED) for name in (one.object, POOLED)]

    members = gather(pairs, keys_of)
    order = sorted(members, key=lambda key: (key[0] == POOLED, rank_variant(key[0]), key[1] == POOLED, key[1]))
    return [Comparison(POOLED, name, variant, variant, tuple(members[variant, name])) for variant, name in order]


def build_comparison_table(found: RunComparison) -> Table:
    """A line for each variant and object; A is the first run, B the second."""
    rows = []
    for row in found.rows:
        one = row.outcomes
        shares = [format_percent(count / one.n) for count in (one.n_first, one.n_second)]
        gain = f"{format_points(one.gain)} ({format_points_interval(one.gain_ci95)})"
        counts = [str(count) for count in (one.both, one.only_first, one.only_second)]
        rows.append([row.second, row.object, str(one.n), *shares, gain, *counts, format_p(one.mcnemar_p)])
    title = f"A: {found.first.name}, B: {found.second.name}"
    return build_table(title, ("variant", "object"), HEADS, rows, bold=POOLED)


def write_comparison(path: Path, found: RunComparison) -> Path:
    """Write the comparison as one HTML page that opens from disk; at most 60 flips are shown with their pictures."""
    flips = found.flips[:MAX_FLIPS]
    context = {
        "title": f"{found.first.name} and {found.second.name}",
        "found": found,
        "flips": [
            (kind, [_make_card(pair) for pair in flips if pair.is_gained == (kind == "gained")])
            for kind in ("gained", "lost")
        ],
        "n_flips": len(found.flips),
        "max_flips": MAX_FLIPS,
        "thumbnails": make_thumbnails((pair.first.capture for pair in flips), None),
    }
    return write_page(path, "toolkit.evaluation", "compare.html.j2", context)


def _make_card(pair: Pair) -> Card:
    return Card(pair.first.capture.path, describe_place(pair.first), (pair.first, pair.second))


def write_index(path: Path, workspace: Workspace, runs: Sequence[Run]) -> list[tuple[str, str]]:
    """Write the page: one file that opens from disk, without a network.

    Each picture is in it once, however many runs saw it.

    Args:
        path: of the page; links to reports are relative to its folder.
        workspace: that the runs are of.
        runs: from `find_runs`.

    Returns:
        (run, reason) of each run whose flips could not be read; its rows are shown all the same.
    """
    pairs, refused = _gather_flips(workspace, runs)
    shown = pairs[:MAX_FLIPS_OF_ALL]
    captures = [one.capture for _, pair in shown for one in (pair.first, pair.second)]
    # by the whole path: two runs may call two images the same
    made = make_thumbnails((replace(capture, path=str(capture.file)) for capture in captures), None, THUMBNAIL_PX)
    pictures = {uri: number for number, uri in enumerate(dict.fromkeys(made.values()))}
    numbers = {file: pictures[uri] for file, uri in made.items()}
    rows = tell_networks_apart([row for run in runs for row in run.rows])
    context = {
        "runs": runs,
        "rows": rows,
        "reports": {run.name: report for run in runs if (report := _find_report(path, run))},
        "filters": {
            name: (words, sorted({str(getattr(row, name)) for row in rows})) for name, words in FILTERS.items()
        },
        "flips": [_describe_run_flip(run, pair, numbers) for run, pair in shown],
        "n_flips": len(pairs),
        "pictures": list(pictures),
        "conditions": {row: describe_condition(row) for row in rows},
    }
    write_page(path, "toolkit.evaluation", "index.html.j2", context)
    return refused


def _gather_flips(workspace: Workspace, runs: Sequence[Run]) -> tuple[list[tuple[Run, Pair]], list[tuple[str, str]]]:
    """The flips of each run that are shown: in turns, so that no run crowds out the others."""
    refused, decks = [], []
    for run in runs:
        if not run.has_predictions:
            continue
        try:
            predictions = read_predictions(run, find_captures_dir(workspace, run))
        except ToolkitError as error:
            refused.append((run.name, str(error)))
            continue
        flips = [pair for some in list_flips(index_poses(predictions)) for pair in some.shown[:MAX_FLIPS_OF_RUN]]
        decks.append([(run, pair) for pair in flips])
    longest = max(map(len, decks), default=0)
    return [deck[at] for at in range(longest) for deck in decks if at < len(deck)], refused


def _describe_run_flip(run: Run, pair: Pair, numbers: dict[str, int]) -> dict[str, Any]:
    """What the page shows of a pair that changed; a picture is its number on the page, None where the image is gone."""
    capture = pair.second.capture
    row = next((row for row in run.rows if (row.source, row.variant) == (capture.source, capture.variant)), run.rows[0])
    cells = (pair.first, pair.second)
    return {
        "run": run.name, "network": row.network, "kind": "gained" if pair.is_gained else "lost", "cells": cells,
        "condition": capture.corruption[0] if capture.corruption else row.condition,
        "pictures": [numbers.get(str(cell.capture.file)) for cell in cells],
    }  # fmt: skip


def _find_report(path: Path, run: Run) -> str | None:
    """Where its report is, as seen from the page."""
    report, home = (run.folder / "report.html").resolve(), path.resolve().parent
    # a report elsewhere has no relative link that opens from disk
    return report.relative_to(home).as_posix() if report.is_file() and report.is_relative_to(home) else None
