"""The settings of a refined network's training."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from toolkit.core.config import Config, Expect, Flag
from toolkit.core.errors import FieldError
from toolkit.training.classifier_config import DATA, STEPS, Attack, check_name, read_attack

if TYPE_CHECKING:
    from toolkit.training.loop import FitConfig

METHOD = "KL to the network's own softened answers, SGD, gradients cut to length 1, given statistics"
HELD_OUT = 0.2
MOMENTUM = 0.9
"""Momentum of SGD, as in LGV (Gubri et al. 2022, section 3) and in most trainings on ImageNet."""
LONGEST_GRADIENT = 1.0
"""Largest norm of the gradient of all weights. Without it, SGD at 0.01 diverged: a folded ResNet-18 has 10 to 250."""
RHO = 0.005
"""A tenth of what Foret et al. (2021, section 3.1) take on ImageNet: their normalisation makes up for a climb, fixed
statistics do not. At 0.05 the loss of a folded ResNet-18 rises from 0.9 to 8.2."""
AVERAGED = 0.5
"""Share of the steps, at the end, whose weights SWA averages."""
PATH = "Transfer to other networks"


class RefineConfig(Config):
    """Every setting of a network's refinement."""

    name: Annotated[str, AfterValidator(check_name), Flag(positional=True, metavar="NAME")] = Field(
        exclude=True, description="Name of the refined network, for --model NAME afterwards."
    )
    data: Annotated[tuple[str, ...], Field(min_length=1), Flag(metavar="FOLDER", group=DATA)] = Field(
        exclude=True,
        description="Photographs in a folder for each class; a fixed fifth is held out. May be repeated.",
    )
    flat: Annotated[
        Literal["sam", "swa"] | None, Expect("sam or swa"), Flag(metavar="sam|swa", group=PATH, typed=str)
    ] = Field(
        None,
        description="To a flat minimum: sam takes each gradient a little up the slope, which doubles the time; swa "
        "averages the weights of the second half of the steps.",
    )
    rho: Annotated[float | None, Field(gt=0, le=10), Flag(group=PATH, typed=float)] = Field(
        None, description=f"How far up the slope sam goes, length of all weights' change together. Default: {RHO:g}."
    )
    robust: Annotated[
        Attack | None, BeforeValidator(read_attack), Flag(metavar="l2:EPS|linf:EPS", group=PATH, typed=str)
    ] = Field(
        None,
        description="Show the worst photographs in a ball around each, as far as EPS in values of 0 to 1: l2:0.25. It "
        "takes three to four times as long.",
    )
    checkpoints: Annotated[int, Field(ge=1, le=99), Expect("1 to 99"), Flag(group=PATH)] = Field(
        1, description="Keep so many networks along the way, at a constant rate; --model NAME means all of them."
    )
    steps: Annotated[int, Field(ge=1), Flag(group=STEPS)] = Field(500, description="Gradient steps.")
    batch: Annotated[int, Field(ge=1), Flag(group=STEPS)] = Field(32, description="Photographs per step.")
    lr: Annotated[
        float, Field(gt=0, le=10), Expect("a number above 0 and at most 10, such as 0.001"), Flag(group=STEPS)
    ] = Field(0.001, description="Highest learning rate; constant with several checkpoints, and with swa.")
    temperature: Annotated[float, Field(gt=0, le=100), Flag(group=STEPS)] = Field(
        2.0, description="Both networks' logits are divided by it before they are compared."
    )
    seed: Annotated[int, Field(ge=0)] = Field(0, description="Seed of every random draw.")

    @model_validator(mode="after")
    def _check_path(self) -> "RefineConfig":
        if self.checkpoints > self.steps:
            raise FieldError(
                f"expected at most {self.steps}, one for each of the {{steps}}", {"checkpoints": self.checkpoints}
            )
        if self.checkpoints > 1 and self.flat == "swa":
            raise FieldError(
                "swa makes one network of the way: leave one of the two out",
                {"flat": self.flat, "checkpoints": self.checkpoints},
            )
        if self.flat != "sam" and self.rho is not None:
            raise FieldError("expected together with {flat} sam", {"rho": self.rho})
        return self

    @property
    def kept_steps(self) -> list[int]:
        """Steps, counted from 1, after which a network is kept: evenly spaced, with the last step among them."""
        return [self.steps * (k + 1) // self.checkpoints for k in range(self.checkpoints)]

    @property
    def names(self) -> list[str]:
        """Names of the networks: the name itself, or numbered names for several networks."""
        if self.checkpoints == 1:
            return [self.name]
        return [f"{self.name}-{k + 1:02d}" for k in range(self.checkpoints)]

    @property
    def first_averaged(self) -> int:
        """The first step, counted from 0, whose weights SWA averages."""
        return int(self.steps * (1 - AVERAGED))

    def fit_config(self) -> "FitConfig":
        """For the training loop."""
        from toolkit.training.loop import FitConfig

        # along the way networks differ only while the rate is high (Izmailov et al. 2018; Gubri et al. 2022)
        is_constant = self.checkpoints > 1 or self.flat == "swa"
        return FitConfig(
            self.steps, self.lr, "constant" if is_constant else "one-cycle", "sgd", self.seed, momentum=MOMENTUM,
            rho=(self.rho or RHO) if self.flat == "sam" else 0.0,
        )  # fmt: skip

    def record(self) -> dict[str, Any]:
        """Every hyper-parameter, as recorded."""
        rho = (self.rho or RHO) if self.flat == "sam" else None
        return {"method": METHOD, **super().record(), "rho": rho}

    def words(self, teacher: str) -> str:
        """The training data in a few words."""
        robust = "" if self.robust is None else f", each moved to where its loss is largest ({self.robust.describe()})"
        flat = "" if self.flat is None else f", {self.flat}"
        return f"{teacher}'s own answers to photographs{robust}{flat}"
