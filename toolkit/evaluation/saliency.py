"""Grad-CAM maps for the flips in the report: where a network finds evidence for a class."""

import threading
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
from PIL import Image

from toolkit.core.console import progress
from toolkit.core.lazy import torch
from toolkit.evaluation.contact_sheet import encode_jpeg
from toolkit.evaluation.metrics import FlipList
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.read_pixels import AHEAD, read_ahead
from toolkit.models.network import Classifier
from toolkit.models.predict import ask_in_parts

NO_MAP = "{arch} has no feature map: no module of it returns (b, c, h, w) or (b, h, w, c) with h, w > 1"
TOKENS = "the last feature map of {arch} comes before its attention layers, where Grad-CAM means little"
UNUSED = "the last feature map of {arch} does not lead to its output"


class NoSaliency(Exception):
    """A network that Grad-CAM cannot explain, with the reason."""


def find_feature_map(classifier: Classifier) -> "torch.nn.Module":
    """Return the last module whose output has four axes, and height and width above 1.

    Raises:
        NoSaliency: there is none, or token layers follow it, as in a vision transformer.
    """
    if classifier.untrainable:
        raise NoSaliency(f"{classifier.arch}: {classifier.untrainable}")
    last: torch.nn.Module | None = None
    tokens_after = False

    def note(module: torch.nn.Module, _: tuple, output: object) -> None:
        nonlocal last, tokens_after
        if not isinstance(output, torch.Tensor):
            return
        if output.ndim == 4 and min(_channels_first(output).shape[2:]) > 1:
            last, tokens_after = module, False
        # (batch, tokens, channels): attention mixes places, so a map before it means little
        elif output.ndim == 3 and output.shape[1] > 1:
            tokens_after = True

    hooks = [module.register_forward_hook(note) for module in classifier.module.modules()]
    side = classifier.preprocessing.crop_px
    try:
        with torch.enable_grad():  # a fast path without gradients may skip the layers
            classifier.logits(torch.full((1, 3, side, side), 0.5))
    finally:
        for hook in hooks:
            hook.remove()
    if last is None:
        raise NoSaliency(NO_MAP.format(arch=classifier.arch))
    if tokens_after:
        raise NoSaliency(TOKENS.format(arch=classifier.arch))
    return last


def _channels_first(features: "torch.Tensor") -> "torch.Tensor":
    """Return features (b, c, h, w); those of Swin transformers are (b, h, w, c), with two equal sides h and w."""
    _, first, second, last = features.shape
    return features.permute(0, 3, 1, 2) if first == second != last else features


def compute_gradcam(
    classifier: Classifier, feature_map: "torch.nn.Module", batch: "torch.Tensor", classes: list[int]
) -> np.ndarray:
    """Return Grad-CAM maps (b, h, w) float32, at least 0, in the feature map's resolution, without scaling.

    The channels of the feature map are weighted by the mean gradient of the class's logit, summed and cut at zero
    (Selvaraju et al. 2017, equations 1 and 2). No gradient runs through the layers before the feature map.

    Args:
        batch: (b, 3, crop, crop) float tensor, sRGB-encoded in [0, 1].
        classes: class index for each image.

    Raises:
        NoSaliency: the feature map does not lead to the output.
        ToolkitError: as `ask_in_parts`.
    """
    seen = threading.local()  # parts of the batch run at the same time, each on its thread

    def start_graph(_: torch.nn.Module, __: tuple, output: torch.Tensor) -> torch.Tensor:
        leaf = output.detach().requires_grad_()
        seen.features = leaf
        return leaf.clone()  # later layers may work in place, which a leaf does not allow

    def ask(chosen: list[int]) -> torch.Tensor:
        with torch.enable_grad():
            logits = classifier.logits(batch[chosen])
            # a logit depends on its image alone: the gradient of the sum holds all gradients
            target = logits[torch.arange(len(chosen)), torch.tensor([classes[k] for k in chosen])].sum()
            gradient = None
            if target.requires_grad:
                (gradient,) = torch.autograd.grad(target, seen.features, allow_unused=True)
        if gradient is None:
            raise NoSaliency(UNUSED.format(arch=classifier.arch))
        with torch.no_grad():
            # channels weighted by their mean gradient, then ReLU
            weights = _channels_first(gradient).double().mean((2, 3), keepdim=True)
            return (weights * _channels_first(seen.features).double()).sum(1).relu().float().cpu()

    hook = feature_map.register_forward_hook(start_graph)
    try:
        return torch.cat(ask_in_parts(ask, len(batch), classifier.device)).numpy()
    finally:
        hook.remove()


