"""Detectors: torchvision's, ONNX graphs and functions whose outputs a `Decoder` reads."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import nn

from toolkit.core.errors import FieldError, ToolkitError, foreign_code
from toolkit.core.text import join_words
from toolkit.models.decoders import (
    Decoder,
    Dense,
    Shape,
    choose_decoder,
    count_classes,
    count_places,
    describe_expected,
    guess_decoder,
    published_labels,
)
from toolkit.models.detector import LEAST_SCORE, MOST_BOXES, Detections, Detector
from toolkit.models.find import ONNX_PREFIX, TORCHVISION_PREFIX
from toolkit.models.labels import PYTHON_PREFIX, LabelsFile, check_size, choose_labels, read_labels_file
from toolkit.models.network import blame_model, check_hash, choose_device
from toolkit.models.onnx_graphs import read_names, read_onnx, read_output_shapes
from toolkit.models.onnx_networks import OnnxNetwork
from toolkit.models.programs import call_python, read_mapping
from toolkit.models.raw_head import cut_raw_head
from toolkit.models.vision import torchvision
from toolkit.models.weights import (
    WeightsFile,
    check_named,
    download,
    find_local,
    open_weights,
    read_state_dict,
    unwrap_names,
)

Place = tuple[float, float, int, int]
"""Scale of x and y, and the left and upper edge, of a picture in the network's square."""
MOST_SHARE = 4.0
"""Normalised boxes may reach out of the image, but not so far."""


