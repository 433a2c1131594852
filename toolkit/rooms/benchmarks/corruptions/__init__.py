"""The corruption benchmark: a corrupted data set with patches, shown to a classifier (the paper, Appendix D).

Here are its settings, for the command line and for Python; nothing heavy is loaded for them.
"""

from typing import Annotated

from pydantic import Field

from toolkit.boosters.transforms.placement import Placement
from toolkit.core.config import Config, Flag
from toolkit.corruptions.catalogue import parse_corruptions
from toolkit.evaluation import Corruptions, RunName

CLEAN = "clean"
Condition = tuple[str, int]
"""(corruption, severity) of the images in a cell; `clean` and 0 without a corruption."""
NOT_CORRUPTED: Condition = (CLEAN, 0)


class CorruptEvalConfig(Config):
    """A run of the corruption benchmark; see `evaluate_benchmark`."""

    patches: Annotated[tuple[str, ...], Flag(metavar="SET[@MODEL]")] = Field(
        (), description="Patch set below print/patches, repeatable; SET@MODEL is answered by another classifier."
    )
    corruptions: Annotated[Corruptions | None, Flag("--corrupt", metavar="NAME[:SEVERITY]", typed=tuple[str, ...])] = (
        Field(None, description="A corruption, a family, common (15) or all; fog:3, noise:1-3. Default: common.")
    )
    classes: Annotated[tuple[str, ...], Flag("--class", metavar="NAME")] = Field(
        (), description="Label, index or WordNet id. Default: all with images and patches."
    )
    per_class: Annotated[int | None, Field(ge=1), Flag()] = Field(
        None, description="Largest number of images of each class, drawn by the seed."
    )
    placement: Placement = Field(default_factory=Placement)
    run: Annotated[RunName | None, Flag(metavar="NAME")] = Field(
        None, description="Name of the results folder. Default: from data and model."
    )
    seed: Annotated[int, Field(ge=0), Flag()] = Field(0, description="Same seed, same bytes on the same machine.")

    @property
    def conditions(self) -> list[Condition]:
        """Not corrupted, then the corruptions."""
        return [NOT_CORRUPTED, *(parse_corruptions(["common"]) if self.corruptions is None else self.corruptions)]
