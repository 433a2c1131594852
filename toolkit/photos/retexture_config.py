"""What `toolkit retexture` can be told."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from toolkit.core.config import Config, Flag


class RetextureConfig(Config):
    """What is put into which photographs."""

    found: Annotated[tuple[str, ...], Field(min_length=1), Flag("--found", metavar="PATCH")] = Field(
        description="The patch that is printed there: its name, or a PNG of its texels. Several are told apart."
    )
    given: Annotated[tuple[str, ...], Flag("--as", metavar="PATCH")] = Field(
        (), description="What takes its place, by name or PNG: first 'patched', then 'other-patch', then by name."
    )
    object: Annotated[str | None, Flag("--object", metavar="NAME")] = Field(
        None, description="Name of what is photographed. Default: the folder's."
    )
    bare: Annotated[tuple[Path, ...], Flag("--bare", metavar="PHOTO")] = Field(
        (), description="True photographs without a patch; as many as with one are paired in order of name."
    )
    seed: Annotated[int, Field(ge=0)] = Field(0, description="Of the noise and of the random patch.")
