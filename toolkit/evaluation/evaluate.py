"""From a capture folder to a run folder: read, predict, compare, and write; `report.html` opens with no network."""

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
    """What an evaluation found, and where it is written.

    Attributes:
        run_dir: the folder `eval/RUN`.
        notes: what else the reader should know.
        summary: what `summary.json` holds.
    """

    run_dir: Path
    notes: tuple[str, ...]
    summary: dict[str, Any]

    @property
    def report_file(self) -> Path:
        """The page to open."""
        return self.run_dir / "report.html"


def evaluate_captures(
    captures_dir: Path, workspace: Workspace, classifier: Classifier, config: EvalConfig = DEFAULT
) -> Evaluation:
    """Classify every image of a capture folder and write `eval/RUN`: predictions.csv, summary.json, report.html.

    An image that cannot be read is listed with its reason, and the others are evaluated. Where a folder of that name
    holds another result, this one goes beside it as RUN-2, unless it shall be replaced. An object whose spec names a
    class that the network does not have is left out with a note.

    Args:
        captures_dir: `captures/`, one of its sources, one object's folder, or an ImageFolder.
        workspace: whose object specs say what each object is, and whose `eval/` is written to.
        classifier: from `load_classifier`.
        config: the name of the run, by default after network, weights and sources, and what is evaluated.

    Raises:
        ToolkitError: no images, no object whose class the network knows, a folder that is no object, a broken manifest,
            or a folder that cannot be written.
    """
    findings, notes = judge_captures(captures_dir, workspace, classifier, config)
    clean = [prediction.capture.source for prediction in findings.predictions if prediction.capture.corruption is None]
    wanted = workspace.eval_dir / (config.run or name_run(classifier, clean))
    asked = describe_asked(captures_dir, workspace, config)
    return write_evaluation(wanted, classifier, findings, notes, config, asked=asked)


def judge_captures(
    captures_dir: Path, workspace: Workspace, classifier: Classifier, config: EvalConfig = DEFAULT
) -> tuple[Findings, tuple[str, ...]]:
    """Classify every image of a capture folder, and write nothing.

    Returns:
        What was found, and notes for the reader.

    Raises:
        ToolkitError: as `evaluate_captures`.
    """
    folder, classes = read_labelled_captures(captures_dir, workspace, classifier, config)
    twins = TwinFinder()
    predictions = predict_captures(folder.captures, classes, classifier, config.batch_size, twins.look)
    predictions, found = twins.drop(predictions)
    folder = replace(
        folder, captures=tuple(prediction.capture for prediction in predictions), set_aside=(*folder.set_aside, *found)
    )
    findings = compare_predictions(classifier.name, predictions, folder.refused_folders)
    training = find_training(folder.captures, workspace, classifier.weights.sha256, hash_network_tensors(classifier))
    origin = find_origin(folder, findings.no_pairs, classifier, find_other_classes(folder, classes, classifier))
    labels = {one: classifier.labels[index] for one, index in classes.items()}
    notes = (*folder.notes, *describe_other_classes(training, labels))
    renderers = tuple(add_colours(agreement, workspace) for agreement in findings.renderers)
    return replace(findings, training=training, origin=origin, renderers=renderers), notes


ASKED = ("trust_files", "sources", "objects", "variants", "corruptions")


def describe_asked(captures_dir: Path, workspace: Workspace, config: EvalConfig) -> dict[str, Any]:
    """What an evaluation was asked, as `summary.json` keeps it: the folder, and what of it was meant."""
    folder, root = Path(captures_dir).resolve(), workspace.root.resolve()
    # below the workspace by its place there, so that a workspace can be moved
    shown = folder.relative_to(root).as_posix() if folder.is_relative_to(root) else str(folder)
    return {"captures": shown, **config.model_dump(mode="json", include=set(ASKED))}


def name_run(classifier: Classifier | Detector, sources: Sequence[str]) -> str:
    """Network, weights and sources, such as `resnet18-imagenet-sim`; more than three sources are counted."""
    # weights are mostly called after their network, whose name stands before them already
    weights = Path(classifier.weights.name).stem.removeprefix(classifier.arch).removeprefix(classifier.name)
    names = list(dict.fromkeys(sources))
    parts = [classifier.name, weights, "+".join(names) if len(names) <= MOST_SOURCES else f"{len(names)}-sources"]
    slugs = [re.sub(r"[^A-Za-z0-9._+-]+", "-", part).strip("-._+")[:LONGEST_PART].replace("+", "-") for part in parts]
    return "-".join(slug for slug in slugs if slug)


def write_evaluation(
    wanted: Path, classifier: Classifier, findings: Findings, notes: Sequence[str], config: EvalConfig = DEFAULT,
    kind: Kind = "eval", asked: dict[str, Any] | None = None,
) -> Evaluation:  # fmt: skip
    """Write what was found into the folder that is wanted, or beside another result that it holds.

    Args:
        wanted: the folder of the run.
        classifier: who was asked.
        findings: see `compare_predictions`.
        notes: what else the reader should know.
        config: see `evaluate_captures`.
        kind: of the experiment that the evaluation is a part of.
        asked: what `toolkit verify` needs to make the result again; None if it was not made from a capture folder.

    Raises:
        ToolkitError: the folder cannot be written.
    """
    maps = draw_saliency(findings.flips, classifier, config.saliency)
    why = [f"no saliency maps: {maps.reason}"] if config.saliency and maps.reason else []
    # predictions decide whether it is the same result: all else follows from them
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
    """One pair: its place on the chart, y down; what is right, `both`, `neither`, `sim` or `real`; and its words."""

    x: float
    y: float
    kind: str
    words: str


