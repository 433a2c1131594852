"""Half precision where the hardware computes in it, and where a network can be trained in it."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING

from toolkit.models.architectures import build_network

if TYPE_CHECKING:
    import torch


def mixed_precision(device: str) -> AbstractContextManager[object]:
    """Autocast to bfloat16 where `device` (`cpu` or `cuda`) multiplies in it, else nothing.

    bfloat16, not float16: its range keeps the small gradients that float16 turns to zero. Only for training: evaluation
    stays in float32. Processors that merely emulate it would be slower than in float32.
    """
    import torch

    if device == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False):
        return torch.autocast("cuda", torch.bfloat16)
    if device == "cpu" and has_native_bfloat16():
        return _bfloat16_on_cpu()
    return nullcontext()


@contextmanager
def _bfloat16_on_cpu() -> Iterator[None]:
    import torch

    from toolkit.models.depthwise import FastDepthwise

    with torch.autocast("cpu", torch.bfloat16), FastDepthwise():
        yield


def has_native_bfloat16() -> bool:
    """Whether this processor has instructions for products of bfloat16 (AVX-512 BF16 or AMX)."""
    import torch

    find = getattr(torch.cpu, "get_capabilities", None)  # torch 2.9 and later
    found = find() if find else {}
    return any(found.get(name, False) for name in ("avx512_bf16", "amx_bf16", "amx_tile"))


SMALL_KERNEL = 3


def choose_precision(arch: str, image_px: int, device: str) -> str:
    """`bfloat16` where the device computes in it and the network's convolutions bear it, else `float32`."""
    if isinstance(mixed_precision(device), nullcontext):
        return "float32"
    return "float32" if device == "cpu" and has_unseen_taps(arch, image_px) else "bfloat16"


def autocast(precision: str, device: str) -> AbstractContextManager[object]:
    """The context of a forward pass in `choose_precision`'s precision."""
    return mixed_precision(device) if precision == "bfloat16" else nullcontext()


def has_unseen_taps(arch: str, image_px: int) -> bool:
    """Whether some convolution gets a picture so small that parts of its kernel only ever meet the padding.

    The gradient of such parts is zero; oneDNN's in bfloat16 (torch 2.15) is whatever was in memory, mostly huge.
    Measured over 1095 shapes: wrong only where the picture's side is below the stride, or, for kernels above 3,
    below half the kernel. A gradient that is taken by the image, as patches are trained, is right everywhere.
    """
    import torch

    found = []

    def look(layer: "torch.nn.Conv2d", inputs: "tuple[torch.Tensor]", _: object) -> None:
        for side, kernel, stride in zip(inputs[0].shape[-2:], layer.kernel_size, layer.stride, strict=True):
            least = max(stride, kernel // 2 + 1 if kernel > SMALL_KERNEL else 1)
            found.append(side < least)

    with torch.device("meta"):
        module = build_network(arch, 2).train()
        for layer in module.modules():
            if isinstance(layer, torch.nn.Conv2d):
                layer.register_forward_hook(look)
        module(torch.zeros(2, 3, image_px, image_px))
    return any(found)
