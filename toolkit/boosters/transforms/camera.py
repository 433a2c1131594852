"""Effects of a camera on a photograph: exposure, blur, sensor noise, JPEG and a shaky hand."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Annotated, Any

from pydantic import Field

from toolkit.boosters.transforms import ImageTransform, Probability, Transform, as_factors
from toolkit.core.config import Range, Rising
from toolkit.core.lazy import F, np, scipy, torch


class Exposure(Transform):
    """What is drawn for each photograph.

    Attributes:
        factor: on the light, evenly over its logarithm.
        tint: each channel's own factor lies within 1 ± tint.
    """

    stage = "light"
    drawn_as = "exposure"
    factor: Annotated[Range, Rising(0.05, 20)] = (0.6, 1.5)
    tint: Annotated[float, Field(ge=0, le=0.9)] = 0.05

    def draw(self, rng: "np.random.Generator", count: int, like: "torch.Tensor") -> "torch.Tensor":
        """(count, 3, 1, 1) factors, of `like`'s type and device."""
        # half the light and twice the light are as likely: exposure counts in stops
        low, high = np.log(self.factor)
        factor = np.exp(rng.uniform(low, high, (count, 1, 1, 1)))
        tint = rng.uniform(1 - self.tint, 1 + self.tint, (count, 3, 1, 1))
        return torch.as_tensor(factor * tint, dtype=like.dtype, device=like.device)


LEAST_DEFOCUS_PX = 0.05
"""So little changes no pixel; none at all has no closed form."""


class CameraBlur(ImageTransform):
    """The photograph out of focus, and shaken: a Gaussian drawn out along a short line, in the network's pixels.

    A telephone's photograph of 12 megapixels is sampled down tenfold on its way to 224 pixels: what is left of focus
    and shake is about a pixel.

    Attributes:
        defocus_px: standard deviation of the Gaussian.
        motion_px: how far the image moved while the shutter was open, in any direction.
        probability: that a photograph is blurred.
    """

    defocus_px: Annotated[Range, Rising(LEAST_DEFOCUS_PX, 8)] = (0.3, 1.0)
    motion_px: Annotated[Range, Rising(0, 16)] = (0.0, 2.5)
    probability: Probability = 0.3

    def draw(self, rng: "np.random.Generator", count: int) -> "tuple[np.ndarray, ...]":
        """Width of the Gaussian, length and angle of the line."""
        sigma, length = rng.uniform(*self.defocus_px, count), rng.uniform(*self.motion_px, count)
        return sigma, length, rng.uniform(0, np.pi, count)

    def apply(self, some: "torch.Tensor", drawn: "tuple[np.ndarray, ...]") -> "torch.Tensor":
        """Convolve."""
        return blur(some, make_kernels(*drawn))


def make_kernels(sigma_px: "np.ndarray", length_px: "np.ndarray", angle: "np.ndarray") -> "np.ndarray":
    """(k, s, s) kernels that sum to 1: a Gaussian convolved with a line, in closed form at the pixel centres.

    Args:
        sigma_px: (k,) of the Gaussian.
        length_px: (k,) of the line; 0 leaves the Gaussian alone.
        angle: (k,) of the line, radians from x (right) towards y (down).
    """
    # three standard deviations beyond either end of the line; the same size for the batch, as kernels are stacked
    reach = int(np.ceil((3 * sigma_px + length_px / 2).max()))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1][:, None].astype(float)
    sigma, half = sigma_px[:, None, None], length_px[:, None, None] / 2
    cosine, sine = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    along, across = x * cosine + y * sine, y * cosine - x * sine
    # along its own direction the line smears the Gaussian into a difference of two of its integrals
    line = scipy.special.ndtr((along + half) / sigma) - scipy.special.ndtr((along - half) / sigma)
    # for a line without length that difference is 0 everywhere, and the Gaussian itself takes its place
    kernels = np.exp(-((across / sigma) ** 2) / 2) * np.where(half < 1e-3, np.exp(-((along / sigma) ** 2) / 2), line)
    return kernels / kernels.sum(axis=(1, 2), keepdims=True)


