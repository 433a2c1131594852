"""What one's own printer makes of the patch, as measured (`toolkit print-profile`), in place of a range of printers."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolkit.boosters.print_process import PrintProcess, spread_ink
from toolkit.boosters.ranges import Range, change_some, check_probability, check_range, count_images
from toolkit.files import sha256_bytes
from toolkit.patches import printed_size_mm
from toolkit.print_profile import Exponents, PrintProfile, Triple

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class ProfiledPrint:
    """A measured printer.

    Attributes:
        name: of the profile, and `sha256` of all that it holds.
        held_out: its error, ΔE00, median on parts that it was not fitted to.
        power, exponents, coefficients, paper_linear: as in `toolkit.print_profile.PrintProfile`.
        bleed_mm: standard deviation of how far ink spreads, drawn for each print: profiles hold colours alone.
        texel_mm: side of a texel on paper.
        probability: that the patch is printed at all, and not shown as the file has it.
    """

    name: str
    sha256: str
    held_out: float
    power: float
    exponents: tuple[Exponents, ...]
    coefficients: tuple[Triple, ...]
    paper_linear: Triple
    bleed_mm: Range = PrintProcess.bleed_mm
    texel_mm: float = printed_size_mm(1)
    probability: float = 1.0

    def __post_init__(self) -> None:
        check_range("ink bleed", self.bleed_mm, 0.001, 2)
        check_range("texel", (self.texel_mm, self.texel_mm), 0.01, 100)
        check_probability("print", self.probability)

    def change(self, pixels: "torch.Tensor", rng: np.random.Generator) -> "torch.Tensor":
        """Print (3, n, n), or some of (b, 3, n, n), sRGB-encoded in [0, 1]; differentiable."""
        count = count_images(pixels)
        acting = rng.random(count) < self.probability
        bleed = rng.uniform(*self.bleed_mm, count)

        def on_paper(some: "torch.Tensor", which: np.ndarray) -> "torch.Tensor":
            return self.colour(spread_ink(some, bleed[which] / self.texel_mm))

        return change_some(pixels, acting, on_paper)

    def colour(self, pixels: "torch.Tensor") -> "torch.Tensor":
        """The profile's colours of (b, 3, h, w), as `toolkit.print_profile.print_colours`; differentiable."""
        import torch

        powers = [torch.ones_like(pixels), pixels.clamp(0, 1) ** self.power]
        for _ in range(2, 1 + max(max(term) for term in self.exponents)):
            powers.append(powers[-1] * powers[1])
        terms = torch.stack([powers[r][:, 0] * powers[g][:, 1] * powers[b][:, 2] for r, g, b in self.exponents], dim=1)
        mixed = torch.einsum("bkhw,kc->bchw", terms, pixels.new_tensor(self.coefficients))
        return encode(mixed * pixels.new_tensor(self.paper_linear).view(1, 3, 1, 1))

    def describe(self) -> str:
        """For the table of settings."""
        bleed = f"ink bleed {self.bleed_mm[0]:g} to {self.bleed_mm[1]:g} mm"
        return f"as measured, profile {self.name} ({self.sha256[:12]}), ΔE00 {self.held_out:.1f} held out, {bleed}"


def use_profile(profile: PrintProfile) -> ProfiledPrint:
    """The part that prints as a profile says."""
    return ProfiledPrint(
        profile.name, sha256_bytes(profile.model_dump_json().encode()), profile.held_out.median, profile.power,
        profile.exponents, profile.coefficients, profile.paper_linear,
    )  # fmt: skip


def encode(linear: "torch.Tensor") -> "torch.Tensor":
    """`toolkit.colour.linear_to_srgb`, differentiable."""
    import torch

    linear = linear.clamp(0, 1)
    return torch.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)
