"""Settings of `toolkit import` and `toolkit retexture`; nothing heavy is loaded for them."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from toolkit.core.config import Config, Expect, Flag
from toolkit.core.errors import FieldError
from toolkit.core.text import FOLDER


class RetextureConfig(Config):
    """Which patches go into which photographs."""

    found: Annotated[tuple[str, ...], Field(min_length=1), Flag("--found", metavar="PATCH")] = Field(
        description="The patch printed in the photographs: its name, or a PNG of its texels. May be repeated."
    )
    given: Annotated[tuple[str, ...], Flag("--as", metavar="PATCH")] = Field(
        (), description="Patch that takes its place, by name or PNG: 'patched', then 'other-patch', then by name."
    )
    object: Annotated[str | None, Flag("--object", metavar="NAME")] = Field(
        None, description="Name of what is photographed. Default: the folder's."
    )
    bare: Annotated[tuple[Path, ...], Flag("--bare", metavar="PHOTO")] = Field(
        (),
        description="Photographs without a patch. As many as with a patch are paired in order of name.",
    )
    seed: Annotated[int, Field(ge=0)] = Field(0, description="Seed of the noise and of the random patch.")


Source = Annotated[
    str, Field(pattern=f"^{FOLDER.pattern}$"), Expect("the name of one folder below captures/"), Flag(metavar="NAME")
]


class ImportSettings(Config):
    """How to import; fields that need, or exclude, each other raise `FieldError`."""

    object: Annotated[str | None, Flag(metavar="NAME")] = Field(
        None, description="Object in all photographs. Default: as folders, names or the shot list say."
    )
    variant: Annotated[str | None, Flag(metavar="NAME")] = Field(
        None, description="unpatched, patched, a control, or a booster's name. Default: as for --object."
    )
    pose: Annotated[int | None, Field(ge=1), Flag()] = Field(None, description="Pose of a single photograph.")
    match: Annotated[Literal["auto", "board", "name", "order", "render"], Flag(metavar="HOW")] = Field(
        "auto", description="Find the pose by board, name (pose_07), order (of time), render, or auto."
    )
    first_shot: Annotated[int | None, Field(ge=1), Flag()] = Field(
        None, description="Shot number of the first photograph, if these are only a part of the shot list."
    )
    pairs: Annotated[Path | None, Flag(metavar="FILE", typed=Path)] = Field(
        None, description="Table file,object,variant,pose[,class]: what each photograph shows; needs no plan or board."
    )
    link: Annotated[bool, Flag("--link")] = Field(False, description="Hard links instead of copies, where possible.")
    replace: Annotated[bool, Flag("--replace")] = Field(
        False, description="A retake replaces the earlier photograph, which is kept aside."
    )
    every_s: Annotated[float | None, Field(ge=0.05, le=3600), Flag("--every", metavar="SECONDS")] = Field(
        None, description="Seconds between two frames of a video. Default: a frame whenever the camera rests."
    )
    source: Source = Field("real", description="Folder below captures/.")

    @model_validator(mode="after")
    def _check(self) -> "ImportSettings":
        if self.pose is not None and not (self.object and self.variant):
            raise FieldError("the pose of a photograph: give {object} and {variant} with it", {"pose": self.pose})
        if self.pairs is not None and (self.object or self.variant or self.pose or self.first_shot):
            raise FieldError("the table names object, variant and pose: leave the others out", {"pairs": self.pairs})
        if self.first_shot is not None and (self.object or self.variant):
            raise FieldError(
                "counts in the whole shot list: leave {object} and {variant} out", {"first_shot": self.first_shot}
            )
        return self
