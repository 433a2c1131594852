"""From a capture folder to a run folder: read, predict, compare, and write a self-contained report."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log
from pathlib import Path
from typing import Any

from toolkit.core.workspace import Workspace
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.agreement import (
    ANSWER_HEADS,
    GAIN_HEADS,
    add_colours,
    list_answers,
    list_colours,
    list_flips,
    list_gains,
)
from toolkit.evaluation.contact_sheet import (
    MANY_SHEETS,
    Card,
    chart_poses,
    describe_place,
    lay_out,
    lay_out_flips,
    make_thumbnails,
)
from toolkit.evaluation.ground_truth import find_other_classes, read_labelled_captures
from toolkit.evaluation.metrics import MAX_FLIPS, NOUNS, OWNERS, Comparison, Pair, explain_pooling, rank_variant
from toolkit.evaluation.origin import find_origin
from toolkit.evaluation.page import write_page
from toolkit.evaluation.predict import predict_captures
from toolkit.evaluation.predictions_csv import encode_predictions
from toolkit.evaluation.results import (
    Findings,
    compare_predictions,
    describe_other_classes,
    describe_unseen,
    find_training,
    list_corrupted,
    mark_seen,
    summarise,
)
from toolkit.evaluation.run_files import PREDICTIONS, explain_run_dir, find_run_dir, lacks_other_table, write_run
from toolkit.evaluation.saliency import HEAT_COLOURS, HEAT_LEVELS, Saliency, draw_saliency
from toolkit.evaluation.sim_real import GainForecast, SimReal, place_of
from toolkit.evaluation.summaries import Kind
from toolkit.evaluation.tables import count_gated, pick_rows, rows_by_source
from toolkit.evaluation.twins import TwinFinder
from toolkit.models.detector import Detector
from toolkit.models.identity import hash_network_tensors
from toolkit.models.network import Classifier

DEFAULT = EvalConfig()
MOST_SOURCES, LONGEST_PART = 3, 40


@dataclass(frozen=True)
class Evaluation(Findings):
    """Result of an evaluation: predictions, statistics and the folder that holds them.

    Attributes:
        run_dir: folder `eval/RUN`.
        notes: remarks for the reader.
        summary: content of `summary.json`.
    """

    run_dir: Path
    notes: tuple[str, ...]
    summary: dict[str, Any]

    @property
    def report_file(self) -> Path:
        """Page to open."""
        return self.run_dir / "report.html"


def evaluate_captures(
    captures_dir: Path, workspace: Workspace, classifier: Classifier, config: EvalConfig = DEFAULT
) -> Evaluation:
    """Classify every image of a capture folder and write `eval/RUN`: predictions.csv, summary.json, report.html.

    Images that cannot be read are listed with the reason. Objects whose class the network does not have are left out
    with a note. If the folder holds another result, the new result is written beside it as RUN-2, unless
    `config.replace` is set.

    Args:
        captures_dir: `captures/`, a source in it, the folder of an object, or an ImageFolder.
        workspace: workspace with the object specs, which state the classes; `eval/` is in it.
        classifier: classifier from `load_classifier`.
        config: name of the run, and the images to evaluate.

    Raises:
        ToolkitError: there are no images, the network knows no object's class, a folder is no object, a manifest is
            broken, or the folder cannot be written.
    """
    findings, notes = judge_captures(captures_dir, workspace, classifier, config)
    # the run's name comes from clean sources: corrupted sources are derived from them
    clean = [prediction.capture.source for prediction in findings.predictions if prediction.capture.corruption is None]
    wanted = workspace.eval_dir / (config.run or name_run(classifier, clean))
    asked = describe_asked(captures_dir, workspace, config)
    return write_evaluation(wanted, classifier, findings, notes, config, asked=asked)


def judge_captures(
    captures_dir: Path, workspace: Workspace, classifier: Classifier, config: EvalConfig = DEFAULT
) -> tuple[Findings, tuple[str, ...]]:
    """Classify every image of a capture folder; return findings and notes. Raises as `evaluate_captures`."""
    folder, classes = read_labelled_captures(captures_dir, workspace, classifier, config)
    twins = TwinFinder()
    predictions = predict_captures(folder.captures, classes, classifier, config.batch_size, twins.look)
    # files that hold the same image count once
    predictions, found = twins.drop(predictions)
    kept = tuple(prediction.capture for prediction in predictions)
    folder = replace(folder, captures=kept, set_aside=(*folder.set_aside, *found))
    findings = compare_predictions(classifier.name, predictions, folder.refused_folders)
    # which boosters the network was trained with, and how the images came to be
    training = find_training(folder.captures, workspace, classifier.weights.sha256, hash_network_tensors(classifier))
    origin = find_origin(folder, findings.no_pairs, classifier, find_other_classes(folder, classes, classifier))
    labels = {name: classifier.labels[index] for name, index in classes.items()}
    notes = (*folder.notes, *describe_other_classes(training, labels))
    renderers = tuple(add_colours(agreement, workspace) for agreement in findings.renderers)
    return replace(findings, training=training, origin=origin, renderers=renderers), notes


ASKED = ("trust_files", "sources", "objects", "variants", "corruptions")


def describe_asked(captures_dir: Path, workspace: Workspace, config: EvalConfig) -> dict[str, Any]:
    """Return the request of an evaluation as `summary.json` keeps it: the folder, and the selected images."""
    folder, root = Path(captures_dir).resolve(), workspace.root.resolve()
    # relative to the workspace, so that it can be moved
    shown = folder.relative_to(root).as_posix() if folder.is_relative_to(root) else str(folder)
    return {"captures": shown, **config.model_dump(mode="json", include=set(ASKED))}


def name_run(classifier: Classifier | Detector, sources: Sequence[str]) -> str:
    """Return a name from network, weights and sources, such as `resnet18-imagenet-sim`."""
    # the name of the weights often repeats the network's
    weights = Path(classifier.weights.name).stem.removeprefix(classifier.arch).removeprefix(classifier.name)
    names = list(dict.fromkeys(sources))
    parts = [classifier.name, weights, "+".join(names) if len(names) <= MOST_SOURCES else f"{len(names)}-sources"]
    slugs = [re.sub(r"[^A-Za-z0-9._+-]+", "-", part).strip("-._+")[:LONGEST_PART].replace("+", "-") for part in parts]
    return "-".join(slug for slug in slugs if slug)


def write_evaluation(
    wanted: Path, classifier: Classifier, findings: Findings, notes: Sequence[str], config: EvalConfig = DEFAULT,
    kind: Kind = "eval", asked: dict[str, Any] | None = None,
) -> Evaluation:  # fmt: skip
    """Write findings into a folder, or beside another result in it; a `ToolkitError` if it cannot be written.

    Args:
        kind: kind of the experiment that the evaluation is a part of.
        asked: request that `toolkit verify` repeats; None if the result was not made from a capture folder.
    """
    # maps only for changed pairs: they are what a reader asks about
    maps = draw_saliency(findings.flips, classifier, config.saliency)
    why = [f"no saliency maps: {maps.reason}"] if config.saliency and maps.reason else []
    # two results are the same if their predictions are
    table = encode_predictions(findings.predictions)
    run_dir = find_run_dir(wanted, lacks_other_table(PREDICTIONS, table), config.replace)
    notes = (*classifier.notes, *notes, *why, *explain_pooling(findings.pairs), *explain_run_dir(wanted, run_dir))
    summary = write_run(run_dir, summarise(classifier, findings, notes, kind) | {"asked": asked}, {PREDICTIONS: table})
    done = Evaluation(**vars(findings), run_dir=run_dir, notes=notes, summary=summary)
    write_report(done.report_file, classifier, findings, notes, maps)
    return done


MAX_ROWS, MAX_CARDS = 400, 40
SIDE = 200.0
LEAST_PROB = 0.001
TICKS = ((0.001, "0.1"), (0.01, "1"), (0.1, "10"), (0.5, "50"), (0.9, "90"), (0.99, "99"), (0.999, "99.9"))


@dataclass(frozen=True)
class PosePoint:
    """A pair on the chart: place, y down; which images are correct (`both`, `neither`, `sim`, `real`); its words."""

    x: float
    y: float
    kind: str
    words: str


@dataclass(frozen=True)
class SimRealView:
    """A rendered source and a source of photographs in the report.

    Attributes:
        charts: by variant, the true class's probability in rig and photographs, a point for each pose.
    """

    found: SimReal
    rows: list[Comparison]
    forecasts: list[GainForecast]
    charts: dict[str, list[PosePoint]]
    cards: list[Card]


def view_sim_real(comparisons: Sequence[SimReal]) -> list[SimRealView]:
    """Return the report's view of each comparison; at most 40 wrong predictions, those that are furthest off."""
    views = []
    for found in comparisons:
        # variants in the order of the report
        charts: dict[str, list[PosePoint]] = {}
        for pair in sorted(found.pairs, key=lambda pair: rank_variant(place_of(pair)[1])):
            charts.setdefault(place_of(pair)[1], []).append(_make_point(pair))
        # the wrong predictions whose probability changed most
        furthest = {id(pair) for pair in sorted(found.wrong, key=lambda pair: -abs(pair.change))[:MAX_CARDS]}
        cards = []
        for pair in found.wrong:
            if id(pair) in furthest:
                title = "{} · {} · pose {}".format(*place_of(pair))
                cards.append(Card(title, describe_place(pair.second), (pair.first, pair.second)))
        rows, forecasts = pick_rows(found.rows, MAX_ROWS), pick_rows(found.forecasts, MAX_ROWS)
        views.append(SimRealView(found, rows, forecasts, charts, cards))
    return views


