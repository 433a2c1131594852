"""Classifiers of two parts in a single file: an encoder that ends in features, and a head that names the classes."""

from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Literal

import torch
from torch import nn
from torch.nn.functional import linear

from toolkit.core.errors import FieldError, foreign_code
from toolkit.models.find import EXPORTED_SUFFIX
from toolkit.models.network import Classifier, blame_model, describe_answers

if TYPE_CHECKING:
    from onnx import NodeProto

    from toolkit.models.onnx_networks import OnnxNetwork

Tokens = Literal["first", "mean"]
"""Tokens of a transformer that represent the image: the first (the class token), or the mean of all."""
LEAST_LENGTH = 1e-12
"""Features are divided by their length, or by this if it is smaller."""
SOURCE_NOTES = ("stack_trace", "nn_module_stack", "source_fn_stack", "torch_fn", "from_node")
"""Torch's notes on the nodes of an exported program: lines and paths of code on this machine."""


@dataclass(frozen=True)
class AsEncoder:
    """Asks for a network that ends in features instead of classes.

    Attributes:
        tokens: see `ImageFeatures`.
        whole: keep the last layer of timm's and torchvision's networks, such as the projection of a CLIP tower.
    """

    tokens: Tokens | None = None
    whole: bool = False


class ImageFeatures(nn.Module):
    """An encoder as a module that gives a vector (b, d) for each image.

    A map (b, c, h, w) is averaged over all places; `tokens` selects or averages tokens (b, t, d), None refuses them.
    The first output (b, d) of several is taken, else the first. Errors name `arch`.
    """

    def __init__(self, encoder: nn.Module, tokens: Tokens | None, arch: str) -> None:
        super().__init__()
        self.encoder, self.tokens, self.arch = encoder, tokens, arch
        self.takes_planes = getattr(encoder, "takes_planes", False)

    def forward(self, batch: torch.Tensor) -> torch.Tensor:
        """(b, 3, h, w) normalised images to (b, d).

        Raises:
            ToolkitError: the encoder gives something else, or tokens while `tokens` is None.
        """
        answers = self.encoder(batch)
        parts = list(answers) if isinstance(answers, tuple | list) else [answers]
        if not parts or not all(isinstance(part, torch.Tensor) for part in parts):
            raise FieldError(f"gives {describe_answers(answers)}: expected features", {"model": self.arch})
        # (b, d, h, w) is averaged over places, (b, d) is taken as it is, (b, tokens, d) as `tokens` says
        found = parts[choose_output([part.ndim for part in parts])]
        if found.ndim == 4:
            return found.mean((2, 3))
        if found.ndim == 2:
            return found
        if found.ndim != 3:
            raise FieldError(f"gives {describe_answers(found)}: expected features", {"model": self.arch})
        if self.tokens is None:
            raise FieldError(
                f"gives {describe_answers(found)}, a vector for each token: give {{tokens}} 'first' (the class token) "
                "or 'mean'",
                {"model": self.arch},
            )
        return found[:, 0] if self.tokens == "first" else found.mean(1)


def number_features(count: int) -> list[str]:
    """Return names of the outputs of an encoder."""
    return [f"feature {index}" for index in range(count)]


def choose_output(axes: list[int]) -> int:
    """Return the index of the output that holds the features, by the outputs' numbers of axes."""
    return axes.index(2) if 2 in axes else 0


class Head(nn.Module):
    """A linear layer, `weight` (classes, d) and `bias` (classes,); `normalise`: of features divided by their length."""

    weight: torch.Tensor
    bias: torch.Tensor

    def __init__(self, weight: torch.Tensor, bias: torch.Tensor, normalise: bool) -> None:
        super().__init__()
        self.register_buffer("weight", weight.float())
        self.register_buffer("bias", bias.float())
        self.normalise = normalise

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """(b, d) to (b, classes)."""
        if self.normalise:
            features = features / features.norm(dim=1, keepdim=True).clamp_min(LEAST_LENGTH)
        return linear(features, self.weight, self.bias)


def file_suffix(encoder: Classifier) -> str:
    """Return the suffix of `join_head`'s file: an ONNX graph for an ONNX encoder, else a program of torch.export."""
    from toolkit.models.onnx_networks import OnnxNetwork

    return ".onnx" if isinstance(_inner(encoder), OnnxNetwork) else EXPORTED_SUFFIX


