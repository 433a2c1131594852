"""Grad-CAM maps for the flips in the report: where a network finds evidence for a class."""

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from toolkit.captures.capture import Capture
from toolkit.core.console import progress
from toolkit.evaluation.contact_sheet import encode_jpeg
from toolkit.evaluation.metrics import FlipList
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.read_pixels import AHEAD, read_ahead
from toolkit.models.network import Classifier
from toolkit.models.predict import ask_in_parts

if TYPE_CHECKING:
    import torch

    from toolkit.evaluation.predict import AskCaptures

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
    import torch

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


class GradCam:
    """A classifier's answers with Grad-CAM maps, within `with`.

    The channels of the feature map are weighted by the mean gradient of the class's logit, summed and cut at zero
    (Selvaraju et al. 2017, equations 1 and 2). No gradient runs through the layers before the feature map.
    """

    def __init__(self, classifier: Classifier, feature_map: "torch.nn.Module") -> None:
        """Take the module from `find_feature_map`."""
        self._classifier, self._feature_map = classifier, feature_map
        self._seen = threading.local()  # parts of a batch run at the same time, each on its thread

    def __enter__(self) -> "GradCam":
        self._hook = self._feature_map.register_forward_hook(self._start_graph)
        return self

    def __exit__(self, *error: object) -> None:
        self._hook.remove()

    def _start_graph(self, _: "torch.nn.Module", __: tuple, output: "torch.Tensor") -> "torch.Tensor":
        import torch

        torch.set_grad_enabled(True)  # until `explain` ends
        self._seen.features = output.detach().requires_grad_()
        return self._seen.features.clone()  # later layers may work in place, which a leaf does not allow

    def explain(
        self, batch: "torch.Tensor", classes: Sequence[int], with_grad: bool = True
    ) -> "tuple[torch.Tensor, torch.Tensor]":
        """Return (b, classes) logits, and maps (b, h, w) float32, at least 0, in the feature map's resolution.

        Args:
            batch: (b, 3, crop, crop) float tensor, sRGB-encoded in [0, 1].
            classes: class index for each image.
            with_grad: whether layers before the feature map run as in training; else as in `predict`, to the last bit.

        Raises:
            NoSaliency: the feature map was not reached, or does not lead to the output.
        """
        import torch

        self._seen.features = gradient = None
        with torch.inference_mode(False), torch.set_grad_enabled(with_grad):
            logits = self._classifier.logits(batch)
            # a logit depends on its image alone: the gradient of the sum holds all gradients
            target = logits[torch.arange(len(batch)), torch.tensor(classes)].sum()
            if target.requires_grad and self._seen.features is not None:
                (gradient,) = torch.autograd.grad(target, self._seen.features, allow_unused=True)
        if gradient is None:
            raise NoSaliency(UNUSED.format(arch=self._classifier.arch))
        with torch.no_grad():
            # channels weighted by their mean gradient, then ReLU
            weights = _channels_first(gradient).double().mean((2, 3), keepdim=True)
            maps = (weights * _channels_first(self._seen.features).double()).sum(1).relu().float().cpu()
        return logits.detach(), maps


def compute_gradcam(
    classifier: Classifier, feature_map: "torch.nn.Module", batch: "torch.Tensor", classes: list[int]
) -> np.ndarray:
    """Return maps (b, h, w) float32 of a batch, see `GradCam.explain`; raises as it and `ask_in_parts`."""
    import torch

    with GradCam(classifier, feature_map) as cam:

        def ask(chosen: list[int]) -> torch.Tensor:
            return cam.explain(batch[chosen], [classes[k] for k in chosen])[1]

        return torch.cat(ask_in_parts(ask, len(batch), classifier.device)).numpy()


class KeptMaps(dict[str, np.ndarray]):
    """Maps of the true class by path, made as images are classified: to classify them again would cost more."""

    @contextmanager
    def keep(self, classifier: Classifier, classes: Mapping[str, int]) -> "Iterator[AskCaptures | None]":
        """Give what `predict_captures` asks within; None if the network has no maps."""
        try:
            feature_map = find_feature_map(classifier)
        except NoSaliency:
            yield None
            return

        def ask(batch: "torch.Tensor", captures: Sequence[Capture]) -> "torch.Tensor":
            try:
                logits, maps = cam.explain(batch, [classes[one.object] for one in captures], with_grad=False)
            except NoSaliency:
                return classifier.logits(batch)
            if len(self) < MOST_KEPT:
                self.update({one.path: heat for one, heat in zip(captures, maps.numpy(), strict=True)})
            return logits

        with GradCam(classifier, feature_map) as cam:
            yield ask


MOST_KEPT = 20_000
"""Images whose maps are kept, some kilobytes each at most. In a longer folder the flips are classified again."""
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


def draw_saliency(
    flips: Sequence[FlipList], classifier: Classifier, wanted: bool | None = None,
    kept: Mapping[str, np.ndarray] | None = None,
) -> Saliency:  # fmt: skip
    """Draw Grad-CAM maps of the true class on both images of every flip; by default of at most 200 flips.

    Args:
        kept: maps by path that are known, see `KeptMaps`.
    """
    shown = [pair for flip in flips for pair in flip.shown]
    n = sum(flip.n for flip in flips)
    if wanted is False or not shown:
        return Saliency()
    if wanted is None and n > MAX_UNASKED:
        return Saliency(reason=f"{n} flips are more than {MAX_UNASKED}: use --saliency to draw maps")
    # an image in several flips is classified once
    images = {image.capture.path: image for pair in shown for image in (pair.first, pair.second)}
    try:
        seen = _compute_maps(list(images.values()), classifier, kept or {})
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
    alpha = MAX_ALPHA * heat**0.7
    return Image.fromarray(np.round(base + alpha * (colour - base)).astype(np.uint8))


def _compute_maps(
    images: Sequence[Prediction], classifier: Classifier, kept: Mapping[str, np.ndarray]
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return pixels and map of each image by its path, without images that do not decode any more."""
    import torch

    is_known = all(image.capture.path in kept for image in images)
    feature_map = None if is_known else find_feature_map(classifier)
    classes = {image.capture.path: image.true_index for image in images}
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    pictures = read_ahead((image.capture for image in images), classifier.preprocessing)
    with progress("saliency", len(images)) as ticker, closing(pictures):
        while batch := list(islice(pictures, AHEAD)):
            read = [(capture.path, pixels) for capture, pixels in batch if not isinstance(pixels, str)]
            if feature_map is None:
                found |= {path: (pixels, kept[path]) for path, pixels in read}
            elif read:
                stacked = torch.from_numpy(np.stack([pixels for _, pixels in read]))
                tensor = stacked.permute(0, 3, 1, 2).float().div_(255)
                maps = compute_gradcam(classifier, feature_map, tensor, [classes[path] for path, _ in read])
                found |= {path: (pixels, heat) for (path, pixels), heat in zip(read, maps, strict=True)}
            ticker.advance(len(batch))
    return found
