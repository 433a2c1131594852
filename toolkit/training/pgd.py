"""Attacks on images by projected gradient descent (Madry et al. 2018): to train a robust classifier, and to test it.

Step sizes are those of robust-models-transfer (Salman et al. 2020, "Do adversarially robust ImageNet models transfer
better?"), whose networks met 3 steps of 2/3 of the radius. As in MadryLab's robustness library a step goes along the
gradient made of length one (l2) or its sign (linf), nothing is drawn at random, and the worst of all images on the way
is the answer.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, computed_field, model_validator

from toolkit.core.config import Config, Flag
from toolkit.core.errors import FieldError

if TYPE_CHECKING:
    import torch

LARGEST = {"l2": 1000.0, "linf": 1.0}
"""Radius of the ball by its norm: black and white of 577 px are so far apart, and one value's ends."""
STEPS = 3
REACH = 2.0
"""All steps together, in radii: they get from the middle to any place of the ball, and along its border."""
TINY = 1e-10


class Attack(Config):
    """How far an image may be moved, in values from 0 to 1, and in how many steps the worst place is looked for."""

    norm: Literal["l2", "linf"]
    eps: Annotated[float, Field(gt=0)]
    steps: Annotated[int, Field(ge=1), Flag("--attack-steps", group="Steps")] = Field(
        STEPS, description="Of gradient ascent on each image, for {robust}; each of 2/N of the radius."
    )

    @model_validator(mode="after")
    def _check_eps(self) -> "Attack":
        if self.eps > (most := LARGEST[self.norm]):
            raise FieldError(f"expected at most {most:g}, in values of 0 to 1", {"eps": self.eps})
        return self

    @computed_field  # type: ignore[prop-decorator]
    @property
    def step_size(self) -> float:
        """Length of a step, in the norm."""
        return REACH * self.eps / self.steps

    def describe(self) -> str:
        """Such as `l2 0.5, 3 steps`."""
        return f"{self.norm} {self.eps:.4g}, {self.steps} step{'s' if self.steps > 1 else ''}"

    def climb(self, images: "torch.Tensor", gradient: "torch.Tensor") -> "torch.Tensor":
        """Images (b, 3, h, w), each moved by one step up its gradient."""
        if self.norm == "linf":
            return images + self.step_size * gradient.sign()
        return images + self.step_size * gradient / (_length(gradient) + TINY)

    def project(self, moved: "torch.Tensor", images: "torch.Tensor") -> "torch.Tensor":
        """The place nearest to each of `moved` in the ball around its image; then values are clipped to 0 to 1."""
        away = moved - images
        if self.norm == "linf":
            away = away.clamp(-self.eps, self.eps)
        else:
            away = away * (self.eps / _length(away).clamp(min=self.eps))
        return (images + away).clamp(0, 1)


def read_attack(given: object) -> object:
    """An `Attack` from words such as `l2:0.5` or `linf:8/255`; anything else as it is.

    Raises:
        ValueError: the words are none.
    """
    if not isinstance(given, str):
        return given
    norm, _, eps = given.partition(":")
    above, _, below = eps.partition("/")
    try:
        radius = float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError):
        radius = -1.0
    if norm not in LARGEST or not 0 < radius <= LARGEST[norm]:
        raise ValueError("expected l2:EPS or linf:EPS in values of 0 to 1, such as l2:0.5 or linf:8/255")
    return Attack(norm=norm, eps=radius)


def find_worst_images(
    images: "torch.Tensor", measure_losses: "Callable[[torch.Tensor], torch.Tensor]", attack: Attack
) -> "torch.Tensor":
    """The images of the ball around each at which its loss was found to be largest, the image itself among them.

    Args:
        images: (b, 3, h, w) float, sRGB-encoded in [0, 1].
        measure_losses: images to their losses (b,), differentiable; one image's loss may not depend on another image.
        attack: the ball and the steps.

    Returns:
        (b, 3, h, w) without gradient, in [0, 1].
    """
    import torch

    images = moved = worst = images.detach()
    highest: torch.Tensor | None = None
    for _ in range(attack.steps):
        moved = moved.detach().requires_grad_()
        with torch.enable_grad():
            losses = measure_losses(moved)
            (gradient,) = torch.autograd.grad(losses.sum(), moved)
        with torch.no_grad():
            worst, highest = _keep_higher(worst, highest, moved, losses)
            moved = attack.project(attack.climb(moved, gradient), images)
    with torch.no_grad():
        worst, _ = _keep_higher(worst, highest, moved, measure_losses(moved))
    return worst.detach()


def _keep_higher(
    worst: "torch.Tensor", highest: "torch.Tensor | None", moved: "torch.Tensor", losses: "torch.Tensor"
) -> "tuple[torch.Tensor, torch.Tensor]":
    import torch

    if highest is None:
        return moved, losses
    is_higher = losses > highest
    return torch.where(is_higher.view(-1, 1, 1, 1), moved, worst), torch.where(is_higher, losses, highest)


def _length(batch: "torch.Tensor") -> "torch.Tensor":
    """(b, 3, h, w) to the l2 norm of each, (b, 1, 1, 1)."""
    return batch.flatten(1).norm(dim=1).view(-1, 1, 1, 1)
