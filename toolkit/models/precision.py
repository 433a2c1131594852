"""Half precision where the hardware computes in it, and where a network can be trained in it."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

import torch
from torch.nn import functional
from torch.overrides import TorchFunctionMode

from toolkit.models.architectures import build_network

Sides = tuple[int, int]
SMALL_KERNEL = 3


class FastDepthwise(TorchFunctionMode):
    """Speeds up gradients of images through frozen depthwise layers in bfloat16; the numbers are the same.

    With torch 2.15 and AVX-512 BF16, 16 images of 144 × 56 × 56 take 15 ms instead of 71.
    """

    def __torch_function__(
        self, function: Any, types: Sequence[type], arguments: Sequence[Any] = (),
        named: Mapping[str, Any] | None = None,
    ) -> Any:  # fmt: skip
        """Called for every operation; only convolutions are looked at."""
        named = named or {}
        return _convolve(*arguments, **named) if function is torch.conv2d else function(*arguments, **named)


def _convolve(
    input: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor | None = None, stride: int | Sides = 1,
    padding: int | str | Sides = 0, dilation: int | Sides = 1, groups: int = 1,
) -> torch.Tensor:  # fmt: skip
    """`torch.conv2d`, by its names."""
    steps, margins = _pair(stride), (0, 0) if isinstance(padding, str) else _pair(padding)
    # only the slow case, for which the backward below is right
    is_meant = (
        torch.is_grad_enabled() and input.requires_grad and input.dtype == torch.bfloat16
        and not weight.requires_grad and (bias is None or not bias.requires_grad)
        and groups == len(weight) == input.shape[-3] and max(steps) > 1 and _pair(dilation) == (1, 1)
        and not isinstance(padding, str) and all(m < side for m, side in zip(margins, weight.shape[2:], strict=True))
    )  # fmt: skip
    if is_meant:
        found: torch.Tensor = _Strided.apply(input, weight, bias, steps, margins)  # type: ignore[no-untyped-call]
        return found
    return torch.conv2d(input, weight, bias, stride, padding, dilation, groups)  # type: ignore[arg-type]


def _pair(given: int | Sequence[int]) -> Sides:
    first, last = (given, given) if isinstance(given, int) else (given[0], given[-1])
    return first, last


class _Strided(torch.autograd.Function):
    """A strided layer, whose gradient is spread out by the stride and then convolved without a stride."""

    @staticmethod
    def forward(
        context: Any, image: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor | None, stride: Sides,
        padding: Sides,
    ) -> torch.Tensor:  # fmt: skip
        context.save_for_backward(weight)
        context.rest = image.shape, stride, padding
        return functional.conv2d(image, weight, bias, stride, padding, groups=len(weight))

    @staticmethod
    def backward(context: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor, None, None, None, None]:
        (gradient,), (weight,), (shape, stride, padding) = gradients, context.saved_tensors, context.rest
        sides, margins = weight.shape[2:], [side - 1 - pad for side, pad in zip(weight.shape[2:], padding, strict=True)]
        dense = [length + 2 * pad - side + 1 for length, pad, side in zip(shape[2:], padding, sides, strict=True)]
        spread = gradient.new_zeros(*shape[:2], *dense).contiguous(memory_format=torch.channels_last)
        # a strided convolution keeps every stride-th place: elsewhere the gradient is 0
        spread[..., :: stride[0], :: stride[1]] = gradient
        # the gradient of a correlation is the correlation with the kernel turned by 180 degrees
        turned = weight.to(gradient.dtype).flip(2, 3)
        return functional.conv2d(spread, turned, padding=margins, groups=len(weight)), None, None, None, None


def mixed_precision(device: str) -> AbstractContextManager[object]:
    """Autocast to bfloat16 where `device` (`cpu` or `cuda`) multiplies in it, else nothing.

    bfloat16, not float16: its range keeps the small gradients that float16 turns to zero. Only for training: evaluation
    stays in float32. Processors that merely emulate it would be slower than in float32.
    """
    if device == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False):
        return torch.autocast("cuda", torch.bfloat16)
    if device == "cpu" and has_native_bfloat16():
        return _bfloat16_on_cpu()
    return nullcontext()


@contextmanager
def _bfloat16_on_cpu() -> Iterator[None]:
    with torch.autocast("cpu", torch.bfloat16), FastDepthwise():
        yield


def has_native_bfloat16() -> bool:
    """Whether this processor has instructions for products of bfloat16 (AVX-512 BF16 or AMX)."""
    if not hasattr(torch.cpu, "get_capabilities"):  # torch 2.9 has a function for each
        return bool(torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported())
    found = torch.cpu.get_capabilities()
    return any(found.get(name, False) for name in ("avx512_bf16", "amx_bf16", "amx_tile"))


def choose_precision(arch: str, image_px: int, device: str) -> str:
    """`bfloat16` where the device computes in it and the network's convolutions bear it, else `float32`."""
    if isinstance(mixed_precision(device), nullcontext):
        return "float32"
    return "float32" if device == "cpu" and has_unseen_taps(arch, image_px) else "bfloat16"


def autocast(precision: str, device: str) -> AbstractContextManager[object]:
    """Return the context of a forward pass in `choose_precision`'s precision."""
    return mixed_precision(device) if precision == "bfloat16" else nullcontext()


def has_unseen_taps(arch: str, image_px: int) -> bool:
    """Whether some convolution gets a picture so small that parts of its kernel only ever meet the padding.

    The gradient of such parts is zero; oneDNN's in bfloat16 (torch 2.15) is whatever was in memory, mostly huge.
    Measured over 1095 shapes: wrong only where the picture's side is below the stride, or, for kernels above 3,
    below half the kernel. A gradient that is taken by the image, as patches are trained, is right everywhere.
    """
    found = []

    # the smallest picture whose every kernel part meets a pixel, by side
    def look(layer: torch.nn.Conv2d, inputs: tuple[torch.Tensor], _: object) -> None:
        for side, kernel, stride in zip(inputs[0].shape[-2:], layer.kernel_size, layer.stride, strict=True):
            least = max(stride, kernel // 2 + 1 if kernel > SMALL_KERNEL else 1)
            found.append(side < least)

    # shapes alone: on the device "meta" nothing is computed
    with torch.device("meta"):
        module = build_network(arch, 2).train()
        for layer in module.modules():
            if isinstance(layer, torch.nn.Conv2d):
                layer.register_forward_hook(look)
        module(torch.zeros(2, 3, image_px, image_px))
    return any(found)
