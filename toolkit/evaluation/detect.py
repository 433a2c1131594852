"""Evaluate a detector with and without the booster: boxes against the rig's truth, average precision, pairs."""

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
    pair_with_unpatched,
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
    """Detections of the true class in an image: falling scores (n,), and IoU (n,) of each with the object's box."""

    scores: np.ndarray
    ious: np.ndarray


def average_precision(images: Sequence[ScoredBoxes], iou: float) -> float | None:
    """Return mean precision at 101 levels of recall, as pycocotools counts it; None without images.

    The strongest detection with an IoU of at least `iou` is correct, all others are wrong.
    """
    if not images:
        return None
    scores, right = [], []
    for image in images:
        is_right = np.zeros(len(image.scores), bool)
        # the object goes to the strongest detection that fits; pycocotools' bound: an IoU of 1 by rounding still counts
        fits = np.flatnonzero(image.ious >= min(iou, 1 - 1e-10))
        if len(fits):
            is_right[fits[0]] = True
        scores.append(image.scores)
        right.append(is_right)
    # stable, as in pycocotools: equal scores keep their order
    order = np.argsort(-np.concatenate(scores), kind="mergesort")
    hits = np.cumsum(np.concatenate(right)[order])
    if not len(hits):
        return 0.0
    # a single object in each image, so recall is over images
    recall = hits / len(images)
    precision = hits / np.arange(1, len(hits) + 1)
    # precision at a recall is the best at that recall or above: the curve's envelope
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    # levels of recall that are never reached count as precision 0
    places = np.searchsorted(recall, RECALL_LEVELS, side="left")
    reached = places < len(precision)
    return float(np.where(reached, precision[np.minimum(places, len(precision) - 1)], 0).mean())


def mean_average_precision(images: Sequence[ScoredBoxes]) -> float | None:
    """Return the mean of `average_precision` over IoU 0.50, 0.55 … 0.95; None without images."""
    return float(np.mean([average_precision(images, iou) for iou in IOU_LEVELS])) if images else None


def recall_at(images: Sequence[ScoredBoxes]) -> float | None:
    """Return the share of images with a detection of the class, however weak, whose IoU is at least 0.5."""
    return float(np.mean([(image.ious >= FOUND_IOU).any() for image in images])) if images else None


@dataclass(frozen=True)
class DetectedImage:
    """Detections in an image. The object is found by a box of its class with score 0.25 and IoU 0.5 or more.

    Attributes:
        true_index, true_label: class of the object, in the detector's labels.
        truth: mask and box of the object.
        seen: the detections; None if the image was not read.
    """

    capture: Capture
    true_index: int
    true_label: str
    truth: ObjectMask
    seen: Detections | None
    status: str = "ok"

    @property
    def of_class(self) -> ScoredBoxes:
        """Detections of the true class."""
        if self.seen is None:
            return ScoredBoxes(np.zeros(0), np.zeros(0))
        kept = self.seen.classes == self.true_index
        return ScoredBoxes(self.seen.scores[kept], box_iou(self.seen.boxes[kept], np.array(self.truth.box)))

    @property
    def best(self) -> tuple[float, float, np.ndarray] | None:
        """Score, IoU and box of the strongest detection of the class with an IoU of at least 0.5; None without any."""
        own = self.of_class
        fitting = np.flatnonzero(own.ious >= FOUND_IOU)
        if self.seen is None or not len(fitting):
            return None
        # detections come by falling score: the first that fits is the strongest
        first = fitting[0]
        box = self.seen.boxes[self.seen.classes == self.true_index][first]
        return float(own.scores[first]), float(own.ious[first]), box

    @property
    def is_found(self) -> bool:
        """Whether the object is found."""
        return self.best is not None and self.best[0] >= FOUND_SCORE

    def as_prediction(self, labels: Sequence[str]) -> Prediction:
        """Return the image as pairs and `detections.csv` need it; `labels` are the detector's."""
        seen, best = self.seen, self.best
        score, iou, sides = best if best is not None else (None, None, None)
        box = None if sides is None else (float(sides[0]), float(sides[1]), float(sides[2]), float(sides[3]))
        strongest = (labels[seen.classes[0]], float(seen.scores[0])) if seen else (None, None)
        found = None if seen is None else self.is_found
        said = Detection(self.truth.box, found, score, iou, box, *strongest)
        return make_detected(self.capture, self.true_label, said, self.status)


