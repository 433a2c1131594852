"""Load encoders: networks that end in features, or classifiers without the layer that names their classes."""

from pathlib import Path
from typing import TYPE_CHECKING

from toolkit.core.errors import FieldError
from toolkit.models.find import OPEN_CLIP_PREFIX, TIMM_PREFIX, find_classifier
from toolkit.models.labels import LabelsFile
from toolkit.models.load import build_timm_network, load_classifier, load_elsewhere
from toolkit.models.network import Classifier

if TYPE_CHECKING:
    from torch import nn

    from toolkit.models.heads import AsEncoder


def load_encoder(
    model: str, weights: Path | None = None, device: str = "auto", folder: Path | None = None, *, how: "AsEncoder"
) -> Classifier:
    """Load an encoder; its `logits` are features, (b, d), and its labels number them.

    A classifier of torchvision, timm or the workspace loses its last layer, unless `how.whole` keeps it. ONNX graphs,
    exported programs and the user's functions must end in features. Arguments are as in `load_classifier`; `model` may
    also be `open_clip:NAME:WEIGHTS`, for its image tower.

    Raises:
        ToolkitError: as `load_classifier`; the network gives no features.
    """
    from toolkit.models.programs import assemble

    if model.startswith(OPEN_CLIP_PREFIX):
        from toolkit.models.open_clip import open_towers

        towers = open_towers(model)
        own = LabelsFile(name=model.replace(":", "-"))
        return assemble(towers.image, model, towers.file, own, towers.preprocessing, device, how)
    found = find_classifier(model, weights, folder)
    # timm can rebuild its networks without the last layer
    if found.arch.startswith(TIMM_PREFIX):
        timm = build_timm_network(found.arch, found.weights, may_be_encoder=True)
        if timm.num_classes and not how.whole:
            timm.module.reset_classifier(0)  # type: ignore[operator]
        own = timm.own.model_copy(update={"name": timm.own.name or found.arch.replace(":", "-")})
        module = timm.module.requires_grad_(False).eval()
        return assemble(module, found.arch, timm.file, own, timm.preprocessing, device, how)
    # graphs, programs and hub networks end in features by themselves
    if (program := load_elsewhere(found, device, how)) is not None:
        return program
    classifier = load_classifier(model, weights, device, folder)
    if not how.whole:
        _drop_last(classifier.module, len(classifier.labels), classifier.arch)
    own = LabelsFile(name=classifier.name, trained_on=classifier.trained_on or None)
    return assemble(classifier.module, classifier.arch, classifier.weights, own, classifier.preprocessing, device, how)


def _drop_last(module: "nn.Module", classes: int, arch: str) -> None:
    """Replace the layer that gives a number for each class by the identity."""
    from torch import nn

    last = [
        name for name, layer in module.named_modules()
        if (isinstance(layer, nn.Linear) and layer.out_features == classes)
        or (isinstance(layer, nn.Conv2d) and layer.out_channels == classes)
    ]  # fmt: skip
    if not last:
        raise FieldError("has no last layer that names classes: choose another network", {"model": arch})
    above, _, name = last[-1].rpartition(".")
    setattr(module.get_submodule(above), name, nn.Identity())
