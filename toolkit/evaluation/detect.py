"""Does a detector find the object, with the booster and without? Boxes against the rig's truth; average precision."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from toolkit.captures.capture import UNPATCHED, Capture
from toolkit.captures.read import POOLED, read_captures
from toolkit.captures.truth import ObjectMask, outline_captures
from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.statistics import Interval, wilson_interval
from toolkit.core.workspace import Workspace
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.contact_sheet import encode_jpeg
from toolkit.evaluation.evaluate import DEFAULT, name_run
from toolkit.evaluation.ground_truth import add_corrupted
from toolkit.evaluation.metrics import (
    Comparison,
    RowKey,
    compare_controls,
    compare_unpatched,
    count_no_pairs,
    explain_pooling,
    group_images,
    index_poses,
    name_booster,
    rank_variant,
)
from toolkit.evaluation.origin import Origin, find_origin
from toolkit.evaluation.page import write_page
from toolkit.evaluation.prediction import Detection, Prediction
from toolkit.evaluation.predictions_csv import encode_detections, make_detected
from toolkit.evaluation.read_pixels import read_ahead, read_pixels
from toolkit.evaluation.results import Training, describe_unseen, find_training, list_corrupted
from toolkit.evaluation.run_files import DETECTIONS, explain_run_dir, find_run_dir, lacks_other_table, write_run
from toolkit.evaluation.summaries import begin_summary
from toolkit.models.detector import Detections, Detector, box_iou, detector_class
from toolkit.models.identity import hash_network_tensors
from toolkit.objects.spec import read_spec

IOU_LEVELS = np.linspace(0.5, 0.95, 10)
RECALL_LEVELS = np.linspace(0, 1, 101)
FOUND_IOU, FOUND_SCORE = 0.5, 0.25
BATCH = 8
MOST_PICTURES = 120
TRUTH_COLOUR, RIGHT_COLOUR, WRONG_COLOUR = "#ffffff", "#00b487", "#ff7a33"
LEAST_SHOWN = 0.25


@dataclass(frozen=True)
class ScoredBoxes:
    """The detections of the true class in one image.

    Attributes:
        scores: (n,) by falling score.
        ious: (n,) overlap of each with the object's box.
    """

    scores: np.ndarray
    ious: np.ndarray


def average_precision(images: Sequence[ScoredBoxes], iou: float) -> float | None:
    """Mean precision at 101 levels of recall, as pycocotools counts it; None without images.

    A detection is right where it overlaps the object by `iou` at least, and no stronger one was; the others are
    wrong.
    """
    if not images:
        return None
    scores, right = [], []
    for image in images:
        is_right = np.zeros(len(image.scores), bool)
        # of the stronger first; the object goes to the first that fits
        # pycocotools' bound: an IoU of 1 by rounding still counts
        fits = np.flatnonzero(image.ious >= min(iou, 1 - 1e-10))
        if len(fits):
            is_right[fits[0]] = True
        scores.append(image.scores)
        right.append(is_right)
    # stable, as in pycocotools: of equal scores the one that came first stays first
    order = np.argsort(-np.concatenate(scores), kind="mergesort")
    hits = np.cumsum(np.concatenate(right)[order])
    if not len(hits):
        return 0.0
    # one object in each image, so that recall is over images
    recall = hits / len(images)
    precision = hits / np.arange(1, len(hits) + 1)
    # precision at a recall is the best at that recall or above: the curve's envelope
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    # levels of recall that are never reached count as precision 0
    places = np.searchsorted(recall, RECALL_LEVELS, side="left")
    reached = places < len(precision)
    return float(np.where(reached, precision[np.minimum(places, len(precision) - 1)], 0).mean())


def mean_average_precision(images: Sequence[ScoredBoxes]) -> float | None:
    """Mean of `average_precision` over IoU 0.50, 0.55 … 0.95."""
    found = [average_precision(images, iou) for iou in IOU_LEVELS]
    return None if not images else float(np.mean([one for one in found if one is not None]))


def recall_at(images: Sequence[ScoredBoxes]) -> float | None:
    """Share of the images where some detection of the class overlaps the object by half, however weak."""
    return None if not images else float(np.mean([bool((image.ious >= FOUND_IOU).any()) for image in images]))


@dataclass(frozen=True)
class DetectedImage:
    """What a detector said of one image; found: a box of the true class of score 0.25 that overlaps by half.

    Attributes:
        capture: the image.
        true_index, true_label: what it shows, in the detector's labels.
        truth: where that is.
        seen: the detections; None where the image was not read.
        status: `ok`, or why it was not read.
    """

    capture: Capture
    true_index: int
    true_label: str
    truth: ObjectMask
    seen: Detections | None
    status: str = "ok"

    @property
    def of_class(self) -> ScoredBoxes:
        """The detections of the true class."""
        if self.seen is None:
            return ScoredBoxes(np.zeros(0), np.zeros(0))
        kept = self.seen.classes == self.true_index
        return ScoredBoxes(self.seen.scores[kept], box_iou(self.seen.boxes[kept], np.array(self.truth.box)))

    @property
    def best(self) -> tuple[float, float, np.ndarray] | None:
        """Score, overlap and box of the strongest detection of the class that overlaps by half; None: there is none."""
        if self.seen is None:
            return None
        kept = np.flatnonzero(self.seen.classes == self.true_index)
        ious = box_iou(self.seen.boxes[kept], np.array(self.truth.box))
        fitting = np.flatnonzero(ious >= FOUND_IOU)
        if not len(fitting):
            return None
        # detections come by falling score: the first that fits is the strongest
        return float(self.seen.scores[kept[fitting[0]]]), float(ious[fitting[0]]), self.seen.boxes[kept[fitting[0]]]

    @property
    def is_found(self) -> bool:
        """Whether the object is found."""
        return self.best is not None and self.best[0] >= FOUND_SCORE

    def as_prediction(self, labels: Sequence[str]) -> Prediction:
        """As pairs and `detections.csv` take it; `labels` are the detector's."""
        seen, best = self.seen, self.best
        score, iou, sides = best if best is not None else (None, None, None)
        box = None if sides is None else (float(sides[0]), float(sides[1]), float(sides[2]), float(sides[3]))
        strongest = (labels[seen.classes[0]], float(seen.scores[0])) if seen else (None, None)
        found = None if seen is None else self.is_found
        said = Detection(self.truth.box, found, score, iou, box, *strongest)
        return make_detected(self.capture, self.true_label, said, self.status)


