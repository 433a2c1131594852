"""Weather in training: what is drawn over the views that a booster is trained on."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import field_validator

from toolkit.boosters.transforms import Probability
from toolkit.boosters.transforms.weather import Named, ViewWeather
from toolkit.core.config import Range, Rising
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.rooms.worlds.conditions import read_weathers
from toolkit.rooms.worlds.depth_weather import describe_weathers, make_weather
from toolkit.rooms.worlds.particles import DepthView

if TYPE_CHECKING:
    import torch

    from toolkit.rig.shading import DepthBuffer

TINT = 0.12
"""How much bluer or yellower than grey the air's light may be drawn."""


def read_words(given: object) -> object:
    """The transform from words such as `fog:1-5` or from its fields; anything else as it is."""
    if isinstance(given, Mapping):
        try:
            return Weathered(**given)
        except FieldError as error:
            raise error.within("weather") from None
    read = read_weathers(given)
    return Weathered(weathers=read) if isinstance(read, tuple) else read


class Weathered(ViewWeather):
    """Draws for each view: whether there is weather, which, how bright its air is, and its drops and flakes.

    Attributes:
        weathers: (name, severity), at least one, of `toolkit.rooms.worlds.depth_weather`; each is as likely.
        probability: that a view has weather.
        airlight: linear light of the air, in the picture's values; skies of `toolkit.rooms.worlds.sky` have 0.2 to 0.7.
    """

    weathers: Named
    probability: Probability = 0.5
    airlight: Annotated[Range, Rising(0, 10)] = (0.3, 0.8)

    @field_validator("weathers")
    @classmethod
    def _check_weathers(cls, weathers: Named) -> Named:
        if not weathers:
            raise ToolkitError("expected at least one weather, such as fog:3")
        for weather in weathers:
            make_weather(*weather)
        return weathers

    def describe(self) -> str:
        """`fog 3, rain 1, probability 0.5`."""
        named = ", ".join(f"{name} {severity}" for name, severity in self.weathers)
        return f"{named}, probability {self.probability:g}"

    def lines(self) -> list[str]:
        """A line for each weather with the numbers behind it."""
        return describe_weathers(self.weathers)

    def draw(self, views: "Sequence[DepthBuffer]", rng: np.random.Generator) -> "tuple[torch.Tensor, torch.Tensor]":
        """Factor and offset of linear light, see `ViewWeather.draw`."""
        return self.draw_light([DepthView(view.depth, view.camera, view.T_world_camera) for view in views], rng)

    def draw_light(self, views: Sequence[DepthView], rng: np.random.Generator) -> "tuple[torch.Tensor, torch.Tensor]":
        """The same over views that may know more of what they show, such as where the ground is."""
        import torch

        from toolkit.corruptions.batch import draw_corrupted

        height, width = views[0].depth_m.shape
        factor = np.ones((len(views), height, width, 3), np.float32)
        offset = np.zeros_like(factor)
        # each view has its own airlight, a grey with a tint from yellow to blue
        grey = rng.uniform(*self.airlight, len(views))
        tint = rng.uniform(-TINT, TINT, len(views))
        for which, name, severity, seeds in draw_corrupted(rng, len(views), self.weathers, self.probability):
            weather = make_weather(name, severity)
            for k, seed in zip(which, seeds, strict=True):
                airlight = grey[k] * np.array([1 - tint[k], 1, 1 + tint[k]])
                change = weather.change_light(views[k], airlight, np.random.default_rng(seed))
                factor[k], offset[k] = change.factor, change.offset
        return torch.from_numpy(factor), torch.from_numpy(offset)
