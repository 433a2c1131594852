"""Compare two runs, or two tables of any program, on the same images; and the page of all runs, `eval/index.html`."""

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
    pair_with_unpatched,
    rank_variant,
)
from toolkit.evaluation.origin import explain_replaced, read_images_hash
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
"""Largest number of gained and of lost pairs of a run, and of all runs, so that the page stays below 5 MB."""
FILTERS = {
    "kind": "experiment", "run": "run", "network": "network", "object": "object", "variant": "variant",
    "condition": "weather or corruption", "source": "source",
}  # fmt: skip


@dataclass(frozen=True)
class RunComparison:
    """Two runs on the images that both of them read.

    Attributes:
        pairs: both predictions of each image, in the order of the first run.
        rows: outcomes by variant and object, pooled rows last.
        unshared: number of images that only the first run read, and only the second.
        cluster_of: cluster of each pair; empty if clusters are not known.
        cluster_by: what the clusters are, in words.
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
        """Gain over clusters: their number, its interval, and the exact p of the signs of their mean changes."""
        if len(set(self.cluster_of)) < 2:
            return None
        _, member = np.unique(self.cluster_of, return_inverse=True)
        right = np.array([(pair.first.correct_top1, pair.second.correct_top1) for pair in self.pairs], float)
        gain, ci95 = estimate_difference(right[:, 1], right[:, 0], member)
        # a sign-flip test takes a number from each cluster: its mean change
        change = np.bincount(member, right[:, 1] - right[:, 0]) / np.bincount(member)
        return {"clusters": len(change), "gain": gain, "gain_ci95": ci95, "sign_flip_p": sign_flip_p(change.tolist())}

    @property
    def pooled(self) -> PairedOutcomes:
        """Outcomes of all images."""
        return self.rows[-1].outcomes

    @property
    def flips(self) -> list[Pair]:
        """Pairs with exactly one correct image: gained before lost, the largest change first."""
        found = [pair for pair in self.pairs if pair.is_gained or pair.is_lost]
        return sorted(found, key=lambda pair: (pair.is_lost, -abs(pair.change)))

    @property
    def verdict(self) -> str:
        """Result in words."""
        found = self.pooled
        better = self.second if found.second_is_better else self.first if found.first_is_better else None
        if better is None:
            words = describe_unsure(found)
            return f"{self.second.name}: {words[0].lower()}{words[1:]}"
        return f"{better.name} is correct more often"

    @property
    def sentence(self) -> str:
        """Numbers behind the verdict."""
        found = self.pooled
        shares = [f"{count} of {found.n}" for count in (found.n_first, found.n_second)]
        return (
            f"On the same images {self.first.name} has {shares[0]} correct and {self.second.name} {shares[1]}: "
            f"{found.only_second} gained, {found.only_first} lost ({format_test(found.mcnemar_p)})."
        )

    @property
    def cluster_sentence(self) -> str:
        """Result over clusters, or why the p value may be too small."""
        over = self.over_clusters
        # without clusters the test counts images as independent
        if not self.cluster_of:
            return (
                "Each image counts as an independent draw. If several images show the same object, name the column "
                "of the object (cluster)."
            )
        if over is None:
            return (
                f"All {len(self.pairs)} images are a single cluster by {self.cluster_by}: the result does not extend "
                "to others."
            )
        limits = f" ({format_points_interval(over['gain_ci95'])})" if over["gain_ci95"] else ""
        return (
            f"Over {over['clusters']} clusters by {self.cluster_by}, each an independent draw: "
            f"{format_points(over['gain'])} points{limits}, sign-flip p {format_p(over['sign_flip_p'])}."
        )

    def as_json(self) -> dict[str, Any]:
        """Return the result as `toolkit compare --json` prints it."""
        return {
            "schema_version": 1, "first": self.first.name, "second": self.second.name, "verdict": self.verdict,
            "only_in_first": self.unshared[0], "only_in_second": self.unshared[1],
            "notes": list(self.notes), "cluster_by": self.cluster_by or None,
            "rows": [_describe_row(row) for row in self.rows], "over_clusters": self.over_clusters,
            "flips": [
                {
                    "kind": "gained" if pair.is_gained else "lost", "path": pair.first.capture.path,
                    "path_in_second": pair.second.capture.path,
                    "first_says": pair.first.top1_label, "second_says": pair.second.top1_label,
                }
                for pair in self.flips
            ],
            "toolkit_version": __version__,
        }  # fmt: skip


def _describe_row(row: Comparison) -> dict[str, Any]:
    found = row.outcomes
    return {
        "object": row.object, "variant": row.second, "n": found.n, "both": found.both,
        "only_first": found.only_first, "only_second": found.only_second, "neither": found.neither,
        "gain": found.gain, "gain_ci95": list(found.gain_ci95), "mcnemar_p": found.mcnemar_p,
        "mcnemar_mid_p": mcnemar_mid_p(found.only_second, found.only_first),
    }  # fmt: skip


def compare_runs(workspace: Workspace, first: Run, second: Run, captures_dir: Path | None = None) -> RunComparison:
    """Pair the images of two runs, and count.

    Two images are the same if they are the same file of a capture folder, or if their files hold the same bytes, as
    copies in another source or in a sweep's folder do.

    Args:
        captures_dir: folder of the images of both; by default each run's own.

    Raises:
        ToolkitError: predictions are missing or damaged, or no image was read in both runs.
    """
    folders = [captures_dir or find_captures_dir(workspace, run) for run in (first, second)]
    said = [read_predictions(run, folder) for run, folder in zip((first, second), folders, strict=True)]
    # a path names the same image only within a folder, or in the same world seen by the same cameras
    are_worlds = first.kind == second.kind == "world-eval"
    is_one = real_path(folders[0]) == real_path(folders[1]) or (
        are_worlds and _describe_cameras(first) == _describe_cameras(second)
    )
    pairs = _pair_images(said[0], said[1], folders, is_one)
    if not pairs:
        raise ToolkitError(f"{first.name} and {second.name} share no image: compare runs of the same captures")
    # images that a single run read are counted, and not compared
    left = [sum(prediction.is_read for prediction in own) - len(pairs) for own in said]
    # images of an object share what makes it easy or hard: they are a cluster
    objects = tuple(pair.first.capture.object for pair in pairs)
    rows = tuple(_count_rows(pairs))
    replaced = [
        line for run, own, folder in zip((first, second), said, folders, strict=True)
        for line in explain_replaced(run, own, folder)
    ]  # fmt: skip
    # runs of the same names judged the same images, unless their hashes differ
    hashes = {read_images_hash(run) for run in (first, second)} - {None}
    names = [{prediction.capture.path for prediction in own} for own in said]
    if is_one and len(hashes) > 1 and names[0] == names[1]:
        what = "judged different pictures under the same names: some were shot again, edited or replaced"
        replaced.append(f"{first.name} and {second.name} {what}")
    pooling = explain_pooling([row for row in rows if row.second != POOLED])
    notes = (*replaced, *list_differences(first, second, pairs), *pooling)
    return RunComparison(
        first, second, tuple(pairs), rows, (left[0], left[1]), cluster_of=objects, cluster_by="object", notes=notes
    )


def list_differences(first: Run, second: Run, pairs: Sequence[Pair]) -> Iterator[str]:
    """Yield a sentence for each difference that runs should not have: true classes, labels, preprocessing."""
    network, other = first.network, second.network
    apart = [pair for pair in pairs if pair.first.true_label != pair.second.true_label]
    if apart:
        yield (
            f"the true class differs in {len(apart)} of {len(pairs)} images: '{apart[0].first.true_label}' in "
            f"{first.name}, '{apart[0].second.true_label}' in {second.name} ({apart[0].first.capture.path})"
        )
    # lists of labels
    renamed = _find_renamed(pairs)
    if renamed is not None or network.labels_sha256 != other.labels_sha256 != "" != network.labels_sha256:
        whose = ", though their weights are the same file" if network.sha256 and network.sha256 == other.sha256 else ""
        what = f": output {renamed[0]} is '{renamed[1]}' and '{renamed[2]}'" if renamed else ""
        yield f"the networks of {first.name} and {second.name} have different lists of labels{whose}{what}"
    # preprocessing, and two networks with the same name
    if network.preprocessing and other.preprocessing and network.preprocessing != other.preprocessing:
        whose = f"{network.preprocessing} in {first.name}; {other.preprocessing} in {second.name}"
        yield f"the networks see images differently: {whose}"
    # the same name with another identity: results under it must not be mixed up
    if (
        network.name == other.name != ""
        and network.network_id
        and other.network_id
        and network.network_id != other.network_id
    ):
        ids = f"{network.network_id} in {first.name}, {other.network_id} in {second.name}"
        yield f"two networks are called {network.name}: {ids}"


def _find_renamed(pairs: Sequence[Pair]) -> tuple[int, str, str] | None:
    """Return an output that the runs name differently, with both names; None if no image shows any."""
    names: tuple[dict[int, str], dict[int, str]] = {}, {}
    # an output's name, as the predictions of each run show it
    for pair in pairs:
        for known, prediction in zip(names, (pair.first, pair.second), strict=True):
            known[prediction.true_index] = prediction.true_label
            if prediction.top1_index is not None and prediction.top1_label is not None:
                known[prediction.top1_index] = prediction.top1_label
    shared = sorted(index for index in names[0].keys() & names[1].keys() if index >= 0)
    return next(((k, names[0][k], names[1][k]) for k in shared if names[0][k] != names[1][k]), None)


def _describe_cameras(run: Run) -> tuple[object, ...]:
    about, cameras = load_json(run.folder / SUMMARY).get("about", {}), run.folder / "cameras.csv"
    # a run without its table of cameras equals no other
    where = cameras.read_bytes() if cameras.is_file() else run.name
    return where, *(about.get(key) for key in ("world_sha256", "sky", "camera"))


def _pair_images(
    first: list[Prediction], second: list[Prediction], folders: Sequence[Path], is_one: bool
) -> list[Pair]:
    """Return the images that both runs read; if `is_one`, a path names the same image in both."""
    pairs: dict[str, Pair] = {}
    # by path
    if is_one:
        by_path = {image.capture.path: image for image in second}
        pairs = {
            image.capture.path: Pair(image, by_path[image.capture.path])
            for image in first
            if image.capture.path in by_path
        }
    taken = {pair.second.capture.path for pair in pairs.values()}
    left = [[image for image in first if image.capture.path not in pairs]]
    left.append([image for image in second if image.capture.path not in taken])
    # the others by their bytes
    if all(left):
        keyed = [_key_by_bytes(own, folder) for own, folder in zip(left, folders, strict=True)]
        same = [Pair(image, keyed[1][key]) for key, image in keyed[0].items() if key in keyed[1]]
        pairs |= {pair.first.capture.path: pair for pair in same}
    found = [pairs[image.capture.path] for image in first if image.capture.path in pairs]
    return [pair for pair in found if pair.first.is_read and pair.second.is_read]


def _key_by_bytes(predictions: list[Prediction], folder: Path) -> dict[tuple[str, str, int], Prediction]:
    """Return predictions by object, hash of the file, and number among equal files; a missing image has no key."""
    seen: Counter[tuple[str, str]] = Counter()
    keyed = {}
    for prediction, sha256 in zip(predictions, hash_images(predictions), strict=True):
        # an image that is corrupted when it is read shares its file with its source
        if sha256 is not None and has_own_file(prediction, folder):
            # several files may hold the same bytes: they are paired in their order
            key = (prediction.capture.object, sha256)
            seen[key] += 1
            keyed[prediction.capture.object, sha256, seen[key]] = prediction
    return keyed


def _count_rows(pairs: Iterable[Pair]) -> list[Comparison]:
    def keys_of(pair: Pair) -> list[tuple[str, str]]:
        capture = pair.first.capture
        keys = [(variant, name) for variant in (capture.variant, POOLED) for name in (capture.object, POOLED)]
        # an older run may have a variant of that name, whose images would count twice
        return list(dict.fromkeys(keys))

    members = gather(pairs, keys_of)
    order = sorted(members, key=lambda key: (key[0] == POOLED, rank_variant(key[0]), key[1] == POOLED, key[1]))
    return [Comparison(POOLED, name, variant, variant, tuple(members[variant, name])) for variant, name in order]


def build_comparison_table(found: RunComparison) -> Table:
    """Return a table with a line for each variant and object; A is the first run, B the second."""
    rows = []
    for row in found.rows:
        outcomes = row.outcomes
        shares = [format_percent(count / outcomes.n) for count in (outcomes.n_first, outcomes.n_second)]
        gain = f"{format_points(outcomes.gain)} ({format_points_interval(outcomes.gain_ci95)})"
        counts = [str(count) for count in (outcomes.both, outcomes.only_first, outcomes.only_second)]
        rows.append([row.second, row.object, str(outcomes.n), *shares, gain, *counts, format_p(outcomes.mcnemar_p)])
    title = f"A: {found.first.name}, B: {found.second.name}"
    return build_table(title, ("variant", "object"), HEADS, rows, bold=POOLED)


def write_comparison(path: Path, found: RunComparison) -> Path:
    """Write the comparison as a self-contained HTML page, with pictures of at most 60 flips."""
    flips = found.flips[:MAX_FLIPS]
    cards: dict[str, list[Card]] = {"gained": [], "lost": []}
    for pair in flips:
        card = Card(pair.first.capture.path, describe_place(pair.first), (pair.first, pair.second))
        cards["gained" if pair.is_gained else "lost"].append(card)
    context = {
        "title": f"{found.first.name} and {found.second.name}", "found": found, "flips": list(cards.items()),
        "n_flips": len(found.flips), "max_flips": MAX_FLIPS,
        "thumbnails": make_thumbnails((pair.first.capture for pair in flips), None),
    }  # fmt: skip
    return write_page(path, "toolkit.evaluation", "compare.html.j2", context)


def write_index(path: Path, workspace: Workspace, runs: Sequence[Run]) -> list[tuple[str, str]]:
    """Write the page of many runs, a self-contained file; each picture is in it once.

    Returns:
        (run, reason) of each run whose flips could not be read; the page shows its rows all the same.
    """
    pairs, refused = _gather_flips(workspace, runs)
    shown = pairs[:MAX_FLIPS_OF_ALL]
    captures = [prediction.capture for _, pair in shown for prediction in (pair.first, pair.second)]
    # keyed by the whole path: two runs may give two images the same name
    made = make_thumbnails((replace(capture, path=str(capture.file)) for capture in captures), None, THUMBNAIL_PX)
    pictures = {uri: number for number, uri in enumerate(dict.fromkeys(made.values()))}
    numbers = {file: pictures[uri] for file, uri in made.items()}
    # rows of all runs
    rows = tell_networks_apart([row for run in runs for row in run.rows])
    filters = {name: (words, sorted({str(getattr(row, name)) for row in rows})) for name, words in FILTERS.items()}
    context = {
        "runs": runs, "rows": rows, "filters": filters, "n_flips": len(pairs), "pictures": list(pictures),
        "reports": {run.name: report for run in runs if (report := _find_report(path, run))},
        "flips": [_describe_run_flip(run, pair, numbers) for run, pair in shown],
        "conditions": {row: describe_condition(row) for row in rows},
    }  # fmt: skip
    write_page(path, "toolkit.evaluation", "index.html.j2", context)
    return refused


def _gather_flips(workspace: Workspace, runs: Sequence[Run]) -> tuple[list[tuple[Run, Pair]], list[tuple[str, str]]]:
    """Return the flips of all runs in turns, so that no run crowds out the others, and runs that failed."""
    refused, decks = [], []
    for run in runs:
        if not run.has_predictions:
            continue
        try:
            predictions = read_predictions(run, find_captures_dir(workspace, run))
        except ToolkitError as error:
            refused.append((run.name, str(error)))
            continue
        flips = list_flips(pair_with_unpatched(index_poses(predictions)))
        # each run gives some of its flips, in turns
        decks.append([(run, pair) for some in flips for pair in some.shown[:MAX_FLIPS_OF_RUN]])
    longest = max(map(len, decks), default=0)
    return [deck[at] for at in range(longest) for deck in decks if at < len(deck)], refused


def _describe_run_flip(run: Run, pair: Pair, numbers: dict[str, int]) -> dict[str, Any]:
    """Return what the page shows of a flip; a picture is its number on the page, None if the image is gone."""
    capture = pair.second.capture
    # the row of its source and variant, else the run's first
    row = next((row for row in run.rows if (row.source, row.variant) == (capture.source, capture.variant)), run.rows[0])
    cells = (pair.first, pair.second)
    return {
        "run": run.name, "network": row.network, "kind": "gained" if pair.is_gained else "lost", "cells": cells,
        "condition": capture.corruption[0] if capture.corruption else row.condition,
        "pictures": [numbers.get(str(cell.capture.file)) for cell in cells],
    }  # fmt: skip


def _find_report(path: Path, run: Run) -> str | None:
    """Return the link from the page to the report of a run, if there is one."""
    report, home = (run.folder / "report.html").resolve(), path.resolve().parent
    # a report elsewhere has no relative link that opens from disk
    return report.relative_to(home).as_posix() if report.is_file() and report.is_relative_to(home) else None