@dataclass(frozen=True)
class DetectionGroup:
    """Results of one object and variant of one source; `object` is `all` for the pooled row.

    Attributes:
        n, failed: images looked at, and images that could not be read.
        n_found: in how many the object is found.
        recall50: share with any detection of the class that overlaps by half, however weak.
        ap50, ap50_95: average precision at IoU 0.5, and its mean over 0.5 to 0.95; pooled: mean over the classes.
        mean_score: of the detection that fits, 0 where none does.
    """

    source: str
    object: str
    variant: str
    n: int
    failed: int
    n_found: int
    recall50: float | None
    ap50: float | None
    ap50_95: float | None
    mean_score: float | None

    @property
    def found(self) -> float | None:
        """Share of images in which the object is found."""
        return self.n_found / self.n if self.n else None

    @property
    def found_ci95(self) -> Interval:
        """Wilson interval of `found`."""
        return wilson_interval(self.n_found, self.n)

    def as_json(self) -> dict[str, Any]:
        """The fields of `summary.json`."""
        keys = ("source", "object", "variant", "n", "failed", "found", "recall50", "ap50", "ap50_95", "mean_score")
        return {key: getattr(self, key) for key in keys} | {"found_ci95": list(self.found_ci95)}


@dataclass(frozen=True)
class DetectionRun:
    """What a detector's evaluation found, and where it is written.

    Attributes:
        images: one for each capture.
        groups: by source, object and variant.
        pairs: each variant against `unpatched`, and boosters against their controls: found or not found.
        left_out: (path, reason) of images without a known box, or that could not be read.
        notes: what else the reader should know.
        run_dir: the folder `eval/RUN`.
        summary: what `summary.json` holds.
        origin: what the result rests on.
    """

    images: tuple[DetectedImage, ...]
    groups: tuple[DetectionGroup, ...]
    pairs: tuple[Comparison, ...]
    left_out: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    run_dir: Path
    summary: dict[str, Any]
    origin: Origin