@dataclass(frozen=True)
class DetectionGroup:
    """Results of an object and variant of a source; `object` is `all` for the pooled row.

    Attributes:
        n, failed: images that were read, and images that were not.
        n_found: images in which the object is found.
        recall50: see `recall_at`.
        ap50, ap50_95: average precision at IoU 0.5, and its mean over 0.5 to 0.95; pooled: mean over the classes.
        mean_score: mean score of the best detection, 0 if none fits.
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
        """Return the fields of `summary.json`."""
        keys = ("source", "object", "variant", "n", "failed", "found", "recall50", "ap50", "ap50_95", "mean_score")
        return {key: getattr(self, key) for key in keys} | {"found_ci95": list(self.found_ci95)}


@dataclass(frozen=True)
class DetectionRun:
    """Result of a detector's evaluation.

    Attributes:
        pairs: each variant against `unpatched`, and boosters against their controls: found or not found.
        left_out: (path, reason) of images without a known box, and images that could not be read.
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
    """Find the object in every image, and write `eval/RUN`: detections.csv, summary.json, report.html.

    The truth is the object's box by its mesh and the camera in the manifest; images without a box are left out and
    listed. Corruptions apply to the whole image, before it is resized for the network.

    Args:
        captures_dir: `captures/`, a source in it, or the folder of an object.
        config: name of the run, and the images to evaluate.

    Raises:
        ToolkitError: no image has a known box, the detector knows no object's class, or `eval/` cannot be written.
    """
    # images, classes and true boxes
    folder = read_captures(captures_dir, config.selection, trust_files=config.trust_files)
    folder = add_corrupted(folder, config.corruptions)
    classes, notes = _find_classes(folder.objects, workspace, detector)
    wanted = [capture for capture in folder.captures if capture.object in classes]
    # a corrupted image has the box of its source: boxes do not move
    clean = {item.file: item for item in wanted if item.corruption is None or item.cut_px is not None}
    masks, unknown = outline_captures(list(clean.values()), workspace)
    truths = {file: masks[capture.path] for file, capture in clean.items() if capture.path in masks}
    if not truths:
        why = f"{unknown[0][0]}: {unknown[0][1]}" if unknown else "no images"
        raise ToolkitError(f"{captures_dir}: no image with a known box: {why}: shoot with 'toolkit capture-sim'")
    # detections, pairs and groups
    images = detect_captures([capture for capture in wanted if capture.file in truths], truths, classes, detector)
    predictions = [image.as_prediction(detector.labels) for image in images]
    poses = index_poses(predictions)
    against_none = compare_unpatched(pair_with_unpatched(poses))
    pairs = (*against_none, *compare_controls(poses))
    groups = tuple(group_detections(images))
    failed = [(image.capture.path, image.status) for image in images if image.seen is None]
    # the run folder
    table = encode_detections(predictions)
    name = config.run or name_run(detector, [capture.source for capture in wanted if capture.corruption is None])
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
        "pairs": [comparison.as_pair() for comparison in against_none],
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
    """Return the class index of each object by its spec, and a note on each object whose class is unknown."""
    specs, classes, reasons = workspace.object_specs(), {}, []
    for name in objects:
        try:
            spelling = read_spec(specs[name]).class_name if name in specs else name
            # the class stands in the spec; without a spec the folder's name is the class
            classes[name] = detector_class(detector, spelling)
        except ToolkitError as error:
            reasons.append(f"'{name}' left out: {detector.name} does not know its class: {error}")
    if not classes:
        raise ToolkitError(f"{detector.name} knows none of the objects: {reasons[0] if reasons else 'there are none'}")
    return classes, tuple(reasons)


def detect_captures(
    captures: Sequence[Capture], truths: dict[Path, ObjectMask], classes: dict[str, int], detector: Detector
) -> list[DetectedImage]:
    """Find the object in each image, in the order of `captures`."""
    found: list[DetectedImage] = []
    # the next images are read, and corrupted at full size, while the network runs
    pictures = read_ahead(captures, None, BATCH)
    with progress("detecting", len(captures)) as ticker, closing(pictures):
        while part := list(islice(pictures, BATCH)):
            arrays = [pixels for _, pixels in part if not isinstance(pixels, str)]
            # images that were not read have no detections: the others take theirs in turn
            seen = iter(detector.detect(arrays) if arrays else [])
            for capture, pixels in part:
                index, truth = classes[capture.object], truths[capture.file]
                image = DetectedImage(capture, index, detector.labels[index], truth, None)
                if isinstance(pixels, str):
                    found.append(replace(image, status=pixels))
                elif pixels.shape[:2] != truth.mask.shape:
                    sides = "×".join(map(str, reversed(pixels.shape[:2])))
                    found.append(replace(image, status=f"is {sides}, which is not its camera's size"))
                    # skipped: boxes in images of another size cannot be compared
                    next(seen)
                else:
                    found.append(replace(image, seen=next(seen)))
            ticker.advance(len(part))
    return found


