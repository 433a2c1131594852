"""Weather and corruptions: fog over the picture, what weather by depth is asked, ImageNet-C's operations."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, cast

from pydantic import field_validator

from toolkit.boosters.transforms import ImageTransform, Probability, Transform
from toolkit.core.config import Range, Rising
from toolkit.core.draws import RandomStreams
from toolkit.core.errors import ToolkitError
from toolkit.core.lazy import np, torch
from toolkit.core.rooms import ask_room
from toolkit.corruptions.catalogue import find_corruption, name_corruptions, parse_corruptions

if TYPE_CHECKING:
    from toolkit.rig.shading import DepthBuffer, LinearView

Named = tuple[tuple[str, int], ...]
"""(name, severity) of each that may be drawn, all as likely."""


class Fog(ImageTransform):
    """ImageNet-C's fog, of any strength: clouds over the picture, which know no depth.

    See `toolkit.corruptions.weather.add_fog`.

    Attributes:
        strength: of the clouds, in units of the image's full range; ImageNet-C's severities 1 to 5 have 1.5 to 3.
        smoothness: how fast the clouds' detail fades; ImageNet-C's have 2 to 1.4.
        probability: that a photograph is foggy.
    """

    strength: Annotated[Range, Rising(0, 5)] = (0.5, 3.0)
    smoothness: Annotated[Range, Rising(1.1, 4)] = (1.4, 2.0)
    probability: Probability = 0.3

    def draw(self, rng: "np.random.Generator", count: int) -> "tuple[np.ndarray, ...]":
        """Strength, smoothness, and the seed of the clouds."""
        strength, smoothness = rng.uniform(*self.strength, count), rng.uniform(*self.smoothness, count)
        return strength, smoothness, rng.integers(1 << 62, size=count)

    def apply(self, some: "torch.Tensor", drawn: "tuple[np.ndarray, ...]") -> "torch.Tensor":
        """Lay clouds over each, within [0, 1]."""
        from toolkit.corruptions.weather import add_fog

        foggy = [
            # photograph by photograph: strength and smoothness are the photograph's own
            add_fog(photo[None], (strength, smoothness), RandomStreams([int(seed)], "fog", 0, photo.device))
            for photo, strength, smoothness, seed in zip(some, *drawn, strict=True)
        ]
        return torch.cat(foggy).clamp(0, 1)


class ViewWeather(Transform):
    """Weather over a view by its depth, as the room of worlds has it: what is drawn for each view.

    Attributes:
        probability: that a view has weather.
    """

    stage = "view"

    @abstractmethod
    def lines(self) -> list[str]:
        """A line for each weather with the numbers behind it."""

    @abstractmethod
    def draw(self, views: "Sequence[DepthBuffer]", rng: "np.random.Generator") -> "tuple[torch.Tensor, torch.Tensor]":
        """Factor and offset of linear light, both (b, h, w, 3) float32: weathered light is factor · light + offset.

        They do not depend on the light, so that the gradient through weather is the factor: the true gradient.

        Args:
            views: depths of b views of equal size, in metres at the object's real size: see `DepthBuffer.scaled`.
            rng: draws.
        """


def read_weather(given: object) -> object:
    """The transform from words such as `fog:1-5`, made by the room of worlds; None and a transform as they are."""
    return given if given is None or isinstance(given, ViewWeather) else ask_room("weather")(given)


def find_depths(views: "Sequence[LinearView]", metres_per_unit: Sequence[float]) -> "list[DepthBuffer]":
    """How far away everything is at real size in views that have their depth, whose meshes' units are so long."""
    pairs = zip(views, metres_per_unit, strict=True)
    return [view.depth.scaled(metres) for view, metres in pairs if view.depth is not None]


def read_corruptions(given: object) -> object:
    """The transform from words such as `fog:3`; anything else as it is."""
    if isinstance(given, list | tuple) and all(isinstance(word, str) for word in given):
        return Corrupted(corruptions=tuple(parse_corruptions(given)))
    return given


