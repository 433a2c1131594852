"""Effects of a desktop printer on the patch, of light on its paper, and of clear tape."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_serializer

from toolkit.boosters.transforms import ImageTransform, PaperTransform, Probability, as_factors
from toolkit.core.config import FileRecord, Later, Range, Rising
from toolkit.core.files import sha256_bytes
from toolkit.core.lazy import F, np, scipy, torch
from toolkit.objects.spec import printed_size_mm

if TYPE_CHECKING:
    from toolkit.imaging.printer import PrintProfile


# ITU-R BT.709's weights of red, green and blue in brightness
LUMA = (0.2126, 0.7152, 0.0722)
BLEED_MM = (0.03, 0.2)
Bleed = Annotated[Range, Rising(0.001, 2)]
Texel = Annotated[float, Field(ge=0.01, le=100)]


class PrintProcess(ImageTransform):
    """What is drawn, uniformly, for each print: a printer, its inks and its paper.

    The ranges are from photographs of real prints, light fitted, texel by texel: of 16 photographs of four stickers the
    file is ΔE00 12.7 off (median), the middle of the ranges 5.9, the best in them 4.8. They were set on eight (two
    stickers: middle 6.1, best 4.9); the other two stickers' eight have 5.5 and 4.7. What a phone does to contrast is in
    it: a camera's tone curve and the inks cannot be told apart.

    Attributes:
        version: of the ranges and formulas, for records: 1, which records do not name, had a print that was too pale.
        white: brightness of the paper as a share of FOGRA29's bright one; copier paper is a little greyer.
        tint: each channel's own deviation from it.
        density: how much darker than paper the inks are, as a share of FOGRA29's, an offset press on uncoated paper.
            In photographs an inkjet's black has sRGB 21 to 60 under paper at 255, where FOGRA29's has 75.
        chroma: how far colours lie from grey, as a share; dyes on plain paper sink in and dull.
        dot_gain: what a half-covered tone gains in coverage beyond the model's; negative where the driver lightens.
            The curve is the usual parabola a + 4 g a (1 - a).
        bleed_mm: standard deviation of how far ink spreads from its place.
        texel_mm: side of a texel on paper.
        probability: that the patch is printed at all, and not shown as the file has it.
    """

    stage = "print"
    version: Literal[2] = 2
    white: Annotated[Range, Rising(0.5, 1)] = (0.93, 1.0)
    tint: Annotated[float, Field(ge=0, le=0.2)] = 0.02
    density: Annotated[Range, Rising(0.2, 1.4)] = (1.05, 1.35)
    chroma: Annotated[Range, Rising(0, 1.3)] = (0.6, 0.95)
    dot_gain: Annotated[Range, Rising(-0.2, 0.2)] = (0.05, 0.20)  # beyond a quarter the tone curve would turn back
    bleed_mm: Bleed = BLEED_MM
    texel_mm: Texel = printed_size_mm(1)
    probability: Probability = 0.25

    def draw(self, rng: "np.random.Generator", count: int) -> "tuple[np.ndarray, ...]":
        """Bleed in millimetres, dot gain, chroma, density, paper: a printer for each print."""
        bleed, gain = rng.uniform(*self.bleed_mm, count), rng.uniform(*self.dot_gain, count)
        chroma, density = rng.uniform(*self.chroma, count), rng.uniform(*self.density, count)
        white = rng.uniform(*self.white, (count, 1)) * rng.uniform(1 - self.tint, 1 + self.tint, (count, 3))
        return bleed, gain, chroma, density, white

    def apply(self, some: "torch.Tensor", drawn: "tuple[np.ndarray, ...]") -> "torch.Tensor":
        """Print each on its own printer."""
        bleed, gain, chroma, density, white = drawn
        printed = mix_solids(gain_dots(spread_ink(some, bleed / self.texel_mm), gain))
        return finish_inks(printed, chroma, density, white)


def spread_ink(pixels: "torch.Tensor", sigma_texels: "np.ndarray") -> "torch.Tensor":
    """Blur each of (b, 3, h, w) by its Gaussian, exactly for square texels, whose edges may be much sharper than it.

    A texel's mean after blurring weighs its neighbours by the overlap of two boxes and a Gaussian between: the second
    difference of x Φ(x) + φ(x).
    """
    b, c, h, w = pixels.shape
    # three standard deviations hold 99.7 % of a Gaussian; another texel for the box that it blurs
    reach = int(np.ceil(3 * sigma_texels.max())) + 1
    x = np.arange(-reach - 1, reach + 2) / sigma_texels[:, None]
    # the Gaussian integrated twice, in texels: once for the blurred texel's box, once for its neighbour's
    integral = sigma_texels[:, None] * (x * scipy.special.ndtr(x) + np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi))
    kernels = np.diff(integral, 2, axis=1)
    weight = torch.as_tensor(kernels / kernels.sum(axis=1, keepdims=True), dtype=pixels.dtype, device=pixels.device)
    weight = weight.repeat_interleave(c, 0)[:, None]
    # a Gaussian is separable: rows and then columns; groups give each print its own width
    flat = pixels.reshape(1, b * c, h, w)
    flat = F.conv2d(F.pad(flat, (reach, reach, 0, 0), mode="replicate"), weight[:, :, None], groups=b * c)
    flat = F.conv2d(F.pad(flat, (0, 0, reach, reach), mode="replicate"), weight[..., None], groups=b * c)
    return flat.reshape(pixels.shape)


def gain_dots(pixels: "torch.Tensor", gain: "np.ndarray") -> "torch.Tensor":
    """Let dots grow: coverage a = 1 - x becomes a + 4 g a (1 - a); paper and solids stay, tones between darken."""
    # largest at a half, where it is g
    return pixels - 4 * as_factors(gain, pixels) * pixels * (1 - pixels)


def mix_solids(pixels: "torch.Tensor") -> "torch.Tensor":
    """Look (b, 3, h, w) in [0, 1] up in the cube of printed solids."""
    from toolkit.imaging.printer import SOLIDS

    # dots that lie at random overlap by the product of their coverages: the share of each of the eight solids
    off_on = torch.stack([1 - pixels, pixels], dim=2)
    areas = torch.einsum("bihw,bjhw,bkhw->bijkhw", off_on[:, 0], off_on[:, 1], off_on[:, 2])
    solids = torch.as_tensor(SOLIDS, dtype=pixels.dtype, device=pixels.device)
    return torch.einsum("bijkhw,ijkc->bchw", areas, solids)


def finish_inks(
    printed: "torch.Tensor", chroma: "np.ndarray", density: "np.ndarray", white: "np.ndarray"
) -> "torch.Tensor":
    """Dull, thin and yellow a print: shares of its distance from grey, of its distance from paper, and its paper."""
    from toolkit.imaging.printer import PAPER

    weights = torch.as_tensor(LUMA, dtype=printed.dtype, device=printed.device).view(1, 3, 1, 1)
    paper = torch.as_tensor(PAPER, dtype=printed.dtype, device=printed.device).view(1, 3, 1, 1)
    # grey is what has the paper's own tint, so that bare paper stays as it is
    grey = (printed / paper * weights).sum(dim=1, keepdim=True) * paper
    dulled = grey + as_factors(chroma, printed) * (printed - grey)
    thinned = paper + as_factors(density, printed) * (dulled - paper)
    return (thinned * as_factors(white, printed)).clamp(0, 1)


SHEEN = 0.023
"""`ProfiledPrint.sheen` of the rig's paper, whose roughness is 0.75: see `docs/how/renderers.md`."""


