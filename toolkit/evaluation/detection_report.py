"""The page of a detector's evaluation: the table, and the images with their boxes."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw

from toolkit.evaluation.contact_sheet import encode_jpeg
from toolkit.evaluation.metrics import rank_variant
from toolkit.evaluation.page import write_page
from toolkit.imaging.read import UnreadableImage, read_image
from toolkit.models.detector import Detector

if TYPE_CHECKING:
    from toolkit.evaluation.detect import DetectedImage, DetectionRun

MOST_PICTURES = 120
TRUTH_COLOUR, RIGHT_COLOUR, WRONG_COLOUR = "#ffffff", "#00b487", "#ff7a33"
LEAST_SHOWN = 0.25


def write_detection_report(path: Path, run: "DetectionRun", detector: Detector) -> Path:
    """One self-contained page; of many images the pairs that flipped come first, and some are left out."""
    flipped = _find_flipped(run.images)

    def place(one: "DetectedImage") -> tuple[object, ...]:
        shot = one.capture
        number = -1 if shot.pose_id is None else shot.pose_id
        return shot.path not in flipped, shot.source, shot.object, number, rank_variant(shot.variant)

    order = sorted(run.images, key=place)
    pairs = {(one.source, one.object, one.second): one for one in run.pairs if one.first == "unpatched"}
    cards = [
        {"image": one, "picture": picture, "is_flipped": one.capture.path in flipped}
        for one in order[:MOST_PICTURES]
        if (picture := draw_boxes(one, detector)) is not None
    ]
    context = {
        "title": path.parent.name, "detector": detector, "groups": run.groups, "pairs": pairs,
        "comparisons": [one for one in run.pairs if one.first != "unpatched"], "cards": cards,
        "n_hidden": max(0, len(run.images) - MOST_PICTURES), "left_out": run.left_out, "notes": run.notes,
        "found": run.summary["found"], "lines": describe_pairs(run),
    }  # fmt: skip
    return write_page(path, "toolkit.evaluation", "detections.html.j2", context)


def describe_pairs(run: "DetectionRun") -> list[str]:
    """The result of each source and variant in words."""
    lines = []
    pooled = {one.source for one in run.groups if one.object == "all"}
    for pair in run.pairs:
        # one line for each source and variant: the pooled one where there are several objects
        if (pair.object == "all") != (pair.source in pooled):
            continue
        found = pair.outcomes
        sure = "" if found.mcnemar_p < 0.05 else ", which chance explains too"
        lines.append(
            f"{pair.source}: {pair.second} found in {found.n_second} of {found.n} poses, {pair.first} in "
            f"{found.n_first}: {found.only_second} gained, {found.only_first} lost (p = {found.mcnemar_p:.2g}{sure})"
        )
    return lines


def _find_flipped(images: Sequence["DetectedImage"]) -> set[str]:
    """Paths of the images of a pose that is found in one variant and not in another."""
    poses: dict[tuple[str, str, int | None], list[DetectedImage]] = {}
    for one in images:
        poses.setdefault((one.capture.source, one.capture.object, one.capture.pose_id), []).append(one)
    mixed = [some for some in poses.values() if len({one.is_found for one in some}) == 2]
    return {one.capture.path for some in mixed for one in some}


def draw_boxes(one: "DetectedImage", detector: Detector) -> str | None:
    """A JPEG `data:` URI: the truth white, boxes of its class green, others orange; None where it cannot be read."""
    from toolkit.evaluation.predict import corrupt_images, find_pending

    if one.seen is None:
        return None
    try:
        pixels = read_image(one.capture.file)
    except UnreadableImage:
        return None
    if find_pending(one.capture) is not None:
        pixels = corrupt_images([one.capture], [pixels], detector.device)[0]
    image = Image.fromarray(np.ascontiguousarray(pixels))
    pen, width = ImageDraw.Draw(image), max(2, round(max(image.size) / 120))
    pen.rectangle(one.truth.box, outline=TRUTH_COLOUR, width=width)
    # the strongest last, on top of the others
    for box, index, score in list(zip(one.seen.boxes, one.seen.classes, one.seen.scores, strict=True))[::-1]:
        if score >= LEAST_SHOWN:
            colour = RIGHT_COLOUR if index == one.true_index else WRONG_COLOUR
            pen.rectangle([float(side) for side in box], outline=colour, width=width)
            words = f"{detector.labels[index]} {score:.2f}"
            place = float(box[0]) + width, max(0.0, float(box[1]) + width)
            size = max(12, image.size[0] // 22)
            pen.rectangle(pen.textbbox(place, words, font_size=size), fill="#14171b")
            pen.text(place, words, fill=colour, font_size=size)
    return encode_jpeg(image)
