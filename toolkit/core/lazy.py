"""Libraries that take long to load: each is imported when one of its names is first used.

`from toolkit.core.lazy import np, torch` loads neither. Annotations with their names stay in quotes.
"""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any


class _Lazy(ModuleType):
    """Stands for the module of its name."""

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self.__name__), name)


if TYPE_CHECKING:
    import cv2 as cv2
    import numpy as np
    import scipy as scipy
    import shapely as shapely
    import torch as torch
    import torch.nn.functional as F
else:
    cv2, np, scipy, shapely, torch = map(_Lazy, ("cv2", "numpy", "scipy", "shapely", "torch"))
    F = _Lazy("torch.nn.functional")
