"""Grad-CAM: where in an image a network finds the evidence for a class."""

from typing import Any

import numpy as np

from toolkit.classifiers.network import Classifier

NO_MAP = "{arch} has no feature map with a place in the image: no module of it gives (b, c, h, w) with h, w > 1"
TOKENS = "the last feature map of {arch} comes before its attention layers, where Grad-CAM says little"
UNUSED = "the last feature map of {arch} does not lead to its output"


class NoSaliency(Exception):
    """A network that Grad-CAM cannot explain; the message says why."""


def find_feature_map(classifier: Classifier) -> Any:
    """The module whose output, of those with four axes and a height and width above one, is made last.

    Raises:
        NoSaliency: there is none, or layers that work on tokens follow it, as in a vision transformer.
    """
    import torch

    last: list[Any] = [None]
    tokens_after: list[bool] = [False]

    def note(module: Any, _: Any, output: Any) -> None:
        if not isinstance(output, torch.Tensor):
            return
        if output.ndim == 4 and min(output.shape[2:]) > 1:
            last[0], tokens_after[0] = module, False
        elif output.ndim == 3 and output.shape[1] > 1:
            tokens_after[0] = True

    hooks = [module.register_forward_hook(note) for module in classifier.module.modules()]
    side = classifier.preprocessing.crop_px
    try:
        with torch.no_grad():
            classifier.logits(torch.full((1, 3, side, side), 0.5))
    finally:
        for hook in hooks:
            hook.remove()
    if last[0] is None:
        raise NoSaliency(NO_MAP.format(arch=classifier.arch))
    if tokens_after[0]:
        raise NoSaliency(TOKENS.format(arch=classifier.arch))
    return last[0]


def compute_gradcam(classifier: Classifier, feature_map: Any, batch: Any, classes: list[int]) -> np.ndarray:
    """(b, h, w) float32 maps, at least 0, in the feature map's own resolution and without any scaling.

    The channels of the feature map, each weighted by the mean over all places of the gradient of the class's logit,
    summed and cut at zero (Selvaraju et al. 2017, equations 1 and 2). The graph starts at the feature map: no gradient
    runs through the layers before it, and the cost is little more than that of the forward pass.

    Args:
        classifier: the network.
        feature_map: from `find_feature_map`.
        batch: (b, 3, crop, crop) float tensor, sRGB-encoded in [0, 1].
        classes: index of the class to look for in each image.

    Raises:
        NoSaliency: the feature map does not lead to the output, or the batch does not fit the GPU's memory.
    """
    import torch

    seen: list[Any] = []

    def start_graph(_: Any, __: Any, output: Any) -> Any:
        leaf = output.detach().requires_grad_()
        seen.append(leaf)
        return leaf.clone()  # what follows may work in place, which a leaf of the graph does not allow

    hook = feature_map.register_forward_hook(start_graph)
    try:
        with torch.enable_grad():
            logits = classifier.logits(batch)
            target = logits[torch.arange(len(batch)), torch.tensor(classes)].sum()
            gradient = torch.autograd.grad(target, seen[-1], allow_unused=True)[0] if target.requires_grad else None
    except torch.cuda.OutOfMemoryError:
        raise NoSaliency(f"{len(batch)} images do not fit the GPU's memory: make --batch-size smaller") from None
    finally:
        hook.remove()
    if gradient is None:
        raise NoSaliency(UNUSED.format(arch=classifier.arch))
    with torch.no_grad():
        weights = gradient.double().mean((2, 3), keepdim=True)
        return (weights * seen[-1].double()).sum(1).relu().float().cpu().numpy()