@dataclass(frozen=True)
class SimRealView:
    """One pair of sources in the report.

    Attributes:
        found: what was found.
        rows, forecasts: those that are shown.
        charts: by variant, the true class's probability in the rig and in photographs, one point per pose.
        cards: of the wrongly predicted.
    """

    found: SimReal
    rows: list[Comparison]
    forecasts: list[GainForecast]
    charts: dict[str, list[PosePoint]]
    cards: list[Card]


def view_sim_real(comparisons: Sequence[SimReal]) -> list[SimRealView]:
    """What the report shows of each pair of sources; of many wrong predictions those that are furthest off."""
    views = []
    for comparison in comparisons:
        variants = sorted({place_of(pair)[1] for pair in comparison.pairs}, key=rank_variant)
        charts = {
            name: [_make_point(pair) for pair in comparison.pairs if place_of(pair)[1] == name] for name in variants
        }
        cards = [_make_card(pair) for pair in _pick_furthest(comparison.wrong)]
        views.append(
            SimRealView(
                comparison,
                pick_rows(comparison.rows, MAX_ROWS),
                pick_rows(comparison.forecasts, MAX_ROWS),
                charts,
                cards,
            )
        )
    return views


def place_prob(prob: float) -> float:
    """Where a probability lies on an axis of length `SIDE`: log-odds, from 0.1 % to 99.9 %."""
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


def _pick_furthest(wrong: Sequence[Pair]) -> list[Pair]:
    kept = {id(pair) for pair in sorted(wrong, key=lambda pair: -abs(pair.change))[:MAX_CARDS]}
    return [pair for pair in wrong if id(pair) in kept]


def _make_card(pair: Pair) -> Card:
    name, variant, pose_id = place_of(pair)
    return Card(f"{name} · {variant} · pose {pose_id}", describe_place(pair.second), (pair.first, pair.second))


def write_report(
    path: Path, classifier: Classifier, findings: Findings, notes: Sequence[str], saliency: Saliency
) -> Path:
    """Write the report; thumbnails are embedded, long contact sheets thinned, and the report says so."""
    predictions = findings.predictions
    sheets, n_hidden = lay_out(predictions)
    flips = [(flip.kind, lay_out_flips(flip), flip.n, flip.counts) for flip in findings.flips]
    views = view_sim_real(findings.sim_real)
    decks = [*(sheet.cards for sheet in sheets), *(view.cards for view in views), *(cards for _, cards, _, _ in flips)]
    shown = [cell for cards in decks for card in cards for cell in card.cells]
    context = {
        **vars(findings), "classifier": classifier, "title": path.parent.name, "notes": notes,
        "tables": _build_tables(findings), "comparisons": _build_comparisons(findings.comparisons),
        "compared": {row.second for row in findings.comparisons},
        "controlled": _name_controlled(findings.comparisons), "charts": chart_poses(predictions),
        "agreements": [
            (found, list_gains(found), list_answers(found), list_colours(found), list_flips(found))
            for found in findings.renderers
        ],
        "gain_heads": GAIN_HEADS, "answer_heads": ANSWER_HEADS,
        "sim_real": views, "side": SIDE, "ticks": [(place_prob(prob), label) for prob, label in TICKS],
        "sources": sorted({prediction.capture.source for prediction in predictions}),
        "sheets": sheets, "n_hidden": n_hidden, "open_sheets": MANY_SHEETS,
        "flips": flips, "max_flips": MAX_FLIPS, "saliency": saliency, "heat_stops": _list_heat_stops(),
        "thumbnails": make_thumbnails((one.capture for one in shown if one.is_read), classifier),
        "origin": findings.origin, "unseen": describe_unseen(classifier.name, findings.training),
        "corrupted": list_corrupted(prediction.capture for prediction in predictions),
        "gated": findings.gated, "gate_lines": findings.gate_lines, "gated_counts": count_gated(findings),
    }  # fmt: skip
    return write_page(path, "toolkit.evaluation", "report.html.j2", context)


def _list_heat_stops() -> str:
    """The colours of saliency maps as stops of a CSS gradient."""
    stops = zip(HEAT_LEVELS, HEAT_COLOURS, strict=True)
    return ", ".join(f"rgb{colour} {100 * level:.0f}%" for level, colour in stops)


def _build_tables(findings: Findings) -> list[dict[str, Any]]:
    found = []
    for source, n_objects, pairs in rows_by_source(findings.groups, findings.pairs, MAX_ROWS):
        rows = [(one, pair, mark_seen(findings.training, source, one.object, one.variant)) for one, pair in pairs]
        is_cut = n_objects > len({one.object for one, _ in pairs})
        found.append({"source": source, "rows": rows, "n_objects": n_objects, "is_cut": is_cut})
    return found


def _build_comparisons(comparisons: Sequence[Comparison]) -> list[tuple[str, list[Comparison]]]:
    """(source, rows)."""
    sources = dict.fromkeys(row.source for row in comparisons)
    return [(source, pick_rows([row for row in comparisons if row.source == source], MAX_ROWS)) for source in sources]


def _name_controlled(comparisons: Sequence[Comparison]) -> list[str]:
    """`patch`, `texture` or both: the boosters of which a control was shot."""
    owners = {OWNERS.get(row.second) for row in comparisons}
    return [noun for booster, noun in NOUNS.items() if booster in owners]
