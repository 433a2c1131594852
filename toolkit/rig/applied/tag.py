"""A fiducial tag in the place of an object's patch: what a printed sheet says to a reader, and not to a network."""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.objects.load import TableObject
from toolkit.objects.records import encode_png
from toolkit.objects.spec import printed_size_mm
from toolkit.rig.applied.patch import PatchBooster
from toolkit.rig.markers import count_markers, find_family, marker_modules

TYPED = re.compile(r"tag[:-](?P<family>\w+)[:-](?P<id>\d{1,5})")
MODULE_PX = 8
"""Texels of a module, so that its edges stay sharp where a texture is looked up between texels."""
PATCH_PX = 100
"""A sheet whose size the object's spec does not state is as large as a printed patch of so many texels."""


@dataclass(frozen=True)
class Tag:
    """A tag of a family."""

    dictionary: str  # of OpenCV
    id: int  # its number


def parse_tag(variant: str) -> Tag | None:
    """The tag of a variant that is called `tag:36h11:0`, or as its folder `tag-36h11-0`; None of other variants.

    Raises:
        ToolkitError: there is no such family, or it lacks the number.
    """
    if not variant.startswith(("tag:", "tag-")):
        return None
    # the folder's name has dashes, since colons are no good in paths
    found = TYPED.fullmatch(variant)
    if found is None:
        raise ToolkitError(f"variant '{variant}': expected tag:FAMILY:NUMBER, such as tag:36h11:0")
    tag = Tag(find_family(found["family"]), int(found["id"]))
    if tag.id >= (known := count_markers(tag.dictionary)):
        raise ToolkitError(f"variant '{variant}': {found['family']} has the tags 0 to {known - 1}")
    return tag


def name_variant(variant: str) -> str:
    """The name of a variant's folder: `tag-36h11-0` for `tag:36h11:0`; others have their own."""
    return variant if parse_tag(variant) is None else variant.replace(":", "-")


class TagBooster(PatchBooster):
    """A tag with its white border on the object's sheets, as large as its patch."""

    def describe(self, item: TableObject) -> dict[str, Any]:
        """Return the tag's hash, with the sizes and places of its sheets."""
        return {"tag": self.sha256, **self._describe_sheets(item)}


def find_tag_booster(item: TableObject, variant: str, tag: Tag) -> TagBooster:
    """Return a tag on an object's sheets, with a white border of a module inside their size."""
    modules = np.pad(marker_modules(tag.dictionary, tag.id), 1, constant_values=False)
    grey = np.where(np.kron(modules, np.ones((MODULE_PX, MODULE_PX), bool)), 0, 255).astype(np.uint8)
    pixels = np.repeat(grey[..., None], 3, axis=2)
    sizes_mm = item.spec.sizes_mm(printed_size_mm(PATCH_PX))
    return TagBooster(pixels, sha256_bytes(encode_png(pixels)), name_variant(variant), sizes_mm)