def place_prob(prob: float) -> float:
    """Return the place of a probability on an axis of length `SIDE`: log-odds, from 0.1 % to 99.9 %."""
    end = log((1 - LEAST_PROB) / LEAST_PROB)
    inside = min(1 - LEAST_PROB, max(LEAST_PROB, prob))
    return SIDE * (log(inside / (1 - inside)) + end) / (2 * end)


def _make_point(pair: Pair) -> PosePoint:
    name, _, pose_id = place_of(pair)
    kind = "sim" if pair.is_lost else "real" if pair.is_gained else "both" if pair.first.correct_top1 else "neither"
    sim, real = pair.first.true_prob or 0.0, pair.second.true_prob or 0.0
    words = f"{name}, pose {pose_id}: {100 * sim:.3g} % in the rig, {100 * real:.3g} % in the photograph"
    # SVG counts downwards
    return PosePoint(place_prob(sim), SIDE - place_prob(real), kind, words)


def write_report(
    path: Path, classifier: Classifier, findings: Findings, notes: Sequence[str], saliency: Saliency
) -> Path:
    """Write the report with embedded thumbnails; long contact sheets are thinned, with a note."""
    predictions = findings.predictions
    sheets, n_hidden = lay_out(predictions)
    flips = [(flip.kind, lay_out_flips(flip), flip.n, flip.counts) for flip in findings.flips]
    views = view_sim_real(findings.sim_real)
    # thumbnails of all images on the page
    decks = [*(sheet.cards for sheet in sheets), *(view.cards for view in views), *(cards for _, cards, _, _ in flips)]
    shown = [cell for cards in decks for card in cards for cell in card.cells]
    # tables of long results are cut, and the boosters whose control was shot are named
    found = findings.comparisons
    comparisons = [
        (source, pick_rows([row for row in found if row.source == source], MAX_ROWS))
        for source in dict.fromkeys(row.source for row in found)
    ]
    owners = {OWNERS.get(row.second) for row in found}
    heat = zip(HEAT_LEVELS, HEAT_COLOURS, strict=True)
    context = {
        **vars(findings), "classifier": classifier, "title": path.parent.name, "notes": notes,
        "tables": _build_tables(findings), "comparisons": comparisons,
        "compared": {row.second for row in found},
        "controlled": [noun for booster, noun in NOUNS.items() if booster in owners],
        "charts": chart_poses(predictions),
        "agreements": [
            (agreement, list_gains(agreement), list_answers(agreement), list_colours(agreement), list_flips(agreement))
            for agreement in findings.renderers
        ],
        "gain_heads": GAIN_HEADS, "answer_heads": ANSWER_HEADS,
        "sim_real": views, "side": SIDE, "ticks": [(place_prob(prob), label) for prob, label in TICKS],
        "sources": sorted({prediction.capture.source for prediction in predictions}),
        "objects": sorted({prediction.capture.object for prediction in predictions}),
        "sheets": sheets, "n_hidden": n_hidden, "open_sheets": MANY_SHEETS,
        "flips": flips, "max_flips": MAX_FLIPS, "saliency": saliency, 
        "heat_stops": ", ".join(f"rgb{colour} {100 * level:.0f}%" for level, colour in heat),
        "thumbnails": make_thumbnails((cell.capture for cell in shown if cell.is_read), classifier),
        "origin": findings.origin, "unseen": describe_unseen(classifier.name, findings.training),
        "corrupted": list_corrupted(prediction.capture for prediction in predictions),
        "gated": findings.gated, "gate_lines": findings.gate_lines, "gated_counts": count_gated(findings),
    }  # fmt: skip
    return write_page(path, "toolkit.evaluation", "report.html.j2", context)


def _build_tables(findings: Findings) -> list[dict[str, Any]]:
    found = []
    for source, n_objects, pairs in rows_by_source(findings.groups, findings.pairs, MAX_ROWS):
        rows = [
            (group, pair, mark_seen(findings.training, source, group.object, group.variant)) for group, pair in pairs
        ]
        is_cut = n_objects > len({group.object for group, _ in pairs})
        found.append({"source": source, "rows": rows, "n_objects": n_objects, "is_cut": is_cut})
    return found
