"""What `toolkit train-texture` is asked for, and the hash that says whether two requests are the same run."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolkit.boosters.linear_view import GRADIENTS
from toolkit.boosters.parts.base import ImagePart
from toolkit.boosters.parts.light import Exposure
from toolkit.boosters.patch_steps import Descent, Target
from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.files import sha256_bytes
from toolkit.rig.views import ViewSettings

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


METHOD = "unadversarial texture, Algorithm 2"
METHOD_VERSION = 1
"""Raised when the same request gives other numbers: an older checkpoint is then another run's."""
MIN_PX, MAX_PX = 8, 1024


@dataclass(frozen=True)
class TextureRequest:
    """One texture to train. Parts that are None or empty do not act.

    Attributes:
        objects: who wears it; several share one universal texture.
        class_name: a label of the networks, an index, or a WordNet id; None: the class that the objects' specs name.
        size_px: n, side of the texture.
        keep: materials that keep their paint.
        keep_image: picture in the object's own texture coordinates, white where it keeps its paint.
        unwrap: make new texture coordinates; None: where the mesh has none of use.
        descent: steps, batch, learning rate, seed.
        optimiser: one of `OPTIMISERS`.
        gradient: one of `GRADIENTS`.
        views: where the camera and the light may stand.
        reuse: how often each rendered view is used.
        exposure: of the photographs.
        camera: what is done to a photograph, in this order.
        backgrounds: folder of photographs to stand behind the object.
        background_share: of the views that they stand behind.
        held_out: studios, of `views.per_studio` views each, that are not trained on.
        name: of its files; by default the object's, for several objects the class's.
        recipe: whose settings these are, flags apart.
    """

    objects: tuple[str, ...]
    class_name: str | None = None
    size_px: int = 200
    keep: tuple[str, ...] = ()
    keep_image: Path | None = None
    unwrap: bool | None = None
    descent: Descent = field(default_factory=Descent)
    optimiser: str = "sign"
    gradient: str = "shaded"
    views: ViewSettings = field(default_factory=ViewSettings)
    reuse: int = 3
    exposure: Exposure | None = field(default_factory=Exposure)
    camera: tuple[ImagePart, ...] = ()
    backgrounds: Path | None = None
    background_share: float = 0.0
    held_out: int = 3
    name: str | None = None
    recipe: str = "custom"

    def __post_init__(self) -> None:
        if not self.objects:
            raise ToolkitError(
                "--object: expected at least one object to wear the texture; 'toolkit objects' lists them"
            )
        if len(set(self.objects)) < len(self.objects):
            raise ToolkitError(f"--object {' '.join(self.objects)}: expected each object once")
        if not MIN_PX <= self.size_px <= MAX_PX:
            raise ToolkitError(f"--size-px {self.size_px}: expected {MIN_PX} to {MAX_PX}, the side of the texture")
        if self.optimiser not in OPTIMISERS:
            raise one_of("optimiser", self.optimiser, list(OPTIMISERS))
        if self.gradient not in GRADIENTS:
            raise one_of("gradient", self.gradient, list(GRADIENTS))
        if self.reuse < 1:
            raise ToolkitError(f"--reuse {self.reuse}: expected at least 1, how often a rendered view is used")
        if not 0 <= self.background_share <= 1:
            raise ToolkitError(f"--background-share {self.background_share:g}: expected 0 to 1")
        if self.background_share and self.backgrounds is None:
            raise ToolkitError(
                f"--background-share {self.background_share:g} needs photographs: add --backgrounds FOLDER, or say 0"
            )
        if self.keep_image is not None and len(self.objects) > 1:
            raise ToolkitError("--keep-image is of one object's texture coordinates: train one object, or use --keep")

    @property
    def steps_per_group(self) -> int:
        """How many steps a group of views serves."""
        return max(1, self.views.studios * self.views.per_studio * self.reuse // self.descent.batch)

    @property
    def groups(self) -> int:
        """How many groups of views the run needs."""
        return -(-self.descent.steps // self.steps_per_group)

    def settings(self) -> dict[str, Any]:
        """Every hyper-parameter, as recorded beside the texture."""
        return {
            "method": METHOD,
            "recipe": self.recipe,
            **asdict(self.descent),
            "optimiser": self.optimiser,
            "gradient": self.gradient,
            "views": asdict(self.views),
            "reuse": self.reuse,
            "exposure": None if self.exposure is None else asdict(self.exposure),
            "camera": {type(part).__name__: asdict(part) for part in self.camera} or None,  # type: ignore[call-overload]
            "background_share": self.background_share,
            "held_out_views": self.held_out * self.views.per_studio,
        }


def hash_inputs(request: TextureRequest, name: str, targets: list[Target], data_sha256: str) -> str:
    """Hash of all that decides the texture's pixels; `data_sha256` is of the meshes and the backgrounds."""
    networks = [[t.classifier.arch, t.classifier.weights.sha256, t.class_index] for t in targets]
    inputs = [METHOD_VERSION, name, networks, data_sha256, request.size_px, request.objects, request.settings()]
    return sha256_bytes(json.dumps(inputs, sort_keys=True).encode())
