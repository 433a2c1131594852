"""torchvision without torch's compiler, sympy and triton, which take 160 MB and 1.3 of the 1.5 s of its import.

Its `roi_align` needs a function of the compiler; the compiler is loaded when that, or another, is called.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType


@contextmanager
def _without_compiler() -> Iterator[None]:
    name = "torch._dynamo.utils"
    if name in sys.modules or "torchvision" in sys.modules:
        yield
        return
    # a module in its place, until something of it is used
    stand_in = ModuleType(name)

    def load(wanted: str) -> object:
        if wanted.startswith("__"):  # the import's own questions
            raise AttributeError(wanted)
        sys.modules.pop(name, None)
        import torch._dynamo.utils

        return getattr(torch._dynamo.utils, wanted)

    def is_compile_supported(device_type: str) -> object:
        return load("is_compile_supported")(device_type)  # type: ignore[operator]

    stand_in.is_compile_supported = is_compile_supported  # type: ignore[attr-defined]
    stand_in.__getattr__ = load  # type: ignore[method-assign]
    sys.modules[name] = stand_in
    try:
        yield
    finally:
        if sys.modules.get(name) is stand_in:
            del sys.modules[name]


with _without_compiler():
    import torchvision as torchvision
