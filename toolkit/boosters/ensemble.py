"""One batch of photographs, one network or several: the loss whose gradient moves a booster.

What networks share carries over to those that were never asked; what one of them has alone does not. The means are
those of the literature on transfer: an ensemble (Liu et al. 2017), diverse inputs (DI; Xie et al. 2019), the logit in
place of the cross-entropy (Zhao et al. 2021). Momentum (MI; Dong et al. 2018) and smoothed gradients (TI; Dong et al.
2019) are in `PixelTask.adjust_gradients`.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from toolkit.boosters.pixel_config import PixelConfig
from toolkit.boosters.pixels import Target, judge_photos
from toolkit.core.draws import Draws
from toolkit.training.processes import current

if TYPE_CHECKING:
    import torch

    Ask = Callable[[torch.Tensor, int], tuple[torch.Tensor, float]]
    """(photographs, number of a network) -> its loss, and the share that it recognises."""


def judge_ensemble(
    photos: "torch.Tensor", targets: Sequence[Target], config: PixelConfig, draws: Draws
) -> tuple["torch.Tensor", float]:
    """The loss of photographs before the networks that a step asks, a scalar, and the mean share they recognise.

    Args:
        photos: (b, 3, m, m) sRGB-encoded, rendered once for all networks; of several processes each judges its part.
        targets: the networks.
        config: its `ensemble`, `objective` and transforms of the stage `network` act here. By `sum` the losses are
            added. By `normalised` the value is that sum, and the gradient by the photographs is the sum of the
            networks' own, each scaled to their mean length, so that none drowns the others. By `turns` one network is
            asked, see `choose_turn`.
        draws: of this step.
    """

    def ask(seen: "torch.Tensor", number: int) -> tuple["torch.Tensor", float]:
        for one in config.transforms("network"):
            seen = one.change(seen, one.rng(draws, f" {number}"))
        return judge_photos(current().share(seen), [targets[number]], config.objective)

    if config.ensemble == "turns":
        return ask(photos, choose_turn(config.seed, draws.step, len(targets)))
    if config.ensemble == "normalised" and photos.requires_grad:
        return _normalise(photos, ask, len(targets))
    answers = [ask(photos, number) for number in range(len(targets))]
    return sum((loss for loss, _ in answers), photos.new_zeros(())), _mean([hits for _, hits in answers])


def choose_turn(seed: int, step: int, count: int) -> int:
    """Number of the network that a step asks: each of `count` once a round, in an order of the round's own."""
    turn, inside = divmod(step, count)
    return int(Draws(seed, turn).of("turns").permutation(count)[inside])


def _normalise(photos: "torch.Tensor", ask: "Ask", count: int) -> tuple["torch.Tensor", float]:
    """One network after the other, each graph freed before the next; one way back through the render for all."""
    import torch

    seen = photos.detach().requires_grad_(True)
    value, recognised = photos.new_zeros(()), []
    gradients: list[torch.Tensor] = []
    for number in range(count):
        loss, hits = ask(seen, number)
        gradients += torch.autograd.grad(loss, seen)
        value = value + loss.detach()
        recognised.append(hits)
    lengths = current().add(torch.stack([one.square().sum() for one in gradients])).sqrt()
    scales = lengths.mean() / lengths.clamp_min(1e-30)
    joined = sum((one * scale for one, scale in zip(gradients, scales, strict=True)), torch.zeros_like(photos))
    along = (photos * joined).sum()
    return along - along.detach() + value, _mean(recognised)


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
