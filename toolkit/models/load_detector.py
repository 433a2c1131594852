"""Load a detector by name: one of torchvision's, or an ONNX graph of a family whose outputs the kit reads."""

from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import nn

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.models.coco import COCO_LABELS
from toolkit.models.dense_detectors import DECODERS, Decoder, DenseDetector
from toolkit.models.detector import Detector
from toolkit.models.find import ONNX_PREFIX, TORCHVISION_PREFIX
from toolkit.models.labels import LabelsFile, choose_labels, read_labels_file
from toolkit.models.network import check_hash, choose_device
from toolkit.models.torchvision_detectors import TorchvisionDetector
from toolkit.models.weights import cache_dir, check_named, download, find_in_folder, open_weights, read_state_dict

if TYPE_CHECKING:
    from torchvision.models import WeightsEnum


def list_detectors() -> list[str]:
    """Names of torchvision's detectors that give boxes and nothing else."""
    import torchvision

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
        from toolkit.models.onnx_graph import read_onnx, read_output_shape

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
    from toolkit.models.onnx_graph import check_size, read_onnx
    from toolkit.models.onnx_networks import OnnxNetwork

    graph, own, place = read_onnx(path), read_labels_file(path), choose_device(device)
    check_hash(graph.file, own)
    size = check_size(graph, own.crop_px or own.size)
    network = OnnxNetwork(graph, size).to(place)
    with torch.no_grad():
        answers = network(torch.zeros(2, 3, size, size, device=place))
    shape = tuple(answers.shape) if isinstance(answers, torch.Tensor) else ()
    family = own.decoder or _guess_decoder(shape, size)
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
        f"{ONNX_PREFIX}{path.name}", own.name or path.stem, network, decoder, labels, graph.file, place, size,
        network.untrainable,
    )  # fmt: skip


def _adapt(decoder: Decoder, own: LabelsFile) -> Decoder:
    from dataclasses import replace

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
    import torchvision

    entry: WeightsEnum = torchvision.models.get_model_weights(name).DEFAULT
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
        module.load_state_dict(state)
    except RuntimeError as error:
        why = " ".join(str(error).split())[:160]
        raise ToolkitError(f"{file.path} holds no weights of {name} with {len(labels)} classes: {why}") from None
    module = module.requires_grad_(False).eval().to(place)
    return TorchvisionDetector(f"{TORCHVISION_PREFIX}{name}", own.name or name, module, labels, file, place)
