"""Half precision where the hardware computes in it."""

from contextlib import AbstractContextManager, nullcontext


def mixed_precision(device: str) -> AbstractContextManager:
    """Autocast to bfloat16 where `device` (`cpu` or `cuda`) multiplies in it, else nothing.

    bfloat16, not float16: its range keeps the small gradients that float16 turns to zero. Only for training: evaluation
    stays in float32. Processors that merely emulate it would be slower than in float32.
    """
    import torch

    if device == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False):
        return torch.autocast("cuda", torch.bfloat16)
    if device == "cpu" and has_native_bfloat16():
        return torch.autocast("cpu", torch.bfloat16)
    return nullcontext()


def has_native_bfloat16() -> bool:
    """Whether this processor has instructions for products of bfloat16 (AVX-512 BF16 or AMX)."""
    import torch

    find = getattr(torch.cpu, "get_capabilities", None)  # torch 2.9 and later
    found = find() if find else {}
    return any(found.get(name, False) for name in ("avx512_bf16", "amx_bf16", "amx_tile"))
