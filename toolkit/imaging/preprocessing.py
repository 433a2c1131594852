"""Preprocess a photograph for a network: resize the short side, cut the middle, normalise."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from toolkit.core.lazy import np

if TYPE_CHECKING:
    from torchvision.transforms._presets import ImageClassification

LONGEST_WHOLE = 8


@dataclass(frozen=True)
class Preprocessing:
    """Resize, crop and normalisation of a network's images.

    Attributes:
        resize_px: length of the short side after resizing; of both sides with `squash`.
        crop_px: side of the central square that is kept.
        mean, std: mean and standard deviation of sRGB-encoded values in [0, 1], in the order of `channels`.
        filter_name: Pillow's name of the resampling filter, always antialiased.
        channels: order in which the network wants the colours, `RGB` or `BGR`.
        squash: whether the whole image is resized to a square, whatever its aspect ratio.
    """

    resize_px: int
    crop_px: int
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    filter_name: str = "BILINEAR"
    channels: str = "RGB"
    squash: bool = False

    def describe(self) -> str:
        """Describe it in a line."""
        order = "" if self.channels == "RGB" else f", channels {self.channels}"
        sides = "both sides" if self.squash else "short side"
        return (
            f"{sides} resized to {self.resize_px} px ({self.filter_name.lower()}, antialiased), central "
            f"{self.crop_px}×{self.crop_px} px, normalised with mean {self.mean} and standard deviation {self.std}"
            f"{order}"
        )


def published_preprocessing(preset: "ImageClassification") -> Preprocessing:
    """From torchvision's `weights.transforms()`."""
    return Preprocessing(
        preset.resize_size[0], preset.crop_size[0], tuple(preset.mean), tuple(preset.std), preset.interpolation.name
    )


def resize_and_crop(image: "np.ndarray", how: Preprocessing) -> "np.ndarray":
    """(h, w, 3) uint8 sRGB to (crop_px, crop_px, 3) uint8 sRGB, as torchvision's `transforms()` does with a photograph.

    The pixels are torchvision's own. For images over eight times as long as wide, only the kept part is resampled,
    which bounds the memory; some values then round to the next level.
    """
    from PIL import Image

    height, width = image.shape[:2]
    short, long = min(height, width), max(height, width)
    # torchvision truncates the long side and rounds the crop's corner half to even: the same pixels need the same rule
    scaled_long = how.resize_px if how.squash else int(how.resize_px * long / short)
    out_width, out_height = (how.resize_px, scaled_long) if width <= height else (scaled_long, how.resize_px)
    left, top = round((out_width - how.crop_px) / 2), round((out_height - how.crop_px) / 2)
    kept = (left, top, left + how.crop_px, top + how.crop_px)
    picture, resample = Image.fromarray(image), Image.Resampling[how.filter_name]
    # of a panorama only the kept part is resized
    if long <= LONGEST_WHOLE * short:
        return np.asarray(picture.resize((out_width, out_height), resample).crop(kept))
    x_step, y_step = width / out_width, height / out_height
    box = (kept[0] * x_step, kept[1] * y_step, kept[2] * x_step, kept[3] * y_step)
    return np.asarray(picture.resize((how.crop_px, how.crop_px), resample, box=box))
