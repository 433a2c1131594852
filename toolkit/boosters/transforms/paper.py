"""What happens to the paper in the scene: light on it alone, and the clear tape that holds it."""

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from toolkit.boosters.transforms.base import PaperTransform, Probability, as_factors
from toolkit.core.config import Range, Rising

if TYPE_CHECKING:
    import numpy as np
    import torch


class LightRanges(PaperTransform):
    """What is drawn, uniformly, for each image; mild, since the booster is to learn the class first.

    Attributes:
        exposure: factor on sRGB-encoded values.
        contrast: factor on their distance from middle grey, below 1 for print and haze.
        tint: each channel's own factor lies within 1 ± tint.
        probability: that an image's patch is lit apart from it.
    """

    exposure: Annotated[Range, Rising(0.001, 100)] = (0.65, 1.2)
    contrast: Annotated[Range, Rising(0.001, 100)] = (0.75, 1.0)
    tint: Annotated[float, Field(ge=0, lt=1)] = 0.06
    probability: Probability = 1.0

    def light(self, paper: "torch.Tensor", mask: "torch.Tensor", rng: "np.random.Generator") -> "torch.Tensor":
        """One light for each image."""
        import numpy as np
        import torch

        count = len(paper)
        gain = rng.uniform(*self.exposure, (count, 1)) * rng.uniform(1 - self.tint, 1 + self.tint, (count, 3))
        contrast = rng.uniform(*self.contrast, (count, 1))
        acting = self.draw_acting(rng, count)[:, None]
        # contrast about middle grey, then gain: g (c (x - 1/2) + 1/2) = (g c) x + g (1 - c) / 2
        slope = np.where(acting, gain * contrast, 1)
        offset = np.where(acting, gain * (1 - contrast) / 2, 0)
        slope_offset = torch.as_tensor(np.stack([slope, offset]), dtype=paper.dtype, device=paper.device)
        # the paper is premultiplied by its mask, so that the offset has to be as well
        return paper * slope_offset[0, :, :, None, None] + mask * slope_offset[1, :, :, None, None]


class TapeGlare(PaperTransform):
    """Clear tape over the paper: its shine, and now and then a strip through which nothing is seen.

    Lengths are shares of the patch's side as it is seen.

    Attributes:
        width: standard deviation of the shine across.
        length: standard deviation along; as short as the width it is the image of a lamp, long it is a band.
        strength: of its middle; 1 is white, whatever lies below.
        probability: that an image has such shine.
        strip_width: of a strip that hides the patch: a fold of tape, a strap, a finger's shadow edge.
        strip_probability: that an image has one.
    """

    width: Annotated[Range, Rising(0.005, 5)] = (0.05, 0.16)
    length: Annotated[Range, Rising(0.005, 50)] = (0.15, 1.2)
    strength: Annotated[Range, Rising(0, 1)] = (0.5, 1.0)
    probability: Probability = 0.3
    strip_width: Annotated[Range, Rising(0, 1)] = (0.05, 0.15)
    strip_probability: Probability = 0.1

    def light(self, paper: "torch.Tensor", mask: "torch.Tensor", rng: "np.random.Generator") -> "torch.Tensor":
        """Lay shine and strips over drawn patches."""
        import numpy as np

        count = len(paper)
        # all is drawn for every image, shine or none, so that each number keeps its place in the stream
        shines, hides = self.draw_acting(rng, count), rng.random(count) < self.strip_probability
        width, length = rng.uniform(*self.width, count), rng.uniform(*self.length, count)
        strength, colour = rng.uniform(*self.strength, count), rng.uniform(0.94, 1.0, (count, 3))
        angle, centre = rng.uniform(0, np.pi, count), rng.uniform(-0.5, 0.5, (count, 2))
        strip_angle, strip_place = rng.uniform(0, np.pi, count), rng.uniform(-0.5, 0.5, count)
        strip_width = rng.uniform(*self.strip_width, count)
        strip_colour = rng.uniform(0.1, 0.85, (count, 1)) * rng.uniform(0.93, 1.07, (count, 3))
        if shines.any():
            x, y, _ = _measure(mask, angle, centre)
            shine = (-((x / as_factors(length, x)) ** 2 + (y / as_factors(width, y)) ** 2) / 2).exp()
            paper = _cover(paper, mask, shine * as_factors(strength * shines, x), colour)
        if hides.any():
            _, y, pixel = _measure(mask, strip_angle, np.stack([np.zeros(count), strip_place], axis=1))
            inside = ((as_factors(strip_width / 2, y) - y.abs()) / pixel + 0.5).clamp(0, 1)  # one pixel of soft edge
            paper = _cover(paper, mask, inside * as_factors(hides.astype(float), y), strip_colour)
        return paper


def _measure(
    mask: "torch.Tensor", angle: "np.ndarray", centre: "np.ndarray"
) -> tuple["torch.Tensor", "torch.Tensor", "torch.Tensor"]:
    """Coordinates (b, 1, m, m) along and across a direction, from `centre`, and a pixel's size.

    All are shares of the patch's side, here the root of its area; its own middle is (0, 0).
    """
    import numpy as np
    import torch

    m = mask.shape[-1]
    places = torch.arange(m, dtype=mask.dtype, device=mask.device) + 0.5
    x, y = places.view(1, 1, 1, m), places.view(1, 1, m, 1)
    # a patch that is out of the frame covers nothing: its area must not divide by 0
    area = mask.sum(dim=(1, 2, 3), keepdim=True).clamp_min(1)
    middle_x, middle_y = ((mask * v).sum(dim=(1, 2, 3), keepdim=True) / area for v in (x, y))
    # a pixel against the patch's side, which is the root of its area
    pixel = area.rsqrt()
    x, y = (x - middle_x) * pixel, (y - middle_y) * pixel
    cosine, sine = as_factors(np.cos(angle), mask), as_factors(np.sin(angle), mask)
    along = x * cosine + y * sine - as_factors(centre[:, 0], mask)
    return along, y * cosine - x * sine - as_factors(centre[:, 1], mask), pixel


def _cover(paper: "torch.Tensor", mask: "torch.Tensor", alpha: "torch.Tensor", colour: "np.ndarray") -> "torch.Tensor":
    """Paint `colour` over premultiplied paper where the patch is; alpha 0 leaves a value exactly as it was."""
    return paper + alpha * (mask * as_factors(colour, paper) - paper)
