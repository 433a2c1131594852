"""Transforms that help a booster transfer to other networks: hidden parts, shuffled blocks, mixed features."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Annotated

from pydantic import Field

from toolkit.boosters.transforms import ImageTransform, Probability, Transform, as_factors
from toolkit.core.draws import Draws
from toolkit.core.lazy import np, torch
from toolkit.training.processes import current

# the cutout's colour in T-SEA's release; also what a surface without its booster has in clean photographs
GREY = 0.5
OVERHANG = 0.05
"""How far outside the patch the middle of a hidden square may lie, share of its side."""
LARGEST_MAP = 4
"""Features are mixed where a map's side is at most the image's divided by this."""


class Cutout(ImageTransform):
    """A square of the patch hidden by grey, so that no part of it alone has to be seen.

    Patch cutout of T-SEA (Huang et al. 2023, section 3.3), with the size, the grey and the probability of its release;
    the square's middle lies anywhere in the patch.

    Attributes:
        share: side of the square against the patch's.
        probability: that a step hides a square.
    """

    stage = "print"
    share: Annotated[float, Field(gt=0, le=1)] = 0.4
    probability: Probability = 0.9

    def draw(self, rng: "np.random.Generator", count: int) -> tuple["np.ndarray", ...]:
        """(count, 2) middle of the square, right and down, shares of the side."""
        return (rng.uniform(-OVERHANG, 1 + OVERHANG, (count, 2)),)

    def apply(self, some: "torch.Tensor", drawn: tuple["np.ndarray", ...]) -> "torch.Tensor":
        """Hide it; texels are hidden by their middles."""
        n = some.shape[-1]
        away = np.abs((np.arange(n) + 0.5) / n - drawn[0][:, :, None]) < self.share / 2
        hidden = torch.as_tensor(away[:, 0, None, None, :] & away[:, 1, None, :, None], device=some.device)
        return some.masked_fill(hidden, GREY)


class BlockShuffle(ImageTransform):
    """The photograph cut into blocks, which are shuffled and turned: the object's parts leave their places.

    Block shuffle and rotation (BSR; Wang et al. 2024, section 3.2): blocks of random sizes, each turned about its
    middle by an angle of its own; what turns in is black. As in its release, the photograph is cut into strips, along
    either axis, and each strip into blocks.

    Attributes:
        blocks: along each axis.
        max_angle_deg: to either side.
        probability: that a photograph is cut.
    """

    stage = "network"
    blocks: Annotated[int, Field(ge=1, le=8)] = 2
    max_angle_deg: Annotated[float, Field(ge=0, le=180)] = 24.0
    probability: Probability = 0.5

    def draw(self, rng: "np.random.Generator", count: int) -> tuple["np.ndarray", ...]:
        """Axis of the strips; sizes and order of strips and of the blocks in each; angles."""
        n = self.blocks
        sizes = rng.uniform(size=(count, 1 + n, n))
        orders = rng.permuted(np.tile(np.arange(n), (count, 1 + n, 1)), axis=2)
        angles = rng.uniform(-self.max_angle_deg, self.max_angle_deg, (count, n, n))
        # row 0 of sizes and orders is the strips', row 1 + k that of the blocks in strip k
        return rng.integers(2, size=count), sizes, orders, angles

    def apply(self, some: "torch.Tensor", drawn: tuple["np.ndarray", ...]) -> "torch.Tensor":
        """Cut, turn, shuffle, and join."""
        return torch.stack([_shuffle(photo, *draws) for photo, *draws in zip(some, *drawn, strict=True)])


def _shuffle(
    photo: "torch.Tensor", axis: int, sizes: "np.ndarray", orders: "np.ndarray", angles: "np.ndarray"
) -> "torch.Tensor":
    """(3, h, w) with its strips along `axis` (0: down, 1: right), and the blocks of each, in other places."""
    from toolkit.models.vision import torchvision

    turning = torchvision.transforms.functional

    along, across = 1 + int(axis), 2 - int(axis)
    # strips first, then the blocks of each, all of random sizes
    strips = photo.split(divide(photo.shape[along], sizes[0]), along)
    joined = []
    for k in orders[0]:
        blocks = strips[k].split(divide(photo.shape[across], sizes[1 + k]), across)
        turned = [
            # a block that was rounded to nothing has no middle to turn about
            turning.rotate(block, float(angle), turning.InterpolationMode.BILINEAR) if block.numel() else block
            for block, angle in zip(blocks, angles[k], strict=True)
        ]
        joined.append(torch.cat([turned[j] for j in orders[1 + k]], across))
    return torch.cat(joined, along)


def divide(length: int, sizes: "np.ndarray") -> list[int]:
    """A length in whole parts that are to each other as `sizes`, to rounding; the largest takes what is left."""
    parts = np.round(sizes / sizes.sum() * length).astype(int)
    # rounding misses the length by a few pixels, which the largest part feels least
    parts[parts.argmax()] += length - parts.sum()
    return parts.tolist()


class FeatureMixup(Transform):
    """Features inside the network mixed with those of the other photographs of the batch, without the booster.

    Clean feature mixup (CFM; Byun et al. 2023, section 3.2), with the numbers of its release: in some of the
    convolutions and fully connected layers, drawn anew in each step, (1 - a) f + a g, with g of another photograph by
    a random order, and `a` drawn for each photograph and channel. Convolutions whose maps are larger than a quarter of
    the image's side are left alone. Here each step has photographs of its own, and sees them without the booster too.

    Attributes:
        max_share: the largest a.
        probability: of a layer, that it acts in a step.
    """

    stage = "features"
    max_share: Annotated[float, Field(gt=0, le=1)] = 0.75
    probability: Probability = 0.1

    @contextmanager
    def inside(
        self, module: "torch.nn.Module", image_px: int, see_clean: Callable[[], object], draws: Draws, of: str = ""
    ) -> Iterator[None]:
        """Let it act on what the network is asked; afterwards the network is as it was.

        Args:
            module: the network; of several processes each asks it about its part of the photographs.
            image_px: side of the images that it sees.
            see_clean: asks it about all photographs without the booster.
            draws: of the step.
            of: distinguishes the networks of a step.
        """
        # feature maps that are larger than a quarter of the image are left alone
        layers, largest_px = find_layers(module), image_px // LARGEST_MAP
        # layers are drawn anew in each step
        acting = self.draw_acting(self.rng(draws, f"{of} layers"), len(layers))
        clean: dict[torch.nn.Module, list[torch.Tensor]] = {layers[k]: [] for k in acting.nonzero()[0]}
        is_clean = True

        def act(layer: "torch.nn.Module", _: object, output: "torch.Tensor") -> "torch.Tensor | None":
            # skipped in the clean pass as well, so that each layer takes back what it has stored
            if output.ndim == 4 and output.shape[-1] > largest_px:
                return None
            if is_clean:
                clean[layer].append(output.detach().clone())  # what follows may write over it
                return None
            # a layer that is asked twice meets its answers in the same order
            number, answers = layers.index(layer), clean[layer]
            return self.apply(output, answers.pop(0), self.rng(draws, f"{of} {number} {len(answers)}"))

        with ExitStack() as hooks:
            for layer in clean:
                hooks.callback(layer.register_forward_hook(act).remove)
            if clean:
                see_clean()
            is_clean = False
            yield

    def apply(self, output: "torch.Tensor", clean: "torch.Tensor", rng: "np.random.Generator") -> "torch.Tensor":
        """Mix this process's part of (b, c, …) features with (b, c, …) clean features of all photographs."""
        # drawn for the whole batch and then shared, so that the number of processes changes nothing
        order = current().share(rng.permutation(len(clean)))
        shares = current().share(rng.uniform(0, self.max_share, clean.shape[:2]))
        weights = as_factors(shares, output).reshape(*output.shape[:2], *[1] * (output.ndim - 2))
        return (1 - weights) * output + weights * clean[torch.as_tensor(order, device=clean.device)]


def find_layers(module: "torch.nn.Module | None") -> "list[torch.nn.Module]":
    """The convolutions and fully connected layers of a network; none of what is no module of torch."""
    inside = [] if module is None else module.modules()
    return [module for module in inside if isinstance(module, torch.nn.Conv2d | torch.nn.Linear)]
