"""Saliency maps of the flips that the report shows."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from PIL import Image

from toolkit.classifiers.network import Classifier
from toolkit.console import progress
from toolkit.evaluation.flips import FlipList
from toolkit.evaluation.gradcam import NoSaliency, compute_gradcam, find_feature_map
from toolkit.evaluation.predict import CPU_BATCH, CUDA_BATCH, Prediction, decode_ahead
from toolkit.evaluation.thumbnails import encode_jpeg

MAX_UNASKED = 200
"""Flips up to which maps are drawn without being asked for."""
GREY_SHARE, MAX_ALPHA = 0.8, 0.75
HEAT_LEVELS = (0.0, 0.35, 0.7, 1.0)
HEAT_COLOURS = ((60, 15, 110), (190, 40, 90), (245, 125, 20), (252, 250, 140))
"""From dark violet over orange to pale yellow, lighter with more heat, so that it reads without colour vision too."""


@dataclass(frozen=True)
class Saliency:
    """What there is to show.

    Attributes:
        pictures: JPEG `data:` URIs by (path of the image before, path of the image after): one for each of the two.
        reason: why there are none, empty where there are some or none were wanted.
    """

    pictures: dict[tuple[str, str], tuple[str, str]] = field(default_factory=dict)
    reason: str = ""


def draw_saliency(
    flips: Sequence[FlipList],
    classifier: Classifier,
    wanted: bool | None = None,
    batch_size: int | None = None,
    quiet: bool = False,
) -> Saliency:
    """Grad-CAM for the true class on both images of every flip shown.

    Args:
        flips: from `list_flips`.
        classifier: the network that was evaluated.
        wanted: yes, no, or where None: when there are at most 200 flips.
        batch_size: images per pass.
        quiet: no progress bar.
    """
    shown = [match for one in flips for match in one.shown]
    n = sum(one.n for one in flips)
    if wanted is False or not shown:
        return Saliency()
    if wanted is None and n > MAX_UNASKED:
        return Saliency(reason=f"{n} flips are more than {MAX_UNASKED}: ask for them with --saliency")
    images = list({one.capture.path: one for match in shown for one in (match.before, match.after)}.values())
    size = batch_size or (CUDA_BATCH if classifier.device == "cuda" else CPU_BATCH)
    try:
        seen = _compute_maps(images, classifier, size, quiet)
    except NoSaliency as why:
        return Saliency(reason=str(why))
    pictures = {}
    for match in shown:
        paths = (match.before.capture.path, match.after.capture.path)
        if all(path in seen for path in paths):
            # one scale for both: a paler map is less evidence
            top = max(float(seen[path][1].max()) for path in paths)
            before, after = (encode_jpeg(overlay_heat(*seen[path], top)) for path in paths)
            pictures[paths] = (before, after)
    return Saliency(pictures)


def overlay_heat(pixels: np.ndarray, heat: np.ndarray, top: float) -> Image.Image:
    """What the network saw, greyed, under a translucent map.

    Args:
        pixels: (h, w, 3) uint8 sRGB.
        heat: (rows, columns), at least 0, enlarged to the picture bilinearly.
        top: heat that is drawn fully; at 0 nothing is drawn.
    """
    height, width = pixels.shape[:2]
    level = Image.fromarray(np.asarray(heat, np.float32) / max(top, 1e-12)).resize(
        (width, height), Image.Resampling.BILINEAR
    )
    heat = np.clip(np.asarray(level), 0, 1)[..., None]
    base = pixels.astype(np.float32)
    base += GREY_SHARE * (base.mean(2, keepdims=True) - base)
    colour = np.concatenate([np.interp(heat, HEAT_LEVELS, values) for values in zip(*HEAT_COLOURS, strict=True)], 2)
    alpha = MAX_ALPHA * heat**0.7
    return Image.fromarray(np.round(base + alpha * (colour - base)).astype(np.uint8))


def _compute_maps(
    images: Sequence[Prediction], classifier: Classifier, size: int, quiet: bool
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """(pixels, map) of each image by its path; an image that does not decode any more is left out."""
    import torch

    feature_map = find_feature_map(classifier)
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    waiting: list[tuple[Prediction, np.ndarray]] = []

    def flush() -> None:
        batch = torch.from_numpy(np.stack([pixels for _, pixels in waiting])).permute(0, 3, 1, 2).float().div_(255)
        maps = compute_gradcam(classifier, feature_map, batch, [one.true_index for one, _ in waiting])
        for (one, pixels), heat in zip(waiting, maps, strict=True):
            found[one.capture.path] = (pixels, heat)
        ticker.advance(len(waiting))
        waiting.clear()

    with progress("saliency", len(images), quiet) as ticker:
        for one, pixels in zip(images, decode_ahead([one.capture for one in images], classifier, size), strict=True):
            if isinstance(pixels, str):
                ticker.advance()
                continue
            waiting.append((one, pixels))
            if len(waiting) == size:
                flush()
        if waiting:
            flush()
    return found