class ProfiledPrint(ImageTransform):
    """A measured printer.

    Attributes:
        name: of the profile, and `profile_sha256` of all that it holds: `sha256` in records.
        held_out: its error, ΔE00, median on parts that it was not fitted to.
        power, exponents, coefficients, paper_linear: as in `toolkit.imaging.printer.PrintProfile`.
        bleed_mm: standard deviation of how far ink spreads, drawn for each print: profiles hold colours alone.
        sheen: light that a renderer adds for the paper's gloss, as a share of what white scatters. Photographs of a
            print hold it, so the ink is without it.
        texel_mm: side of a texel on paper.
        probability: that the patch is printed at all, and not shown as the file has it.
    """

    stage = "print"
    name: str
    profile_sha256: str
    held_out: float
    power: float
    exponents: tuple[tuple[int, int, int], ...]
    coefficients: tuple[tuple[float, float, float], ...]
    paper_linear: tuple[float, float, float]
    bleed_mm: Bleed = BLEED_MM
    texel_mm: Texel = printed_size_mm(1)
    sheen: Annotated[float, Later, Field(ge=0, lt=1)] = 0.0
    probability: Probability = 1.0

    @model_serializer(mode="wrap")
    def _dump(self, dump: Callable[[FileRecord], dict[str, Any]]) -> dict[str, Any]:
        settings = super()._dump(dump)
        return {"sha256" if name == "profile_sha256" else name: value for name, value in settings.items()}

    def draw(self, rng: "np.random.Generator", count: int) -> "tuple[np.ndarray, ...]":
        """Bleed in millimetres."""
        return (rng.uniform(*self.bleed_mm, count),)

    def apply(self, some: "torch.Tensor", drawn: "tuple[np.ndarray, ...]") -> "torch.Tensor":
        """Spread the ink, and take the profile's colours."""
        return self.colour(spread_ink(some, drawn[0] / self.texel_mm))

    def colour(self, pixels: "torch.Tensor") -> "torch.Tensor":
        """The profile's colours of (b, 3, h, w), sRGB-encoded in [0, 1], in neutral light; differentiable."""
        powers = [torch.ones_like(pixels), pixels.clamp(0, 1) ** self.power]
        for _ in range(2, 1 + max(max(term) for term in self.exponents)):
            powers.append(powers[-1] * powers[1])
        terms = torch.stack([powers[r][:, 0] * powers[g][:, 1] * powers[b][:, 2] for r, g, b in self.exponents], dim=1)
        mixed = torch.einsum("bkhw,kc->bchw", terms, pixels.new_tensor(self.coefficients))
        # the terms give shares of the light that bare paper sends back: (ink + sheen) / (paper + sheen)
        return encode(mixed * pixels.new_tensor(self.paper_linear).view(1, 3, 1, 1) + self.sheen * (mixed - 1))

    def describe(self) -> str:
        """For the table of settings."""
        bleed = f"ink bleed {self.bleed_mm[0]:g} to {self.bleed_mm[1]:g} mm"
        return (
            f"as measured, profile {self.name} ({self.profile_sha256[:12]}), ΔE00 {self.held_out:.1f} held out, {bleed}"
        )