def evaluate_detector(
    captures_dir: Path, workspace: Workspace, detector: Detector, config: EvalConfig = DEFAULT
) -> DetectionRun:
    """Look for the object in every image and write `eval/RUN`: detections.csv, summary.json, report.html.

    The truth is the box round the object, by its mesh and the camera of the manifest; an image without one is left out
    and listed. With corruptions the whole image is corrupted, before it is fitted to the network.

    Args:
        captures_dir: `captures/`, one of its sources, or one object's folder.
        workspace: whose object specs say what each object is and looks like.
        detector: from `load_detector`.
        config: the name of the run, and what is evaluated.

    Raises:
        ToolkitError: no image with a known box, no object whose class the detector knows, or `eval/` cannot be
            written.
    """
    folder = read_captures(captures_dir, config.selection, trust_files=config.trust_files)
    folder = add_corrupted(folder, config.corruptions)
    classes, notes = _find_classes(folder.objects, workspace, detector)
    wanted = [capture for capture in folder.captures if capture.object in classes]
    # the truth of a corrupted picture is that of the one it was made from: boxes do not move
    clean = {one.file: one for one in wanted if one.corruption is None or one.cut_px is not None}
    masks, unknown = outline_captures(list(clean.values()), workspace)
    truths = {file: masks[prediction.path] for file, prediction in clean.items() if prediction.path in masks}
    if not truths:
        why = f"{unknown[0][0]}: {unknown[0][1]}" if unknown else "no images"
        raise ToolkitError(f"{captures_dir}: no image with a known box: {why}: shoot with 'toolkit capture-sim'")
    images = detect_captures([one for one in wanted if one.file in truths], truths, classes, detector)
    predictions = [image.as_prediction(detector.labels) for image in images]
    poses = index_poses(predictions)
    pairs = (*compare_unpatched(poses), *compare_controls(poses))
    groups = tuple(group_detections(images))
    failed = [(image.capture.path, image.status) for image in images if image.seen is None]
    table = encode_detections(predictions)
    name = config.run or name_run(detector, [one.source for one in wanted if one.corruption is None])
    wanted_dir = workspace.eval_dir / name
    run_dir = find_run_dir(wanted_dir, lacks_other_table(DETECTIONS, table), config.replace)
    training = find_training(wanted, workspace, detector.weights.sha256, hash_network_tensors(detector))
    notes = (*folder.notes, *notes, *describe_unseen(detector.name, training))
    notes = (*notes, *describe_lost(detector.name, _pool(pairs), training), *explain_pooling(pairs))
    notes = (*notes, *explain_run_dir(wanted_dir, run_dir))
    origin = find_origin(folder, count_no_pairs(poses), detector)
    summary = {
        **begin_summary("detections", detector), "rests_on": origin.as_json(),
        "found": {"iou": FOUND_IOU, "score": FOUND_SCORE},
        "groups": [group.as_json() for group in groups],
        "pairs": [comparison.as_pair() for comparison in compare_unpatched(poses)],
        "boosters": [booster.as_json() for booster in training],
        "corrupted": list_corrupted(image.capture for image in images), "notes": list(notes),
    }  # fmt: skip
    summary = write_run(run_dir, summary, {DETECTIONS: table})
    run = DetectionRun(
        tuple(images), groups, pairs, notes=notes, run_dir=run_dir, summary=summary, origin=origin,
        left_out=(*failed, *unknown, *folder.refused_folders, *origin.faults),
    )  # fmt: skip
    write_detection_report(run_dir / "report.html", run, detector)
    return run


def _find_classes(
    objects: Sequence[str], workspace: Workspace, detector: Detector
) -> tuple[dict[str, int], tuple[str, ...]]:
    """Class index of each object by its spec, and a note on each whose class the detector does not have.

    Raises:
        ToolkitError: it has the class of none.
    """
    specs, classes, reasons = workspace.object_specs(), {}, []
    for name in objects:
        try:
            spelling = read_spec(specs[name]).class_name if name in specs else name
            classes[name] = detector_class(detector, spelling)
        except ToolkitError as error:
            reasons.append(f"'{name}' left out, {detector.name} does not know its class: {error}")
    if not classes:
        raise ToolkitError(f"{detector.name} knows none of the objects: {reasons[0] if reasons else 'there are none'}")
    return classes, tuple(reasons)