def join_head(encoder: Classifier, head: Head) -> bytes:
    """Return the content of a file with both parts, which any command loads as a classifier.

    Args:
        encoder: from `load_encoder`; it is moved to the CPU.
        head: for as many features.

    Raises:
        ToolkitError: torch cannot export the encoder.
    """
    inner = _inner(encoder)
    if file_suffix(encoder) == ".onnx":
        return _join_onnx(inner, encoder.module.tokens, head)  # type: ignore[arg-type]
    features = encoder.module.cpu()
    # a program for some number of images keeps that number
    count = getattr(inner, "count", None)
    if count is not None:
        features = ImageFeatures(inner.program, encoder.module.tokens, encoder.arch)  # type: ignore[arg-type]
    # both are in the mode for answers already, and an exported program cannot be told so
    joined = nn.Sequential(features, head.cpu()).requires_grad_(False)
    side = encoder.preprocessing.crop_px
    free = None if count is not None else ({0: torch.export.Dim("batch")},)
    with foreign_code(blame_model(encoder.arch, "export it to ONNX, as torch.export cannot save it")):
        program = torch.export.export(joined, (torch.zeros(count or 2, 3, side, side),), dynamic_shapes=free)
    # where the code lay on this machine is no part of a network: it would change the file's hash
    for node in program.graph.nodes:
        for name in SOURCE_NOTES:
            node.meta.pop(name, None)
    content = BytesIO()
    torch.export.save(program, content)
    return content.getvalue()


def _inner(encoder: Classifier) -> nn.Module:
    return encoder.module.encoder  # type: ignore[return-value]


def _join_onnx(network: "OnnxNetwork", tokens: Tokens | None, head: Head) -> bytes:
    """Append the nodes of a head to a graph; they mean the same in every version from 8 on."""
    from toolkit.models.onnx_graphs import draw_sample, import_extra

    onnx = import_extra("onnx")
    model = onnx.ModelProto()
    model.CopyFrom(network.graph.model)
    side = next(entry for entry in model.graph.input if entry.name == network.graph.input_name)
    # the output with features, by a run on a sample: its number of axes decides how it is reduced
    px = side.type.tensor_type.shape.dim[2].dim_value
    with torch.no_grad():
        answers = network(torch.from_numpy(draw_sample(px)))
    parts = [answers] if isinstance(answers, torch.Tensor) else list(answers)
    which = choose_output([part.ndim for part in parts])
    nodes, stored = _list_nodes(model.graph.output[which].name, parts[which].ndim, tokens, head)
    for name, value in stored.items():
        model.graph.initializer.append(onnx.numpy_helper.from_array(value.numpy(), name))
    model.graph.node.extend(nodes)
    # the head's logits become the only output, for the same batch
    del model.graph.output[:]
    batch = side.type.tensor_type.shape.dim[0]
    shape = [batch.dim_value or batch.dim_param or "batch", len(head.bias)]
    model.graph.output.append(onnx.helper.make_tensor_value_info("head_logits", onnx.TensorProto.FLOAT, shape))
    # names of the encoder's own classes
    del model.metadata_props[:]
    too_large = f"{network.graph.file.path}: with its head it is larger than the 2 GB of an ONNX file"
    with foreign_code(lambda _: FieldError(too_large, {})):
        return bytes(model.SerializeToString())


def _list_nodes(
    name: str, axes: int, tokens: Tokens | None, head: Head
) -> "tuple[list[NodeProto], dict[str, torch.Tensor]]":
    """Return the nodes from the output `name` of so many axes to `head_logits`, and the tensors that they use."""
    from toolkit.models.onnx_graphs import FLOAT, import_extra

    make = import_extra("onnx").helper.make_node
    # half-precision encoders end in half: the head computes in float
    nodes = [make("Cast", [name], ["head_float"], to=FLOAT)]
    stored = {"head_weight": head.weight.T.contiguous(), "head_bias": head.bias}
    last = "head_float"

    def add(kind: str, *more: str, **settings: object) -> None:
        nonlocal last
        made = f"head_{len(nodes)}"
        nodes.append(make(kind, [last, *more], [made], **settings))
        last = made

    # features of an image: the class token, the mean over tokens or places, or the output as it is
    if axes == 3 and tokens == "first":
        stored["head_first"] = torch.tensor(0)
        add("Gather", "head_first", axis=1)
    elif axes > 2:
        if axes == 3:
            # GlobalAveragePool wants channels first, tokens come last
            add("Transpose", perm=[0, 2, 1])
        add("GlobalAveragePool")
        add("Flatten", axis=1)
    if head.normalise:
        features = last
        stored["head_ones"], stored["head_least"] = torch.ones(head.weight.shape[1], 1), torch.tensor(LEAST_LENGTH)
        # the sum of squares as a product with ones: ReduceSum changed between versions
        add("Mul", features)
        add("MatMul", "head_ones")
        add("Sqrt")
        add("Max", "head_least")
        length, last = last, features
        add("Div", length)
    add("MatMul", "head_weight")
    nodes.append(make("Add", [last, "head_bias"], ["head_logits"]))
    return nodes, stored
