"""Networks in ONNX files: judged by ONNX Runtime, trained against through their reading in torch."""

import warnings
from typing import TYPE_CHECKING

import torch
from torch import nn

from toolkit.core.errors import ToolkitError, describe_failure
from toolkit.models.onnx_graph import OnnxGraph, free_batch, import_extra, set_input, start_session

if TYPE_CHECKING:
    from onnx import ModelProto
    from onnxruntime import InferenceSession

SAME_ANSWER = 1e-3
"""Of the largest output, how far two ways of running a graph may differ: far more than rounding, less than a fault."""
warnings.filterwarnings("ignore", "Using a non-tuple sequence", module=r"(onnx2torch|toolkit\.models)\..*")


class OnnxNetwork(nn.Module):
    """An ONNX graph as a module: (b, 3, h, w) normalised images to its outputs, one tensor or a tuple.

    Where no gradient is asked for, ONNX Runtime answers, which is two to five times as fast on a CPU; else, and on a
    GPU, the graph's reading in torch by onnx2torch. Both were seen to answer alike.

    Attributes:
        graph: the file.
        one_by_one: whether the graph takes one image at a time only.
        untrainable: why there is no reading in torch; else empty.
        takes_planes: it is quicker with its channels first.
    """

    takes_planes = True

    def __init__(self, graph: OnnxGraph, size: int) -> None:
        """Start the session and read the graph into torch.

        Args:
            graph: from `read_onnx`.
            size: side of the images.

        Raises:
            ToolkitError: ONNX Runtime cannot run it, or it takes another number of images than one.
        """
        super().__init__()
        self.graph = graph
        set_input(graph.model, graph.input_name, size=size)
        self._sample = torch.rand(2, 3, size, size, generator=torch.Generator().manual_seed(0))
        model, self._session, self.one_by_one = self._open()
        self.torch_module: nn.Module | None = None
        self.untrainable = self._read_into_torch(model)

    def _open(self) -> "tuple[ModelProto, InferenceSession, bool]":
        graph, path = self.graph, self.graph.file.path
        whole = start_session(graph.model, path)
        if graph.batch is None:
            return graph.model, whole, False
        if graph.batch == 1:
            singles = [self._ask(whole, self._sample[k : k + 1]) for k in range(2)]
            wanted = tuple(torch.cat(parts) for parts in zip(*singles, strict=True))
            freed = free_batch(graph)
            try:
                session = start_session(freed, path)
                if _are_alike(self._ask(session, self._sample), wanted):
                    return freed, session, False
            except ToolkitError:
                pass
            return graph.model, whole, True
        raise ToolkitError(f"{path}: takes exactly {graph.batch} images at once: export it with a free batch, or for 1")

    def _ask(self, session: "InferenceSession", batch: torch.Tensor) -> tuple[torch.Tensor, ...]:
        images = batch.detach().cpu().permute(0, 2, 3, 1) if self.graph.is_nhwc else batch.detach().cpu()
        array = images.to(torch.float16 if self.graph.is_half else torch.float32).contiguous().numpy()
        try:
            answers = session.run(None, {self.graph.input_name: array})
        except Exception as error:  # its classes are made at run time
            why = " ".join(str(error).split())[:200]
            raise ToolkitError(f"{self.graph.file.path}: ONNX Runtime fails at it: {why}") from None
        return tuple(torch.from_numpy(one).float().to(batch.device) for one in answers)

    def _read_into_torch(self, model: "ModelProto") -> str:
        if self.graph.is_quantised:
            return "its weights are quantised to integers, which pass on no gradient: export it in float"
        try:
            converter = import_extra("onnx2torch")
        except ToolkitError as error:
            return str(error)
        try:
            module = converter.convert(model).float().requires_grad_(False).eval()
        except NotImplementedError as error:
            return f"onnx2torch cannot read it: {' '.join(str(error).split())[:120]}"
        except Exception as error:  # a converter trips over a graph in its own way
            return f"onnx2torch fails at it: {describe_failure(error, 120)}"
        self.torch_module = module
        first = self._sample[:1]
        try:
            with torch.enable_grad():
                answers = self._run_torch(first.clone().requires_grad_())
        except Exception as error:
            self.torch_module = None
            return f"its reading in torch fails: {describe_failure(error, 120)}"
        if not _are_alike(answers, self._ask(self._session, first)):
            self.torch_module = None
            return "its reading by onnx2torch answers otherwise than ONNX Runtime"
        if not any(one.requires_grad for one in answers):
            self.torch_module = None
            return "no gradient leads from its outputs back to the image"
        return ""

    def _run_torch(self, batch: torch.Tensor) -> tuple[torch.Tensor, ...]:
        assert self.torch_module is not None
        answers = self.torch_module(batch.permute(0, 2, 3, 1) if self.graph.is_nhwc else batch)
        return (answers,) if isinstance(answers, torch.Tensor) else tuple(answers)

    def forward(self, batch: torch.Tensor) -> "torch.Tensor | tuple[torch.Tensor, ...]":
        """The outputs for (b, 3, h, w) normalised images."""
        in_torch = self.torch_module is not None and (torch.is_grad_enabled() or batch.is_cuda)
        parts = batch.split(1) if self.one_by_one else (batch,)
        answers = [self._run_torch(part) if in_torch else self._ask(self._session, part) for part in parts]
        joined = tuple(torch.cat(one) for one in zip(*answers, strict=True)) if len(answers) > 1 else answers[0]
        return joined[0] if len(joined) == 1 else joined


def _are_alike(found: tuple[torch.Tensor, ...], wanted: tuple[torch.Tensor, ...]) -> bool:
    if len(found) != len(wanted):
        return False
    for one, other in zip(found, wanted, strict=True):
        if one.shape != other.shape or not torch.isfinite(other).all():
            return False
        if (one.detach() - other).abs().max() > SAME_ANSWER * max(1.0, float(other.abs().max())):
            return False
    return True