MAX_UNASKED = 200
"""Largest number of flips for which maps are drawn by default."""
GREY_SHARE, MAX_ALPHA = 0.8, 0.75
HEAT_LEVELS = (0.0, 0.35, 0.7, 1.0)
HEAT_COLOURS = ((60, 15, 110), (190, 40, 90), (245, 125, 20), (252, 250, 140))
"""From dark violet over orange to pale yellow, lighter with more heat, also for colour-blind readers."""


@dataclass(frozen=True)
class Saliency:
    """Saliency maps of flips.

    Attributes:
        pictures: two JPEG `data:` URIs by the paths of the images before and after.
    """

    pictures: dict[tuple[str, str], tuple[str, str]] = field(default_factory=dict)
    reason: str = ""


def draw_saliency(flips: Sequence[FlipList], classifier: Classifier, wanted: bool | None = None) -> Saliency:
    """Draw Grad-CAM maps of the true class on both images of every flip; by default of at most 200 flips."""
    shown = [pair for flip in flips for pair in flip.shown]
    n = sum(flip.n for flip in flips)
    if wanted is False or not shown:
        return Saliency()
    if wanted is None and n > MAX_UNASKED:
        return Saliency(reason=f"{n} flips are more than {MAX_UNASKED}: use --saliency to draw maps")
    # an image in several flips is classified once
    images = {image.capture.path: image for pair in shown for image in (pair.first, pair.second)}
    try:
        seen = _compute_maps(list(images.values()), classifier)
    except NoSaliency as why:
        return Saliency(reason=str(why))
    pictures = {}
    for pair in shown:
        paths = (pair.first.capture.path, pair.second.capture.path)
        if all(path in seen for path in paths):
            # the same scale for both: a paler map is less evidence
            top = max(float(seen[path][1].max()) for path in paths)
            before, after = (encode_jpeg(overlay_heat(*seen[path], top)) for path in paths)
            pictures[paths] = (before, after)
    return Saliency(pictures)


def overlay_heat(pixels: np.ndarray, heat: np.ndarray, top: float) -> Image.Image:
    """Return the network's input, nearly grey, under a translucent map.

    Args:
        pixels: (h, w, 3) uint8 sRGB.
        heat: (rows, columns), at least 0, enlarged bilinearly.
        top: heat with full colour.
    """
    level = Image.fromarray(np.asarray(heat, np.float32) / max(top, 1e-12))
    level = level.resize((pixels.shape[1], pixels.shape[0]), Image.Resampling.BILINEAR)
    heat = np.clip(np.asarray(level), 0, 1)[..., None]
    base = pixels.astype(np.float32)
    # nearly grey, so that colours are those of the map
    base += GREY_SHARE * (base.mean(2, keepdims=True) - base)
    colour = np.concatenate([np.interp(heat, HEAT_LEVELS, values) for values in zip(*HEAT_COLOURS, strict=True)], 2)
    # little heat stays translucent; the power makes weak evidence visible
    alpha = MAX_ALPHA * heat**0.7
    return Image.fromarray(np.round(base + alpha * (colour - base)).astype(np.uint8))


def _compute_maps(images: Sequence[Prediction], classifier: Classifier) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return pixels and map of each image by its path, without images that do not decode any more."""
    feature_map = find_feature_map(classifier)
    classes = {image.capture.path: image.true_index for image in images}
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    pictures = read_ahead((image.capture for image in images), classifier.preprocessing)
    with progress("saliency", len(images)) as ticker, closing(pictures):
        # some images at a time, read ahead while the network works
        while batch := list(islice(pictures, AHEAD)):
            read = [(capture.path, pixels) for capture, pixels in batch if not isinstance(pixels, str)]
            if read:
                stacked = torch.from_numpy(np.stack([pixels for _, pixels in read]))
                tensor = stacked.permute(0, 3, 1, 2).float().div_(255)
                maps = compute_gradcam(classifier, feature_map, tensor, [classes[path] for path, _ in read])
                found |= {path: (pixels, heat) for (path, pixels), heat in zip(read, maps, strict=True)}
            ticker.advance(len(batch))
    return found