def blur(pixels: "torch.Tensor", kernels: "np.ndarray") -> "torch.Tensor":
    """Convolve each of (b, 3, h, w) with its own kernel of (b, s, s); the edges repeat."""
    b, c, h, w = pixels.shape
    reach = kernels.shape[-1] // 2
    # conv2d correlates: the kernels are turned, so that it convolves
    weight = torch.as_tensor(kernels[:, ::-1, ::-1].copy(), dtype=pixels.dtype, device=pixels.device)
    weight = weight[:, None].repeat_interleave(c, 0)
    padded = F.pad(pixels, (reach, reach, reach, reach), mode="replicate").reshape(
        1, b * c, h + 2 * reach, w + 2 * reach
    )
    return F.conv2d(padded, weight, groups=b * c).reshape(b, c, h, w)


DARKEST = 0.1
"""Encoded value below which sRGB's curve is near to straight, so that read noise grows no further."""


class SensorNoise(ImageTransform):
    """Noise of the sensor: photons are counted (shot noise), and the counter itself is unsteady (read noise).

    In linear light L the variance is shot² L + read². sRGB's curve is close to a square root, whose slope at the
    encoded value v is 1 / 2v, so that the standard deviation of v is ½ √(shot² + read² / v²): nearly the same from the
    shadows to the lights, as in a photograph. The gradient takes it as given: a patch gains nothing by quieter grain.

    Attributes:
        shot: standard deviation of white, linear; 0.02 is 2500 photoelectrons per pixel of the network's image.
        read: standard deviation of black, linear.
        probability: that a photograph has noise.
    """

    shot: Annotated[Range, Rising(0, 0.5)] = (0.005, 0.04)
    read: Annotated[Range, Rising(0, 0.2)] = (0.0, 0.006)
    probability: Probability = 0.3

    def draw(self, rng: "np.random.Generator", count: int) -> "tuple[np.ndarray, ...]":
        """Shot noise, read noise, and the seed of the grain of all."""
        shot, read = rng.uniform(*self.shot, count), rng.uniform(*self.read, count)
        # a single generator draws the grain of all photographs at once: its seed stands in each row
        return shot, read, np.full(count, rng.integers(1 << 62))

    def apply(self, some: "torch.Tensor", drawn: "tuple[np.ndarray, ...]") -> "torch.Tensor":
        """Add grain, and stay within [0, 1]."""
        shot, read, seeds = drawn
        # drawn on the CPU, so that a GPU trains on the same pictures
        generator = torch.Generator().manual_seed(int(seeds[0]))
        grain = torch.randn(some.shape, generator=generator, dtype=some.dtype).to(some.device)
        # ½ √(read² / v² + shot²), in place: grain is as large as the batch
        deviation = some.detach().clamp_min(DARKEST).reciprocal_().mul_(as_factors(read / 2, some)).square_()
        deviation.add_(as_factors(shot**2 / 4, some)).sqrt_()
        return (some + grain.mul_(deviation)).clamp(0, 1)


# ITU-T T.81, tables K.1 (luma) and K.2 (chroma)
LUMA = (
    [16, 11, 10, 16, 24, 40, 51, 61], [12, 12, 14, 19, 26, 58, 60, 55], [14, 13, 16, 24, 40, 57, 69, 56],
    [14, 17, 22, 29, 51, 87, 80, 62], [18, 22, 37, 56, 68, 109, 103, 77], [24, 35, 55, 64, 81, 104, 113, 92],
    [49, 64, 78, 87, 103, 121, 120, 101], [72, 92, 95, 98, 112, 100, 103, 99],
)  # fmt: skip
CHROMA = (
    [17, 18, 24, 47, 99, 99, 99, 99], [18, 21, 26, 66, 99, 99, 99, 99], [24, 26, 56, 99, 99, 99, 99, 99],
    [47, 66, 99, 99, 99, 99, 99, 99], *[[99] * 8] * 4,
)  # fmt: skip
# JFIF's matrix, of full-range ITU-R BT.601
YCC_FROM_RGB = ((0.299, 0.587, 0.114), (-0.168736, -0.331264, 0.5), (0.5, -0.418688, -0.081312))
MIDDLE = 128.0
"""Taken off luma before it is transformed; chroma is about 0 already."""