DIFFERENTIABLE = frozenset((
    "gaussian_noise", "impulse_noise", "speckle_noise", "defocus_blur", "glass_blur", "motion_blur", "zoom_blur",
    "gaussian_blur", "snow", "frost", "fog", "brightness", "contrast", "elastic_transform", "spatter", "saturate",
))  # fmt: skip
"""What autograd goes through: noise, clouds, flakes and shifts are drawn without looking at the image."""
STRAIGHT_THROUGH = frozenset(("shot_noise", "pixelate", "jpeg_compression"))
"""What counts photons or rounds to whole levels: it acts forward, and backward counts as what it is near."""


class Corrupted(ImageTransform):
    """What is drawn for each photograph, after the camera: whether it is corrupted, by which, and the seed of that.

    Attributes:
        corruptions: (name, severity), at least one, of `toolkit.corruptions.catalogue.CORRUPTIONS`; each is as likely.
        probability: that a photograph is corrupted.
        gradients: version of what `corrupt_straight` makes; raised when the same settings give another gradient.
    """

    corruptions: Named
    probability: Probability = 0.5
    gradients: int = 2

    @field_validator("corruptions")
    @classmethod
    def _check_corruptions(cls, corruptions: Named) -> Named:
        if not corruptions:
            raise ToolkitError("expected at least one corruption, such as fog:3")
        for corruption in corruptions:
            find_corruption(*corruption)
        return corruptions

    def describe(self) -> str:
        """`fog:3, snow:1, probability 0.5`."""
        return f"{name_corruptions(self.corruptions)}, probability {self.probability:g}"

    def draw(self, rng: "np.random.Generator", count: int) -> "tuple[np.ndarray, ...]":
        """Which corruption, and the seed of it; as `toolkit.corruptions.batch.draw_corrupted`."""
        return rng.integers(len(self.corruptions), size=count), rng.integers(2**62, size=count)

    def apply(self, some: "torch.Tensor", drawn: "tuple[np.ndarray, ...]") -> "torch.Tensor":
        """Corrupt each, within [0, 1]; see `corrupt_straight`."""
        kinds, seeds = drawn
        for kind in np.unique(kinds):
            name, severity = self.corruptions[kind]
            which = np.flatnonzero(kinds == kind)
            index = torch.from_numpy(which).to(some.device)
            corrupted = corrupt_straight(some[index], name, severity, seeds[which].tolist())
            some = some.index_copy(0, index, corrupted)
        return some


def corrupt_straight(images: "torch.Tensor", name: str, severity: int, seeds: Sequence[int]) -> "torch.Tensor":
    """`toolkit.corruptions.batch.corrupt` with a gradient.

    The gradient of what is in `DIFFERENTIABLE` is the true gradient. What is in `STRAIGHT_THROUGH` acts forward, and
    backward counts as what it is near (Bengio et al. 2013; BPDA, Athalye et al. 2018): pixelate as its means, shot
    noise and JPEG as the identity.

    Args:
        images: (b, 3, h, w) float, sRGB-encoded in [0, 1].
        name: key of `CORRUPTIONS`.
        severity: 1 to 5.
        seeds: a seed per image.

    Returns:
        As `images`, what `corrupt` returns; differentiable.

    Raises:
        ToolkitError: nobody has said what gradient this corruption has.
    """
    from toolkit.corruptions.batch import corrupt
    from toolkit.corruptions.catalogue import CORRUPTIONS, choose_parameters
    from toolkit.corruptions.digital import pixelate_unrounded

    corruption = CORRUPTIONS[name]
    given = corruption.parameters[choose_parameters(*images.shape[-2:])][severity - 1]
    if name in DIFFERENTIABLE:
        return corruption.apply(images, given, RandomStreams(seeds, name, severity, images.device)).clamp(0, 1)
    # a corruption without a known gradient must not be trained with silently
    if name not in STRAIGHT_THROUGH:
        raise ToolkitError(
            f"corruption {name} has no gradient to train with: expected it in DIFFERENTIABLE or STRAIGHT_THROUGH of "
            "toolkit.boosters.transforms.weather"
        )
    near = pixelate_unrounded(images, cast(float, given)) if name == "pixelate" else images
    # forward near - near is exactly 0, and the gradient is that of `near`
    return corrupt(images, name, severity, seeds) + (near - near.detach())
