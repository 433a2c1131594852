"""Weather from depth between the camera and views of an object: what `toolkit.worlds` lays over its renders."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from toolkit.boosters.parts.base import Range, check_probability, check_range
from toolkit.core.errors import ToolkitError
from toolkit.rig.linear_view import LinearView
from toolkit.worlds.conditions import read_weathers
from toolkit.worlds.depth_view import DepthView

if TYPE_CHECKING:
    import torch

TINT = 0.12
"""How much bluer or yellower than grey the air's light may be drawn."""


def read_words(given: object) -> object:
    """The part from words such as `fog:1-5`; anything else as it is."""
    read = read_weathers(given)
    return Weathered(read) if isinstance(read, tuple) else read


def find_depths(views: Sequence[LinearView], metres_per_unit: Sequence[float]) -> list[DepthView]:
    """How far away everything is at real size in views that have their depth, whose meshes' units are so long."""
    buffers = [view.depth for view in views]
    return [
        DepthView.of_model(one.depth, one.camera, one.T_world_camera, metres)
        for one, metres in zip(buffers, metres_per_unit, strict=True)
        if one is not None
    ]


@dataclass(frozen=True)
class Weathered:
    """What is drawn for each view: whether there is weather, which, how bright its air is, and its drops and flakes.

    Attributes:
        weathers: (name, severity), at least one, of `toolkit.worlds.weather`; each is as likely.
        probability: that a view has weather.
        airlight: linear light of the air, in the picture's values; skies of `toolkit.worlds.sky` have 0.2 to 0.7.
    """

    stage: ClassVar = "view"
    weathers: tuple[tuple[str, int], ...]
    probability: float = 0.5
    airlight: Range = (0.3, 0.8)

    def __post_init__(self) -> None:
        from toolkit.worlds.weather import make_weather

        check_probability("weather", self.probability)
        check_range("airlight", self.airlight, 0, 10)
        if not self.weathers:
            raise ToolkitError("expected at least one weather, such as fog:3")
        for weather in self.weathers:
            make_weather(*weather)

    def describe(self) -> str:
        """`fog 3, rain 1, probability 0.5`."""
        named = ", ".join(f"{name} {severity}" for name, severity in self.weathers)
        return f"{named}, probability {self.probability:g}"

    def rows(self) -> list[str]:
        """A line for each weather with the numbers behind it."""
        from toolkit.worlds.weather import describe_weathers

        return describe_weathers(self.weathers)

    def draw(self, views: Sequence[DepthView], rng: np.random.Generator) -> "tuple[torch.Tensor, torch.Tensor]":
        """Factor and offset of linear light, both (b, h, w, 3) float32: weathered light is factor · light + offset.

        They do not depend on the light, so that the gradient through weather is the factor: the true one.

        Args:
            views: depths of b views of one size, at the object's real size: see `DepthView.of_model`.
            rng: draws.
        """
        import torch

        from toolkit.corruptions.request import draw_corrupted
        from toolkit.worlds.weather import make_weather

        height, width = views[0].depth_m.shape
        factor = np.ones((len(views), height, width, 3), np.float32)
        offset = np.zeros_like(factor)
        grey = rng.uniform(*self.airlight, len(views))
        tint = rng.uniform(-TINT, TINT, len(views))
        for which, name, severity, seeds in draw_corrupted(rng, len(views), self.weathers, self.probability):
            weather = make_weather(name, severity)
            for k, seed in zip(which, seeds, strict=True):
                airlight = grey[k] * np.array([1 - tint[k], 1, 1 + tint[k]])
                change = weather.change_light(views[k], airlight, np.random.default_rng(seed))
                factor[k], offset[k] = change.factor, change.offset
        return torch.from_numpy(factor), torch.from_numpy(offset)