class JpegFile(ImageTransform):
    """The photograph saved as JPEG: 4:2:0 chroma, the standard tables, and a gradient that passes through the rounding.

    Source: ITU-T T.81 (1992), annex K.1 for the tables; their scaling by quality is the Independent JPEG Group's, as in
    Pillow. Forward, coefficients are rounded as a camera rounds them; backward, rounding counts as the identity
    ("straight through"; Bengio et al. 2013), since its true gradient is zero everywhere.

    Attributes:
        quality: lowest and highest, whole numbers on the IJG's scale; messengers and web pages use about 60 to 85.
        probability: that a photograph is saved so.
    """

    quality: Annotated[tuple[int, int], Rising(1, 100)] = (40, 95)
    probability: Probability = 0.3

    def draw(self, rng: "np.random.Generator", count: int) -> "tuple[np.ndarray, ...]":
        """Qualities."""
        return (rng.integers(self.quality[0], self.quality[1] + 1, count),)

    def apply(self, some: "torch.Tensor", drawn: "tuple[np.ndarray, ...]") -> "torch.Tensor":
        """Save and read again."""
        return compress(some, drawn[0])


def round_straight(values: "torch.Tensor") -> "torch.Tensor":
    """Round; the gradient is the identity's."""

    class Round(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, exact: torch.Tensor) -> torch.Tensor:
            return exact.round()

        @staticmethod
        def backward(ctx: Any, *gradients: torch.Tensor) -> torch.Tensor:
            return gradients[0]

    return Round.apply(values)


def compress(
    pixels: "torch.Tensor",
    quality: "np.ndarray",
    rounding: Callable[["torch.Tensor"], "torch.Tensor"] = round_straight,
) -> "torch.Tensor":
    """Return (b, 3, h, w) sRGB-encoded pixels in [0, 1] after JPEG compression of the qualities (b,)."""
    h, w = pixels.shape[-2:]
    # chroma is halved before it is cut into blocks of 8: both sides have to be multiples of 16
    full = F.pad(pixels, (0, -w % 16, 0, -h % 16), mode="replicate")
    ycc_from_rgb = np.array(YCC_FROM_RGB)
    # in values of 0 to 255, as JPEG's tables are
    to_ycc, from_ycc = (
        torch.as_tensor(matrix, dtype=pixels.dtype, device=pixels.device)
        for matrix in (ycc_from_rgb * 255, np.linalg.inv(ycc_from_rgb) / 255)
    )
    # luma at full size, chroma at half
    ycc = (to_ycc @ full.flatten(2)).view(full.shape)
    luma = _code_blocks(ycc[:, :1], quantise_tables(LUMA, quality), MIDDLE, rounding)
    chroma = _code_blocks(F.avg_pool2d(ycc[:, 1:], 2), quantise_tables(CHROMA, quality), 0, rounding)
    chroma = F.interpolate(chroma, scale_factor=2, mode="bilinear", align_corners=False)  # libjpeg's "fancy upsampling"
    decoded = from_ycc @ (torch.cat([luma, chroma], 1).flatten(2))
    return decoded.view(full.shape)[..., :h, :w].clamp(0, 1)


