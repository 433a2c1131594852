"""How a texture moves along its gradient: the seed's sign step, SGD, and Adam."""

from typing import TYPE_CHECKING

import numpy as np

from toolkit.errors import one_of

if TYPE_CHECKING:
    import torch

OPTIMISERS = ("sign", "sgd", "adam")
MOMENTUM = 0.9


class Optimiser:
    """Moves θ in place; its state can be written down and taken up again.

    - `sign`: θ ← θ - η sign(g), Algorithm 2.
    - `sgd`: momentum 0.9 on g divided by its root mean square over the texels that are seen, so that η means the same.
    - `adam`: Kingma and Ba 2015, with their defaults.
    """

    def __init__(self, name: str, texture: "torch.Tensor", done: int, state: dict[str, np.ndarray]) -> None:
        """Begin, or go on.

        Args:
            name: one of `OPTIMISERS`.
            texture: θ, moved in place.
            done: steps made before.
            state: from `arrays` after these.

        Raises:
            ToolkitError: an unknown name.
        """
        import torch

        if name not in OPTIMISERS:
            raise one_of("optimiser", name, list(OPTIMISERS))
        self._texture = texture
        self._rule: torch.optim.Optimizer | None = None
        if name == "sgd":
            self._rule = torch.optim.SGD([texture], lr=1.0, momentum=MOMENTUM)
        if name == "adam":
            self._rule = torch.optim.Adam([texture], lr=1.0)
        if self._rule is not None and done:
            kept = {key: torch.from_numpy(np.array(array)).to(texture.device) for key, array in state.items()}
            if name == "adam":
                kept["step"] = torch.tensor(float(done))
            self._rule.state[texture] = kept

    def step(self, gradient: "torch.Tensor", lr: float) -> None:
        """Move by one step and stay in [0, 1]."""
        import torch

        with torch.no_grad():
            if self._rule is None:
                self._texture.sub_(lr * gradient.sign())
            else:
                seen = (gradient != 0).any(dim=0, keepdim=True).sum().clamp_min(1) * len(gradient)
                size = (gradient.square().sum() / seen).sqrt().clamp_min(1e-12)
                self._texture.grad = gradient / size
                self._rule.param_groups[0]["lr"] = lr
                self._rule.step()
            self._texture.clamp_(0, 1)

    def arrays(self) -> dict[str, np.ndarray]:
        """What must be kept to go on, each of θ's shape."""
        if self._rule is None:
            return {}
        state = self._rule.state[self._texture]
        return {key: value.cpu().numpy().copy() for key, value in state.items() if key != "step" and value is not None}


def state_names(optimiser: str) -> frozenset[str]:
    """Names of what `Optimiser.arrays` holds once a step has been made."""
    return frozenset({"sgd": ("momentum_buffer",), "adam": ("exp_avg", "exp_avg_sq")}.get(optimiser, ()))