def detect_captures(
    captures: Sequence[Capture], truths: dict[Path, ObjectMask], classes: dict[str, int], detector: Detector
) -> list[DetectedImage]:
    """Look for the object in each image, in the order of `captures`.

    Args:
        captures: whose files all have a truth.
        truths: by file.
        classes: index of each object, in the detector's labels.
        detector: who looks.
    """
    found: list[DetectedImage] = []
    # the next images are read while the network looks at these: both release the interpreter's lock
    # and corrupted as they were taken, before the detector resizes them
    pictures = read_ahead(captures, None, BATCH)
    with progress("detecting", len(captures)) as ticker, closing(pictures):
        while part := list(islice(pictures, BATCH)):
            pixels = [one for _, one in part if not isinstance(one, str)]
            # images that were not read have no answer: the others take theirs in turn
            seen = iter(detector.detect(pixels) if pixels else [])
            for capture, one in part:
                index, truth = classes[capture.object], truths[capture.file]
                image = DetectedImage(capture, index, detector.labels[index], truth, None)
                if isinstance(one, str):
                    found.append(replace(image, status=one))
                elif one.shape[:2] != truth.mask.shape:
                    sides = "×".join(map(str, reversed(one.shape[:2])))
                    found.append(replace(image, status=f"is {sides}, which is not its camera's size"))
                    # its answer is passed over: boxes in pictures of another size cannot be compared
                    next(seen)
                else:
                    found.append(replace(image, seen=next(seen)))
            ticker.advance(len(part))
    return found


def group_detections(images: Sequence[DetectedImage]) -> list[DetectionGroup]:
    """Results by source, object and variant, and pooled over the objects of a source where there are several."""
    members = group_images(images)
    # of one object the pooled row says nothing new
    n_objects = Counter(source for source, name in {key[:2] for key in members} if name != POOLED)
    return [_count(key, some) for key, some in members.items() if key[1] != POOLED or n_objects[key[0]] > 1]


def _count(key: RowKey, members: Sequence[DetectedImage]) -> DetectionGroup:
    read = [member for member in members if member.seen is not None]
    by_class: dict[int, list[ScoredBoxes]] = defaultdict(list)
    for prediction in read:
        by_class[prediction.true_index].append(prediction.of_class)
    # the mean over classes, as COCO has it
    ap50 = [average_precision(some, 0.5) or 0.0 for some in by_class.values()]
    ap = [mean_average_precision(some) or 0.0 for some in by_class.values()]
    # an object that is not found counts with score 0: leaving it out would reward missing it
    scores = [prediction.best[0] if prediction.best else 0.0 for prediction in read]
    return DetectionGroup(
        *key, n=len(read), failed=len(members) - len(read), n_found=sum(prediction.is_found for prediction in read),
        recall50=recall_at([prediction.of_class for prediction in read]), ap50=float(np.mean(ap50)) if ap50 else None,
        ap50_95=float(np.mean(ap)) if ap else None, mean_score=float(np.mean(scores)) if scores else None,
    )  # fmt: skip


def write_detection_report(path: Path, run: DetectionRun, detector: Detector) -> Path:
    """One self-contained page; of many images the pairs that flipped come first, and some are left out."""
    flipped = _find_flipped(run.images)

    def place(one: DetectedImage) -> tuple[object, ...]:
        shot = one.capture
        number = -1 if shot.pose_id is None else shot.pose_id
        return shot.path not in flipped, shot.source, shot.object, number, rank_variant(shot.variant)

    order = sorted(run.images, key=place)
    pairs = {(pair.source, pair.object, pair.second): pair for pair in run.pairs if pair.first == "unpatched"}
    cards = [
        {"image": one, "picture": picture, "is_flipped": one.capture.path in flipped}
        for one in order[:MOST_PICTURES]
        if (picture := draw_boxes(one, detector)) is not None
    ]
    context = {
        "title": path.parent.name, "detector": detector, "groups": run.groups, "pairs": pairs,
        "comparisons": [pair for pair in run.pairs if pair.first != "unpatched"], "cards": cards,
        "n_hidden": max(0, len(run.images) - MOST_PICTURES), "left_out": run.left_out, "notes": run.notes,
        "found": run.summary["found"], "lines": describe_pairs(run), "origin": run.origin,
    }  # fmt: skip
    return write_page(path, "toolkit.evaluation", "detections.html.j2", context)