def quantise_tables(table: Sequence[Sequence[int]], quality: "np.ndarray") -> "np.ndarray":
    """(b, 64) steps between coefficients, the table scaled as the IJG scales it."""
    quality = np.asarray(quality)
    # IJG's jpeg_quality_scaling: 50 leaves the table as it is, 100 divides by one
    percent = np.where(quality < 50, 5000 // quality.clip(1), 200 - 2 * quality)
    return ((np.reshape(table, (1, 64)) * percent[:, None] + 50) // 100).clip(1, 255).astype(float)


@lru_cache(maxsize=1)
def _cosines() -> "np.ndarray":
    """(64, 64) the two-dimensional DCT of a block of 8 × 8 as a single orthonormal matrix."""
    frequency, place = np.mgrid[:8, :8]
    rows = np.cos((2 * place + 1) * frequency * np.pi / 16) / 2
    # the mean's row is longer than the others by √2: orthonormal after this, so that the inverse is the transpose
    rows[0] /= np.sqrt(2)
    return np.kron(rows, rows)


def _code_blocks(planes: "torch.Tensor", steps: "np.ndarray", middle: float, rounding: Callable) -> "torch.Tensor":
    """Transform, divide, round, multiply, transform back; a matrix product each way holds all but the rounding."""

    def place(matrix: "np.ndarray") -> torch.Tensor:
        return torch.as_tensor(matrix, dtype=planes.dtype, device=planes.device)

    b, c, h, w = planes.shape
    # dividing and multiplying by the steps of the table is part of the matrices
    forward, back = _cosines().T[None] / steps[:, None, :], _cosines()[None] * steps[:, :, None]
    # JPEG centres luma about 0 before the transform
    shift = np.full((b, 1, 64), -middle) @ forward
    # blocks of 8 × 8 as rows of 64
    blocks = planes.reshape(b, c, h // 8, 8, w // 8, 8).transpose(3, 4).reshape(b, -1, 64)
    coefficients = rounding(torch.baddbmm(place(shift), blocks, place(forward)))
    decoded = torch.baddbmm(place(np.full((b, 1, 64), middle)), coefficients, place(back))
    return decoded.view(b, c, h // 8, w // 8, 8, 8).transpose(3, 4).reshape(b, c, h, w)


class Jitter(ImageTransform):
    """A camera that is not held still: each network sees the photograph a little larger or smaller, and moved.

    Diverse inputs (DI; Xie et al. 2019, section 3.2) resize and pad; here what leaves the frame is cut, and what comes
    in repeats the edge. It is drawn for each photograph and each network that looks at it.

    Attributes:
        scale: factor on the size of what is seen.
        shift: to either side, share of the photograph's side.
        probability: that a photograph is changed.
    """

    stage = "network"
    scale: Annotated[Range, Rising(0.25, 4)] = (0.8, 1.15)
    shift: Annotated[float, Field(ge=0, le=0.5)] = 0.08
    probability: Probability = 0.7

    def draw(self, rng: "np.random.Generator", count: int) -> "tuple[np.ndarray, ...]":
        """Scales and shifts."""
        return rng.uniform(*self.scale, count), rng.uniform(-self.shift, self.shift, (count, 2))

    def apply(self, some: "torch.Tensor", drawn: "tuple[np.ndarray, ...]") -> "torch.Tensor":
        """Resize and move by bilinear look-up."""
        return _zoom(some, *drawn)


def _zoom(photos: "torch.Tensor", scale: "np.ndarray", shift: "np.ndarray") -> "torch.Tensor":
    """(k, 3, h, w) about the middle by (k,) `scale`, then right and down by (k, 2) `shift` shares of the side."""
    T_from_to = np.zeros((len(photos), 2, 3))
    # affine_grid asks where each pixel comes from: the inverse of scale and shift, in units of half a side
    T_from_to[:, 0, 0] = T_from_to[:, 1, 1] = 1 / scale
    T_from_to[:, :, 2] = -2 * shift / scale[:, None]
    matrices = torch.as_tensor(T_from_to, dtype=photos.dtype, device=photos.device)
    grid = F.affine_grid(matrices, list(photos.shape), align_corners=False)
    return F.grid_sample(photos, grid, mode="bilinear", padding_mode="border", align_corners=False)
