"""Detectors: torchvision's, and ONNX graphs of families that give a box and scores for every place of a grid."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import nn

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.models.detector import COCO_LABELS, LEAST_SCORE, MOST_BOXES, Detections, Detector
from toolkit.models.find import ONNX_PREFIX, TORCHVISION_PREFIX
from toolkit.models.labels import LabelsFile, check_size, choose_labels, read_labels_file
from toolkit.models.network import check_hash, choose_device
from toolkit.models.onnx_graphs import read_onnx, read_output_shape
from toolkit.models.onnx_networks import OnnxNetwork
from toolkit.models.vision import torchvision
from toolkit.models.weights import (
    WeightsFile,
    cache_dir,
    check_named,
    download,
    find_in_folder,
    open_weights,
    read_state_dict,
    unwrap_names,
)

Dense = tuple[torch.Tensor, torch.Tensor]
"""(b, n, 4) boxes x1, y1, x2, y2 in the network's pixels, and (b, n, classes) scores in [0, 1]."""


def decode_yolox(outputs: torch.Tensor, size: int, strides: Sequence[int] = (8, 16, 32)) -> Dense:
    """YOLOX's own (Ge et al. 2021): offsets from a grid's corners, logarithms of the sides, all in strides.

    Args:
        outputs: (b, n, 5 + classes): x, y, log w, log h, objectness and class scores after the sigmoid.
        size: side of the network's images.
        strides: of its grids, in the outputs' order.
    """
    corners, steps = [], []
    for stride in strides:
        line = torch.arange(size // stride, device=outputs.device, dtype=outputs.dtype)
        y, x = torch.meshgrid(line, line, indexing="ij")
        corners.append(torch.stack([x, y], -1).reshape(-1, 2))
        steps.append(torch.full((len(corners[-1]), 1), float(stride), device=outputs.device, dtype=outputs.dtype))
    corner, step = torch.cat(corners), torch.cat(steps)
    centre = (outputs[..., :2] + corner) * step
    # an exponent that no trained network gives would overflow, and its gradient with it
    half = outputs[..., 2:4].clamp(max=20).exp() * step / 2
    return torch.cat([centre - half, centre + half], -1), outputs[..., 4:5] * outputs[..., 5:]


def decode_fastestdet(outputs: torch.Tensor, size: int) -> Dense:
    """FastestDet's own: one grid; score = objectness^0.6 × class^0.4.

    Args:
        outputs: (b, 5 + classes, h, w): objectness after the sigmoid, x, y, w, h before theirs, classes after softmax.
        size: side of the network's images.
    """
    _, _, height, width = outputs.shape
    flat = outputs.flatten(2).transpose(1, 2)
    y, x = torch.meshgrid(*(torch.arange(n, device=outputs.device) for n in (height, width)), indexing="ij")
    corner = torch.stack([x, y], -1).reshape(-1, 2).to(outputs.dtype)
    cells = torch.tensor([width, height], device=outputs.device, dtype=outputs.dtype)
    centre = (flat[..., 1:3].tanh() + corner) / cells * size
    half = flat[..., 3:5].sigmoid() * size / 2
    # a power has no finite slope at zero
    scores = flat[..., :1].clamp_min(1e-6) ** 0.6 * flat[..., 5:].clamp_min(1e-6) ** 0.4
    return torch.cat([centre - half, centre + half], -1), scores


@dataclass(frozen=True)
class Decoder:
    """How one family of detectors sees and speaks.

    Attributes:
        decode: (outputs, size) -> `Dense`.
        pad: grey of 255 that fills the square beside a picture, which keeps its shape; None: it is stretched.
        mean, std, channels: of the network's input, as in `Preprocessing`.
        nms_iou: from which overlap on the weaker of two boxes of a class is dropped.
    """

    decode: Callable[[torch.Tensor, int], Dense]
    pad: int | None
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    channels: str
    nms_iou: float


DECODERS = {
    "yolox": Decoder(decode_yolox, 114, (0, 0, 0), (1 / 255, 1 / 255, 1 / 255), "BGR", 0.45),
    "fastestdet": Decoder(decode_fastestdet, None, (0, 0, 0), (1, 1, 1), "BGR", 0.45),
}


@dataclass(frozen=True)
class DenseDetector:
    """A detector whose outputs a `Decoder` reads; see `Detector` for the attributes that all have.

    Attributes:
        module: the network, for normalised images.
        decoder: its family.
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

    def predict(self, batch: torch.Tensor) -> Dense:
        """Boxes and scores of every place, for (b, 3, size, size) sRGB-encoded in [0, 1]; differentiable."""
        batch = batch.to(self.device)
        return self._answer(batch.flip(1) if self.decoder.channels == "BGR" else batch)

    def _answer(self, batch: torch.Tensor) -> Dense:
        """`predict` for channels in the network's own order."""
        mean, std = (
            torch.tensor(values, dtype=batch.dtype, device=batch.device).view(1, 3, 1, 1)
            for values in (self.decoder.mean, self.decoder.std)
        )
        # what would change no number costs as much time as what does
        batch = batch if not any(self.decoder.mean) else batch - mean
        batch = batch if set(self.decoder.std) == {1} else batch / std
        return self.decoder.decode(self.module(batch), self.image_px)

    def detect(self, images: Sequence[np.ndarray]) -> list[Detections]:
        """What it sees in (h, w, 3) uint8 sRGB images of any sizes."""
        fitted = [self._fit(image) for image in images]
        with torch.inference_mode():
            order = -1 if self.decoder.channels == "BGR" else 1
            planes = np.stack([plane for pixels, _ in fitted for plane in cv2.split(pixels)[::order]])
            planes = planes.reshape(len(images), 3, self.image_px, self.image_px)
            boxes, scores = self._answer(torch.from_numpy(planes).to(self.device).float().div_(255))
            return [
                self._keep(boxes[k], scores[k], scale, image.shape[:2])
                for k, (image, (_, scale)) in enumerate(zip(images, fitted, strict=True))
            ]

    def _fit(self, image: np.ndarray) -> tuple[np.ndarray, tuple[float, float]]:
        """The image in the network's square, and how much x and y were scaled."""
        side, (height, width) = self.image_px, image.shape[:2]
        if self.decoder.pad is None:
            return cv2.resize(image, (side, side)), (side / width, side / height)
        scale = min(side / width, side / height)
        square = np.full((side, side, 3), self.decoder.pad, np.uint8)
        small = cv2.resize(image, (max(1, int(width * scale)), max(1, int(height * scale))))
        # as YOLOX: the picture in the upper left, grey to its right and below
        square[: small.shape[0], : small.shape[1]] = small
        return square, (scale, scale)

    def _keep(
        self, boxes: torch.Tensor, scores: torch.Tensor, scale: tuple[float, float], shape: tuple[int, int]
    ) -> Detections:
        best, classes = scores.max(1)
        kept = best > LEAST_SCORE
        boxes, best, classes = boxes[kept], best[kept], classes[kept]
        # boxes of one class only suppress each other
        order = torchvision.ops.batched_nms(boxes, best, classes, self.decoder.nms_iou)[:MOST_BOXES]
        found = boxes[order].cpu().numpy() / np.array([*scale, *scale], np.float32)
        found = np.clip(found, 0, np.array([shape[1], shape[0]] * 2, np.float32))
        return Detections(found.astype(np.float32), classes[order].cpu().numpy(), best[order].float().cpu().numpy())

    def losses(self, batch: torch.Tensor, boxes: torch.Tensor, class_index: int) -> torch.Tensor:
        """(b,) minus the logarithm of the class's score, and how badly the box fits, at the best places.

        The places are the ten whose boxes fit the object best, weighted by how well; the gradient raises the true
        class's score there, and pulls the boxes to the object (Angelic Patches, CVPR 2023, for dense detectors).
        """
        found, scores = self.predict(batch)
        boxes = boxes.to(found)
        terms = []
        for k in range(len(batch)):
            # which places are meant is decided without a gradient; how well they fit has one
            fit = torchvision.ops.box_iou(found[k].detach(), boxes[k : k + 1])[:, 0]
            weight, places = fit.topk(min(10, len(fit)))
            # where no box overlaps at all, the places still count alike
            weight = (weight + 1e-3) / (weight + 1e-3).sum()
            # of a logarithm: at 0 there is no slope
            score = scores[k, places, class_index].clamp_min(1e-6)
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
        """What it sees in (h, w, 3) uint8 sRGB images of any sizes."""
        tensors = [torch.from_numpy(one).permute(2, 0, 1).float().div(255).to(self.device) for one in images]
        with torch.inference_mode():
            answers = self.module(tensors)
        found = []
        for one in answers:
            kept = (one["scores"] > LEAST_SCORE).nonzero()[:MOST_BOXES, 0]
            boxes, classes, scores = (one[key][kept].cpu().numpy() for key in ("boxes", "labels", "scores"))
            found.append(Detections(boxes.astype(np.float32), classes, scores.astype(np.float32)))
        return found

    def losses(self, batch: torch.Tensor, boxes: torch.Tensor, class_index: int) -> torch.Tensor:
        """(b,) the network's own training loss for the object as the only truth."""
        terms = []
        # torchvision's detectors give losses in training mode alone
        self.module.train()
        for layer in self.module.modules():
            if isinstance(layer, nn.BatchNorm2d | nn.Dropout):
                layer.eval()  # the network stays as it is
        try:
            for k in range(len(batch)):
                target = {
                    "boxes": boxes[k : k + 1].to(batch),
                    "labels": torch.tensor([class_index], device=batch.device),
                }
                terms.append(torch.stack(list(self.module([batch[k]], [target]).values())).sum())
        finally:
            self.module.eval()
        return torch.stack(terms)


def list_detectors() -> list[str]:
    """Names of torchvision's detectors that give boxes and nothing else."""
    names = torchvision.models.list_models(module=torchvision.models.detection)
    return [name for name in names if "mask" not in name and "keypoint" not in name]


def is_detector(model: str | None) -> bool:
    """Whether a name means a detector: one of torchvision's, or an ONNX file with the shape or the description of one.

    Raises:
        ToolkitError: an ONNX file cannot be read.
    """
    if model is None:
        return False
    if model.removeprefix(TORCHVISION_PREFIX) in list_detectors():
        return True
    path = Path(model.removeprefix(ONNX_PREFIX))
    if (model.startswith(ONNX_PREFIX) or path.suffix == ".onnx") and path.is_file():
        if read_labels_file(path).decoder is not None:
            return True
        graph = read_onnx(path)
        return _guess_decoder(read_output_shape(graph), graph.size) is not None
    return False


def load_detector(model: str, weights: Path | None = None, device: str = "auto") -> Detector:
    """Load a detector.

    Args:
        model: `torchvision:NAME`, or `onnx:FILE`, beside which a TOML may say `decoder`, `size` and `labels`.
        weights: state dict of one of torchvision's; by default as for classifiers.
        device: `auto`, `cpu` or `cuda`.

    Raises:
        ToolkitError: an unknown name, no weights, or a network that is no detector of a known family.
    """
    name = model.removeprefix(TORCHVISION_PREFIX)
    if name in list_detectors():
        return _load_torchvision(name, weights, device)
    path = Path(model.removeprefix(ONNX_PREFIX))
    if not model.startswith(ONNX_PREFIX) and path.suffix != ".onnx":
        raise FieldError(
            f"no detector: expected onnx:FILE or one of torchvision's: {', '.join(list_detectors())}", {"model": model}
        )
    if not path.is_file():
        raise FieldError("no such file", {"model": model})
    return _load_onnx(path, device)


def _load_onnx(path: Path, device: str) -> DenseDetector:
    graph, own, place = read_onnx(path), read_labels_file(path), choose_device(device)
    check_hash(graph.file, own)
    size = check_size(path, graph.size, own)
    network = OnnxNetwork(graph, size).to(place)
    with torch.no_grad():
        # two images: a graph that was fixed to one shows itself here
        answers = network(torch.zeros(2, 3, size, size, device=place))
    shape = tuple(answers.shape) if isinstance(answers, torch.Tensor) else ()
    family = own.decoder or _guess_decoder(shape, size)
    # a description that names another family than the shape has is wrong as well
    if family is None or _guess_decoder(shape, size) != family:
        found = "×".join(map(str, shape)) or f"{len(answers)} outputs"
        what = f"a {family}" if family else "a detector of a known family"
        raise FieldError(
            f"gives {found} for 2 images of {size} px, which is not {what}: expected {_expected(size)}"
            + ("; it looks like a classifier" if len(shape) == 2 else ""),
            {"model": f"{ONNX_PREFIX}{path.name}"},
        )
    decoder = _adapt(DECODERS[family], own)
    classes = (shape[2] if family == "yolox" else shape[1]) - 5
    labels = choose_labels(path, own.labels, list(COCO_LABELS), classes)
    return DenseDetector(
        arch=f"{ONNX_PREFIX}{path.name}", name=own.name or path.stem, module=network, decoder=decoder, labels=labels,
        weights=graph.file, device=place, image_px=size, untrainable=network.untrainable,
    )  # fmt: skip


def _adapt(decoder: Decoder, own: LabelsFile) -> Decoder:
    said = {key: getattr(own, key) for key in ("mean", "std", "channels")}
    return replace(decoder, **{key: value for key, value in said.items() if value is not None})


def _guess_decoder(shape: tuple[int | None, ...], size: int | None) -> str | None:
    if size is not None and len(shape) == 3 and shape[1] == sum((size // stride) ** 2 for stride in (8, 16, 32)):
        return "yolox"
    if size is not None and len(shape) == 4 and shape[2] == shape[3] == size // 16 and (shape[1] or 0) > 5:
        return "fastestdet"
    return None


def _expected(size: int) -> str:
    places = sum((size // stride) ** 2 for stride in (8, 16, 32))
    return f"images×{places}×(5 + classes) of YOLOX, or images×(5 + classes)×{size // 16}×{size // 16} of FastestDet"


def _load_torchvision(name: str, weights: Path | None, device: str) -> TorchvisionDetector:
    entry: torchvision.models.WeightsEnum = torchvision.models.get_model_weights(name).DEFAULT
    published = str(entry.url).rsplit("/", 1)[-1]
    named = None if weights is None else check_named(Path(weights))
    cached = cache_dir() / published
    local = named or find_in_folder(name, published) or (cached if cached.is_file() else None)
    file = open_weights(local or download(name, str(entry.url)))
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
