"""The settings of an encoder's head."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from toolkit.core.config import Config, Expect, Flag
from toolkit.training.classifier_config import ClassifierConfig, check_name

FIELDS = ClassifierConfig.model_fields


class HeadConfig(Config):
    """Every setting of a head."""

    name: Annotated[str, AfterValidator(check_name), Flag(metavar="NAME")] = Field(
        exclude=True, description=FIELDS["name"].description
    )
    data: Annotated[tuple[str, ...], Flag(metavar="FOLDER|everyday|rig", group="Images")] = Field(
        (), exclude=True, description=FIELDS["data"].description
    )
    kind: Annotated[Literal["linear", "nearest-mean"], Flag("--method", metavar="linear|nearest-mean")] = Field(
        "linear", description="linear: logistic regression on the features. nearest-mean: for a few images per class."
    )
    tokens: Annotated[Literal["first", "mean"] | None, Flag(metavar="first|mean")] = Field(
        None, description="If the encoder gives a vector for each token: use the first (class) token, or their mean."
    )
    l2: Annotated[float, Field(gt=0, le=1000), Expect("a number above 0, such as 0.01"), Flag()] = Field(
        0.01, description="Weight of the squared length of the linear head, of features of deviation 1."
    )
    per_class: Annotated[int, Field(ge=1), Flag(group="Images")] = Field(
        60, description=FIELDS["per_class"].description
    )
    views: Annotated[int, Field(ge=1), Flag(group="Images")] = Field(12, description=FIELDS["views"].description)
    held_out: Annotated[
        float, Field(ge=0, lt=1), Expect("a share from 0 to below 1, such as 0.1"), Flag(group="Images")
    ] = Field(0.2, description=FIELDS["held_out"].description)
    seed: Annotated[int, Field(ge=0)] = Field(0, description="Seed of the held-out images and of renders.")