def group_detections(images: Sequence[DetectedImage]) -> list[DetectionGroup]:
    """Return results by source, object and variant, and pooled over the objects of a source with several objects."""
    members = group_images(images)
    # the pooled row of a single object would repeat it
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
    """Write the report, with at most 120 images; changed pairs come first."""
    poses: dict[tuple[str, str, int | None], list[DetectedImage]] = defaultdict(list)
    for image in run.images:
        poses[image.capture.source, image.capture.object, image.capture.pose_id].append(image)
    # poses whose object is found in one variant and not in another
    mixed = [some for some in poses.values() if len({image.is_found for image in some}) == 2]
    flipped = {image.capture.path for some in mixed for image in some}

    def rank(image: DetectedImage) -> tuple[object, ...]:
        # changed pairs first, then by source, object and pose
        shot = image.capture
        number = -1 if shot.pose_id is None else shot.pose_id
        return shot.path not in flipped, shot.source, shot.object, number, rank_variant(shot.variant)

    pairs = {(pair.source, pair.object, pair.second): pair for pair in run.pairs if pair.first == "unpatched"}
    # images, with the changed pairs first
    cards = [
        {"image": image, "picture": picture, "is_flipped": image.capture.path in flipped}
        for image in sorted(run.images, key=rank)[:MOST_PICTURES]
        if (picture := draw_boxes(image, detector)) is not None
    ]
    context = {
        "title": path.parent.name, "detector": detector, "groups": run.groups, "pairs": pairs,
        "comparisons": [pair for pair in run.pairs if pair.first != "unpatched"], "cards": cards,
        "n_hidden": max(0, len(run.images) - MOST_PICTURES), "left_out": run.left_out, "notes": run.notes,
        "found": run.summary["found"], "lines": describe_pairs(run), "origin": run.origin,
    }  # fmt: skip
    return write_page(path, "toolkit.evaluation", "detections.html.j2", context)


def describe_pairs(run: DetectionRun) -> list[str]:
    """Return the result of each source and variant in words."""
    lines = []
    for pair in _pool(run.pairs):
        found = pair.outcomes
        sure = "" if found.mcnemar_p < 0.05 else ", no significant change"
        lines.append(
            f"{pair.source}: {pair.second} found in {found.n_second} of {found.n} poses, {pair.first} in "
            f"{found.n_first}: {found.only_second} gained, {found.only_first} lost (p = {found.mcnemar_p:.2g}{sure})"
        )
    return lines


def _pool(pairs: Sequence[Comparison]) -> list[Comparison]:
    """Return a comparison for each source and two variants: the pooled one if there are several objects."""
    pooled = {pair.source for pair in pairs if pair.object == POOLED}
    return [pair for pair in pairs if (pair.object == POOLED) == (pair.source in pooled)]


def describe_lost(network: str, pairs: Sequence[Comparison], training: Sequence[Training]) -> list[str]:
    """Warn of each booster of other networks with which a detector finds the object in fewer images."""
    of_others = {(booster.source, booster.variant) for booster in training if booster.networks and not booster.seen}
    return [
        f"{pair.source}: with {name_booster(pair.second)} {network} finds the object in {pair.outcomes.n_second} of "
        f"{pair.outcomes.n} images, without it in {pair.outcomes.n_first}; the booster was trained on other networks. "
        "Train it on this detector too: name both with --model"
        for pair in pairs
        if pair.first == UNPATCHED and (pair.source, pair.second) in of_others
        and pair.outcomes.n_second < pair.outcomes.n_first
    ]  # fmt: skip


def draw_boxes(found: DetectedImage, detector: Detector) -> str | None:
    """Return a JPEG `data:` URI: the truth white, boxes of its class green, others orange; None if not readable."""
    pixels = "not read" if found.seen is None else read_pixels(found.capture, None)
    if isinstance(pixels, str) or found.seen is None:
        return None
    image = Image.fromarray(np.ascontiguousarray(pixels))
    ImageDraw.Draw(image).rectangle(found.truth.box, outline=TRUTH_COLOUR, width=_line_px(image))
    pen_boxes(image, found.seen, detector.labels, found.true_index)
    return encode_jpeg(image)


def pen_boxes(image: Image.Image, seen: Detections, labels: Sequence[str], true_index: int | None = None) -> None:
    """Draw boxes and names into an image, green for the true class and orange for others."""
    pen, width = ImageDraw.Draw(image), _line_px(image)
    # the strongest on top
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