def use_profile(profile: "PrintProfile", sheen: float = 0.0) -> ProfiledPrint:
    """The transform that prints as a profile says, with `SHEEN` for sheets that a renderer shows."""
    return ProfiledPrint(
        name=profile.name, profile_sha256=sha256_bytes(profile.model_dump_json().encode()),
        held_out=profile.held_out.median, power=profile.power, exponents=profile.exponents,
        coefficients=profile.coefficients, paper_linear=profile.paper_linear, sheen=sheen,
    )  # fmt: skip


def encode(linear: "torch.Tensor") -> "torch.Tensor":
    """`toolkit.imaging.colour.linear_to_srgb`, differentiable."""
    linear = linear.clamp(0, 1)
    # clamped in the branch that is not taken as well: the power's slope at 0 is infinite, and 0 · ∞ is no number
    return torch.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)


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
        count = len(paper)
        # all is drawn for every image, shine or none, so that each number keeps its place in the stream
        shines, hides = self.draw_acting(rng, count), rng.random(count) < self.strip_probability
        width, length = rng.uniform(*self.width, count), rng.uniform(*self.length, count)
        strength, colour = rng.uniform(*self.strength, count), rng.uniform(0.94, 1.0, (count, 3))
        angle, centre = rng.uniform(0, np.pi, count), rng.uniform(-0.5, 0.5, (count, 2))
        strip_angle, strip_place = rng.uniform(0, np.pi, count), rng.uniform(-0.5, 0.5, count)
        strip_width = rng.uniform(*self.strip_width, count)
        strip_colour = rng.uniform(0.1, 0.85, (count, 1)) * rng.uniform(0.93, 1.07, (count, 3))
        # a shine fades along and across like a bell, about a random place
        if shines.any():
            x, y, _ = _measure(mask, angle, centre)
            shine = (-((x / as_factors(length, x)) ** 2 + (y / as_factors(width, y)) ** 2) / 2).exp()
            paper = _cover(paper, mask, shine * as_factors(strength * shines, x), colour)
        # a strip of tape with straight edges
        if hides.any():
            _, y, pixel = _measure(mask, strip_angle, np.stack([np.zeros(count), strip_place], axis=1))
            inside = ((as_factors(strip_width / 2, y) - y.abs()) / pixel + 0.5).clamp(0, 1)  # a pixel of soft edge
            paper = _cover(paper, mask, inside * as_factors(hides.astype(float), y), strip_colour)
        return paper


def _measure(
    mask: "torch.Tensor", angle: "np.ndarray", centre: "np.ndarray"
) -> tuple["torch.Tensor", "torch.Tensor", "torch.Tensor"]:
    """Coordinates (b, 1, m, m) along and across a direction, from `centre`, and a pixel's size.

    All are shares of the patch's side, here the root of its area; its own middle is (0, 0).
    """
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