def describe_pairs(run: DetectionRun) -> list[str]:
    """The result of each source and variant in words."""
    lines = []
    for pair in _pool(run.pairs):
        found = pair.outcomes
        sure = "" if found.mcnemar_p < 0.05 else ", which chance explains too"
        lines.append(
            f"{pair.source}: {pair.second} found in {found.n_second} of {found.n} poses, {pair.first} in "
            f"{found.n_first}: {found.only_second} gained, {found.only_first} lost (p = {found.mcnemar_p:.2g}{sure})"
        )
    return lines


def _pool(pairs: Sequence[Comparison]) -> list[Comparison]:
    """A comparison for each source and two variants: the pooled one if there are several objects."""
    pooled = {pair.source for pair in pairs if pair.object == POOLED}
    return [pair for pair in pairs if (pair.object == POOLED) == (pair.source in pooled)]


def describe_lost(network: str, pairs: Sequence[Comparison], training: Sequence[Training]) -> list[str]:
    """A warning for each booster of other networks with which a detector finds the object in fewer images."""
    of_others = {(booster.source, booster.variant) for booster in training if booster.networks and not booster.seen}
    return [
        f"{pair.source}: with {name_booster(pair.second)} {network} finds the object in {pair.outcomes.n_second} of "
        f"{pair.outcomes.n} images, without it in {pair.outcomes.n_first}; the booster was trained on other networks. "
        "Train it on this detector too: name both with --model"
        for pair in pairs
        if pair.first == UNPATCHED and (pair.source, pair.second) in of_others
        and pair.outcomes.n_second < pair.outcomes.n_first
    ]  # fmt: skip


def _find_flipped(images: Sequence[DetectedImage]) -> set[str]:
    """Paths of the images of a pose that is found in one variant and not in another."""
    poses: dict[tuple[str, str, int | None], list[DetectedImage]] = {}
    for image in images:
        poses.setdefault((image.capture.source, image.capture.object, image.capture.pose_id), []).append(image)
    mixed = [some for some in poses.values() if len({one.is_found for one in some}) == 2]
    return {one.capture.path for some in mixed for one in some}


def draw_boxes(one: DetectedImage, detector: Detector) -> str | None:
    """A JPEG `data:` URI: the truth white, boxes of its class green, others orange; None where it cannot be read."""
    if one.seen is None:
        return None
    pixels = read_pixels(one.capture, None)
    if isinstance(pixels, str):
        return None
    image = Image.fromarray(np.ascontiguousarray(pixels))
    ImageDraw.Draw(image).rectangle(one.truth.box, outline=TRUTH_COLOUR, width=_line_px(image))
    pen_boxes(image, one.seen, detector.labels, one.true_index)
    return encode_jpeg(image)


def pen_boxes(image: Image.Image, seen: Detections, labels: Sequence[str], true_index: int | None = None) -> None:
    """Draw boxes and names into an image: those of the true class green, others orange."""
    pen, width = ImageDraw.Draw(image), _line_px(image)
    # the strongest last, on top of the others
    for box, index, score in list(zip(seen.boxes, seen.classes, seen.scores, strict=True))[::-1]:
        if score >= LEAST_SHOWN:
            colour = RIGHT_COLOUR if index == true_index else WRONG_COLOUR
            pen.rectangle([float(side) for side in box], outline=colour, width=width)
            words = f"{labels[index]} {score:.2f}"
            place = float(box[0]) + width, max(0.0, float(box[1]) + width)
            size = max(12, image.size[0] // 22)
            pen.rectangle(pen.textbbox(place, words, font_size=size), fill="#14171b")
            pen.text(place, words, fill=colour, font_size=size)


def _line_px(image: Image.Image) -> int:
    return max(2, round(max(image.size) / 120))
