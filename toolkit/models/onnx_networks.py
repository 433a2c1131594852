"""Networks in ONNX files: run by ONNX Runtime, and converted to torch for gradients."""

import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn

from toolkit.core.child import limit_memory
from toolkit.core.errors import ToolkitError, describe_failure, foreign_code
from toolkit.models.onnx_graphs import (
    OnnxGraph,
    are_alike,
    draw_sample,
    import_extra,
    join_answers,
    run_session,
    start_session,
    try_graph,
)
from toolkit.models.weights import TRYING_BYTES

if TYPE_CHECKING:
    from onnx import ModelProto
    from onnxruntime import InferenceSession

warnings.filterwarnings("ignore", "Using a non-tuple sequence", module=r"(onnx2torch|toolkit\.models)\..*")


class OnnxNetwork(nn.Module):
    """An ONNX graph as a module: (b, 3, h, w) normalised images to its outputs, a tensor or a tuple.

    ONNX Runtime answers without gradients, two to five times as fast on a CPU. With gradients, and on a GPU, the graph
    runs in torch, converted by onnx2torch. Both are compared when the network is loaded.

    Attributes:
        graph: the file.
        is_single: whether the graph takes a single image at a time.
        untrainable: why there is no conversion to torch; else empty.
        is_cut: whether only a part of the graph is converted.
        takes_planes: it is faster with its channels first.
    """

    takes_planes = True

    def __init__(
        self, graph: OnnxGraph, size: int, cut: "Callable[[ModelProto], ModelProto | None] | None" = None
    ) -> None:
        """Start the session and convert the graph to torch.

        Args:
            graph: from `read_onnx`.
            size: side of the images.
            cut: returns the part of the graph for `raw`, if the whole has no useful gradient.

        Raises:
            ToolkitError: as `try_graph`.
        """
        super().__init__()
        self.graph = graph
        self.torch_module: nn.Module | None = None
        # the first run is in a child process: from here on the graph is known to end
        self.is_single = not try_graph(graph, size, torch.get_num_threads())
        with limit_memory(TRYING_BYTES + 6 * graph.model.ByteSize()):
            self._session = start_session(graph.model, graph.file.path, torch.get_num_threads())
            self.is_cut = cut is not None
            part = graph.model if cut is None else cut(graph.model)
            if part is None:
                self.untrainable = "the boxes and scores before its selection are not found in its graph"
                return
            self.untrainable = self._read_into_torch(part, torch.from_numpy(draw_sample(size)[:1]))

    def _ask(self, batch: torch.Tensor, session: "InferenceSession | None" = None) -> tuple[np.ndarray, ...]:
        pixels = batch.detach().cpu().float().contiguous().numpy()
        return run_session(session or self._session, self.graph, pixels)

    def _read_into_torch(self, model: "ModelProto", image: torch.Tensor) -> str:
        if self.graph.is_quantised:
            return "its weights are quantised to integers, which pass on no gradient: export it in float"
        try:
            converter = import_extra("onnx2torch")
        except ToolkitError as error:
            return str(error)
        # a conversion counts only if it answers as the graph does, and passes on a gradient
        try:
            with foreign_code(lambda error: ToolkitError(f"onnx2torch fails at it: {describe_failure(error, 120)}")):
                self.torch_module = converter.convert(model).float().requires_grad_(False).eval()
                with torch.enable_grad():
                    answers = self._run_torch(image.clone().requires_grad_())
        except ToolkitError as error:
            self.torch_module = None
            return str(error)
        session = start_session(model, self.graph.file.path, torch.get_num_threads()) if self.is_cut else None
        if not are_alike(tuple(answer.detach().numpy() for answer in answers), self._ask(image, session)):
            self.torch_module = None
            return "its conversion by onnx2torch gives other answers than ONNX Runtime"
        if not any(answer.requires_grad for answer in answers):
            self.torch_module = None
            return "no gradient leads from its outputs back to the image"
        return ""

    def _run_torch(self, batch: torch.Tensor) -> tuple[torch.Tensor, ...]:
        assert self.torch_module is not None
        answers = self.torch_module(batch.permute(0, 2, 3, 1) if self.graph.is_nhwc else batch)
        return (answers,) if isinstance(answers, torch.Tensor) else tuple(answers)

    def forward(self, batch: torch.Tensor) -> "torch.Tensor | tuple[torch.Tensor, ...]":
        """Return the outputs for (b, 3, h, w) normalised images."""
        if self.torch_module is not None and not self.is_cut and (torch.is_grad_enabled() or batch.is_cuda):
            return self.raw(batch)
        answers = join_answers(self.graph, [self._ask(part) for part in self._split(batch)])
        return _unwrap([torch.from_numpy(answer).float().to(batch.device) for answer in answers])

    def raw(self, batch: torch.Tensor) -> "torch.Tensor | tuple[torch.Tensor, ...]":
        """Return the outputs of the conversion to torch, of the whole graph or of its part."""
        return _unwrap([torch.cat(parts) for parts in zip(*map(self._run_torch, self._split(batch)), strict=True)])

    def _split(self, batch: torch.Tensor) -> Sequence[torch.Tensor]:
        return batch.split(1) if self.is_single else (batch,)


def _unwrap(answers: list[torch.Tensor]) -> "torch.Tensor | tuple[torch.Tensor, ...]":
    return answers[0] if len(answers) == 1 else tuple(answers)
