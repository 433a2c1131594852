"""Transfer of boosters to other networks: train on all networks but one, and test on the left-out network.

Here are its settings, for the command line and for Python; nothing heavy is loaded for them.
"""

from typing import Annotated, Any, Literal

from pydantic import Field

from toolkit.boosters.pixel_config import CORRUPTED_HELP, TRANSFER, MeetsCorruptions
from toolkit.boosters.texture_config import MaxChange
from toolkit.boosters.transforms.camera import Jitter
from toolkit.boosters.transforms.transfer import FeatureMixup
from toolkit.core.config import Config, Flag, Later
from toolkit.evaluation import Corruptions, RunName

Kind = Literal["patch", "texture"]
FOR_CLASSIFIERS = ("jitter", "feature_mixup")
OF_TRAINING = (
    "steps", "batch", "ensemble", "objective", *FOR_CLASSIFIERS, "momentum", "last_smoothing_px", "corrupted",
)  # fmt: skip


class TransferConfig(Config):
    """An experiment; see `leave_one_out`. Boosters are trained by the default recipes with these changes."""

    objects: Annotated[tuple[str, ...], Flag("--object", metavar="NAME")] = Field(
        (), description="Object to train for; repeat for more. Default: all that are known."
    )
    kinds: Annotated[tuple[Kind, ...], Flag("--kind", metavar="KIND", typed=tuple[str, ...])] = Field(
        ("patch", "texture"), description="patch or texture; repeat for both."
    )
    left_out: Annotated[tuple[str, ...], Flag("--leave-out", metavar="NAME")] = Field(
        (),
        description="Leave out only this network, by its name in --model; repeat for more. Default: each once. "
        "With detectors among them: classifiers or detectors, all of that kind; default: each kind once.",
    )
    corruptions: Annotated[Corruptions, Flag("--also", metavar="NAME[:SEVERITY]", typed=tuple[str, ...])] = Field(
        (("fog", 3),), description="Also judge the images under this corruption of ImageNet-C."
    )
    run: Annotated[RunName, Flag(metavar="NAME")] = Field("leave-one-out", description="Folder under eval/transfer.")
    seed: Annotated[int, Field(ge=0), Flag()] = Field(0, description="Same seed, same bytes on the same machine.")
    steps: Annotated[int | None, Field(ge=1), Flag(group=TRANSFER)] = Field(
        None, description="Gradient steps. Default: the recipe's, patches 600 and textures 300."
    )
    batch: Annotated[int | None, Field(ge=1), Flag(group=TRANSFER)] = Field(
        None, description="Images per step. Default: the recipe's, 16."
    )
    ensemble: Annotated[Literal["sum", "normalised", "turns"] | None, Flag(group=TRANSFER)] = Field(
        None, description="How the networks are joined, as in train-patch."
    )
    objective: Annotated[Literal["cross-entropy", "logit"] | None, Flag(group=TRANSFER)] = Field(
        None, description="Objective of training, as in train-patch."
    )
    jitter: Annotated[Jitter | None, Flag("--view-jitter", group=TRANSFER)] = Field(
        None, description="As in train-patch."
    )
    feature_mixup: Annotated[FeatureMixup | None, Later, Flag("--feature-mixup", group=TRANSFER)] = Field(
        None, description="As in train-patch."
    )
    momentum: Annotated[float | None, Field(ge=0, lt=1), Flag(group=TRANSFER)] = Field(
        None, description="As in train-patch."
    )
    last_smoothing_px: Annotated[float | None, Field(ge=0, le=16), Flag("--last-smoothing", group=TRANSFER)] = Field(
        None, description="As in train-patch."
    )
    max_change: Annotated[MaxChange, Flag(metavar="X|auto", group=TRANSFER, typed=str)] = Field(
        None, description="For textures, as in train-texture."
    )
    corrupted: MeetsCorruptions = Field(None, description=CORRUPTED_HELP)

    def overrides(self, kind: Kind) -> dict[str, Any]:
        """Settings of training that differ from the recipe's."""
        names = (*OF_TRAINING, "max_change") if kind == "texture" else OF_TRAINING
        chosen = {name: getattr(self, name) for name in names}
        return {name: value for name, value in chosen.items() if value is not None} | {"seed": self.seed}