@dataclass(frozen=True)
class DenseDetector:
    """A detector whose outputs a `Decoder` reads; see `Detector` for the attributes that all have.

    Attributes:
        module: the network, for normalised images.
        decoder: its family.
        raw: boxes and scores before the network's own selection, for normalised images; None: it selects nothing.
    """

    arch: str
    name: str
    module: nn.Module
    decoder: Decoder
    labels: list[str]
    weights: WeightsFile
    device: str
    image_px: int
    untrainable: str = ""
    raw: Callable[[torch.Tensor], Any] | None = None

    def predict(self, batch: torch.Tensor) -> Dense:
        """Boxes and scores of every place, for (b, 3, size, size) sRGB-encoded in [0, 1]; differentiable."""
        batch = batch.to(self.device)
        batch = self._normalise(batch.flip(1) if self.decoder.channels == "BGR" else batch)
        return self._decode(batch) if self.raw is None else self.raw(batch)

    def _decode(self, batch: torch.Tensor) -> Dense:
        return self.decoder.decode(self.module(batch), self.image_px)

    def _normalise(self, batch: torch.Tensor) -> torch.Tensor:
        """Values in [0, 1], with the channels in the network's own order, as the network wants them."""
        mean, std = (
            torch.tensor(values, dtype=batch.dtype, device=batch.device).view(1, 3, 1, 1)
            for values in (self.decoder.mean, self.decoder.std)
        )
        # what would change no number costs as much time as what does
        batch = batch if not any(self.decoder.mean) else batch - mean
        return batch if set(self.decoder.std) == {1} else batch / std

    def detect(self, images: Sequence[np.ndarray]) -> list[Detections]:
        """Find objects in (h, w, 3) uint8 sRGB images of any sizes."""
        fitted = [self._fit(image) for image in images]
        with torch.inference_mode():
            order = -1 if self.decoder.channels == "BGR" else 1
            planes = np.stack([plane for pixels, _ in fitted for plane in cv2.split(pixels)[::order]])
            planes = planes.reshape(len(images), 3, self.image_px, self.image_px)
            boxes, scores = self._decode(self._normalise(torch.from_numpy(planes).to(self.device).float().div_(255)))
            return [
                self._keep(boxes[k], scores[k], place, image.shape[:2])
                for k, (image, (_, place)) in enumerate(zip(images, fitted, strict=True))
            ]

    def _fit(self, image: np.ndarray) -> tuple[np.ndarray, Place]:
        """Place the image in the network's square; return it with its place."""
        side, (height, width), how = self.image_px, image.shape[:2], self.decoder
        if how.letterbox == "stretch":
            return cv2.resize(image, (side, side)), (side / width, side / height, 0, 0)
        scale = min(side / width, side / height)
        is_centred = how.letterbox == "centre"
        # Ultralytics rounds the sides, YOLOX cuts them off
        wide, high = ((round if is_centred else int)(length * scale) or 1 for length in (width, height))
        left, top = ((side - wide) // 2, (side - high) // 2) if is_centred else (0, 0)
        square = np.full((side, side, 3), how.fill, np.uint8)
        square[top : top + high, left : left + wide] = cv2.resize(image, (wide, high))
        return square, (scale, scale, left, top)

    def _keep(self, boxes: torch.Tensor, scores: torch.Tensor, place: Place, shape: tuple[int, int]) -> Detections:
        best, classes = scores.max(1)
        kept = best > LEAST_SCORE
        boxes, best, classes = boxes[kept], best[kept], classes[kept]
        # boxes that a graph selected already need no suppression
        if self.decoder.nms_iou is None:
            order = best.argsort(descending=True, stable=True)[:MOST_BOXES]
        else:
            # boxes suppress those of the same class only
            order = torchvision.ops.batched_nms(boxes, best, classes, self.decoder.nms_iou)[:MOST_BOXES]
        # from the square that the network saw back to the image: margin off, then scaled
        x_scale, y_scale, left, top = place
        found = boxes[order].cpu().numpy() - np.array([left, top, left, top], np.float32)
        found = found / np.array([x_scale, y_scale, x_scale, y_scale], np.float32)
        found = np.clip(found, 0, np.array([shape[1], shape[0]] * 2, np.float32))
        return Detections(found.astype(np.float32), classes[order].cpu().numpy(), best[order].float().cpu().numpy())

    def losses(self, batch: torch.Tensor, boxes: torch.Tensor, class_index: int | None) -> torch.Tensor:
        """(b,) mean of −log score of the class plus the box's generalised-IoU loss, over the ten best places.

        The places are weighted by the IoU of their boxes with the object. The gradient raises the class's score there,
        and pulls the boxes to the object (Angelic Patches, CVPR 2023, for dense detectors).
        """
        found, scores = self.predict(batch)
        scores, boxes = scores.amax(-1) if class_index is None else scores[..., class_index], boxes.to(found)
        terms = []
        for k in range(len(batch)):
            # places are chosen without a gradient; if no box overlaps, they count alike
            fit = torchvision.ops.box_iou(found[k].detach(), boxes[k : k + 1])[:, 0]
            weight, places = fit.topk(min(10, len(fit)))
            weight = (weight + 1e-3) / (weight + 1e-3).sum()
            # at 0 a logarithm has no slope
            score = scores[k, places].clamp_min(1e-6)
            misfit = torchvision.ops.generalized_box_iou_loss(found[k, places], boxes[k].expand(len(places), 4))
            terms.append((weight * (misfit - score.log())).sum())
        return torch.stack(terms)


@dataclass(frozen=True)
class TorchvisionDetector:
    """A detector that takes a list of images and gives dictionaries; see `Detector` for the attributes."""

    arch: str
    name: str
    module: nn.Module
    labels: list[str]
    weights: WeightsFile
    device: str
    image_px: int = 0
    untrainable: str = ""

    def detect(self, images: Sequence[np.ndarray]) -> list[Detections]:
        """Find objects in (h, w, 3) uint8 sRGB images of any sizes."""
        tensors = [torch.from_numpy(image).permute(2, 0, 1).float().div(255).to(self.device) for image in images]
        with torch.inference_mode():
            answers = self.module(tensors)
        found = []
        for answer in answers:
            kept = (answer["scores"] > LEAST_SCORE).nonzero()[:MOST_BOXES, 0]
            boxes, classes, scores = (answer[key][kept].cpu().numpy() for key in ("boxes", "labels", "scores"))
            found.append(Detections(boxes.astype(np.float32), classes, scores.astype(np.float32)))
        return found

    def losses(self, batch: torch.Tensor, boxes: torch.Tensor, class_index: int | None) -> torch.Tensor:
        """(b,) the network's own training loss for the object as the only truth.

        For any class: minus the logarithm of the best score among boxes that overlap the object by half.
        """
        if class_index is None:
            return self._miss(batch, boxes)
        terms = []
        # torchvision's detectors give losses in training mode alone
        self.module.train()
        for layer in self.module.modules():
            if isinstance(layer, nn.BatchNorm2d | nn.Dropout):
                layer.eval()  # the network stays as it is
        try:
            # a training pass for each image, with the object as the only box
            for k in range(len(batch)):
                target = {
                    "boxes": boxes[k : k + 1].to(batch),
                    "labels": torch.tensor([class_index], device=batch.device),
                }
                terms.append(torch.stack(list(self.module([batch[k]], [target]).values())).sum())
        finally:
            self.module.eval()
        return torch.stack(terms)

    def _miss(self, batch: torch.Tensor, boxes: torch.Tensor) -> torch.Tensor:
        """(b,) minus the logarithm of the best score at the object, whatever its class."""
        terms = []
        for seen, box in zip(self.module(list(batch)), boxes.to(batch), strict=True):
            is_there = torchvision.ops.box_iou(seen["boxes"].detach(), box[None])[:, 0] >= 0.5
            # a score that is always there: without a box the loss is that of a very weak one
            scores = torch.cat([seen["scores"][is_there], batch.new_full((1,), 1e-6)])
            terms.append(-scores.max().log())
        return torch.stack(terms)


def list_detectors() -> list[str]:
    """Names of torchvision's detectors that give boxes and nothing else."""
    names = torchvision.models.list_models(module=torchvision.models.detection)
    return [name for name in names if "mask" not in name and "keypoint" not in name]


def is_detector(model: str | None) -> bool:
    """Whether a name means a detector: torchvision's, or an ONNX file with a detector's outputs or description.

    Code (`python:MODULE:FUNCTION`) makes a detector if its preprocessing names a `decoder`.

    Raises:
        ToolkitError: an ONNX file cannot be read, or the code fails.
    """
    if model is None:
        return False
    if model.removeprefix(TORCHVISION_PREFIX) in list_detectors():
        return True
    # code is only run if the user typed it; only its preprocessing tells what it makes
    if model.startswith(PYTHON_PREFIX):
        given = call_python(model).given
        return isinstance(given, Mapping) and given.get("decoder") is not None
    path = Path(model.removeprefix(ONNX_PREFIX))
    if (model.startswith(ONNX_PREFIX) or path.suffix == ".onnx") and path.is_file():
        # a description decides, else the shapes of the outputs
        own = read_labels_file(path)
        if own.decoder is not None:
            return True
        graph = read_onnx(path)
        return guess_decoder(read_output_shapes(graph), graph.size or own.crop_px or own.size) is not None
    return False


def load_detector(model: str, weights: Path | None = None, device: str = "auto") -> Detector:
    """Load a detector.

    Args:
        model: `torchvision:NAME`, `onnx:FILE` with perhaps a TOML beside it (`decoder`, `size`, `labels`, `letterbox`,
            `fill`, `mean`, `std`, `channels`), or `python:MODULE:FUNCTION`, which returns a module and such fields.
        weights: state dict for a detector of torchvision; by default as for classifiers.
        device: `auto`, `cpu` or `cuda`.

    Raises:
        ToolkitError: an unknown name, no weights, or a network that is no detector of a known family.
    """
    name = model.removeprefix(TORCHVISION_PREFIX)
    if name in list_detectors():
        return _load_torchvision(name, weights, device)
    if model.startswith(PYTHON_PREFIX):
        called = call_python(model)
        own = read_mapping(model, called.given)
        return _assemble(called.module, model, called.file, own, own.crop_px or own.size or 0, device)
    path = Path(model.removeprefix(ONNX_PREFIX))
    if not model.startswith(ONNX_PREFIX) and path.suffix != ".onnx":
        raise FieldError(
            f"no detector: expected onnx:FILE or a name of torchvision: {', '.join(list_detectors())}", {"model": model}
        )
    if not path.is_file():
        raise FieldError("no such file", {"model": model})
    return _load_onnx(path, device)


def _load_onnx(path: Path, device: str) -> DenseDetector:
    graph, own = read_onnx(path), read_labels_file(path)
    check_hash(graph.file, own)
    size = check_size(path, graph.size, own)
    # a graph that selects its boxes by itself is trained against what it selects from
    selects = (own.decoder or guess_decoder(read_output_shapes(graph), size)) == "end2end"
    network = OnnxNetwork(graph, size, partial(cut_raw_head, places=count_places(size)) if selects else None)
    own = own if own.labels else own.model_copy(update={"labels": read_names(graph)})
    made = _assemble(network, f"{ONNX_PREFIX}{path.name}", graph.file, own, size, device)
    return replace(made, untrainable=network.untrainable, raw=network.raw if selects else None)


def _assemble(
    network: nn.Module, arch: str, file: WeightsFile, own: LabelsFile, size: int, device: str
) -> DenseDetector:
    place = choose_device(device)
    network = network.to(place)

    with foreign_code(blame_model(arch, f"it fails at two images of {size} px")), torch.no_grad():
        # two images: a graph for a single image fails here
        answers = network(torch.zeros(2, 3, size, size, device=place))
    family, shapes = _find_family(answers, own, size, arch)
    classes = count_classes(family, shapes)
    published = published_labels(classes)
    # the number of classes by the outputs, names by the description or the published list
    labels = choose_labels(file.path, own.labels, published, classes or len(own.labels or published))
    said = {key: getattr(own, key) for key in ("mean", "std", "channels", "letterbox", "fill")}
    changes = {key: value for key, value in said.items() if value is not None}
    return DenseDetector(
        arch=arch, name=own.name or file.path.stem, module=network, labels=labels, weights=file, device=place,
        decoder=replace(choose_decoder(family, len(labels)), **changes), image_px=size,
    )  # fmt: skip


def _find_family(answers: object, own: LabelsFile, size: int, arch: str) -> tuple[str, list[Shape]]:
    """Return the family of outputs for two images, and their shapes."""
    several = answers if isinstance(answers, tuple | list) else (answers,)
    shapes: list[Shape] = [tuple(getattr(image, "shape", ())) for image in several]
    guessed = guess_decoder(shapes, size)
    family = own.decoder or guessed
    # a description that names another family than the shape has is wrong as well
    if family is None or guessed != family:
        found = join_words("×".join(map(str, shape)) or "no tensor" for shape in shapes)
        what = f"a {family}" if family else "a detector of a known family"
        raise FieldError(
            f"gives {found} for 2 images of {size} px, which is not {what}: expected {describe_expected(size)}"
            + ("; it looks like a classifier" if [len(shape) for shape in shapes] == [2] else ""),
            {"model": arch},
        )
    # DETR's boxes are shares: pixels would pass the shape check, and be wrong
    if family == "detr":
        boxes = next(image for image in several if image.shape[-1] == 4)
        if boxes.numel() and float(boxes.abs().max()) > MOST_SHARE:
            expected = "expected x, y, width and height as shares of the image, from 0 to 1"
            raise FieldError(f"its boxes reach {float(boxes.abs().max()):.0f}: {expected}", {"model": arch})
    return family, shapes


def _load_torchvision(name: str, weights: Path | None, device: str) -> TorchvisionDetector:
    entry: torchvision.models.WeightsEnum = torchvision.models.get_model_weights(name).DEFAULT
    named = None if weights is None else check_named(Path(weights))
    file = open_weights(named or find_local(name, str(entry.url)) or download(name, str(entry.url)))
    own, state, place = read_labels_file(file.path), read_state_dict(file), choose_device(device)
    check_hash(file, own)
    labels = own.labels or list(entry.meta["categories"])
    module: nn.Module = torchvision.models.get_model(name, weights=None, weights_backbone=None, num_classes=len(labels))
    try:
        module.load_state_dict(unwrap_names(state, module.state_dict(), file.path))
    except RuntimeError as error:
        why = " ".join(str(error).split())[:160]
        raise ToolkitError(f"{file.path} holds no weights of {name} with {len(labels)} classes: {why}") from None
    module = module.requires_grad_(False).eval().to(place)
    return TorchvisionDetector(f"{TORCHVISION_PREFIX}{name}", own.name or name, module, labels, file, place)
