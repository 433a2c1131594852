"""Whether a booster met the network that judges it: its record names the networks that it was trained on."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from toolkit.captures.read import POOLED, Capture
from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json
from toolkit.core.workspace import Workspace
from toolkit.objects.records import BoosterRecord, NetworkRecord, PatchRecord, TextureRecord

MOST_NAMED = 3


@dataclass(frozen=True)
class Training:
    """What is known of the training of what an object wears.

    Attributes:
        source, object, variant: the images that it is on.
        booster, booster_sha256: the name and the PNG's hash of the patch or texture.
        networks: that it was trained on.
        seen: whether the network that judges is among them, by its weights' hash.
    """

    source: str
    object: str
    variant: str
    booster: str
    booster_sha256: str
    networks: tuple[NetworkRecord, ...]
    seen: bool

    def as_json(self) -> dict[str, Any]:
        """The fields of `summary.json`."""
        return vars(self) | {"networks": [one.model_dump() for one in self.networks]}


def find_training(captures: Sequence[Capture], workspace: Workspace, weights_sha256: str) -> tuple[Training, ...]:
    """The training of every patch and texture that the manifests name and a record of the workspace describes.

    Args:
        captures: images; those without a manifest, and noise and grey as boosters, have no part in it.
        workspace: whose patches, sets of patches and textures are looked through, the package's own among them.
        weights_sha256: of the network that judges.
    """
    worn = dict.fromkeys(
        (one.source, one.object, one.variant, one.booster_sha256) for one in captures if one.booster_sha256
    )
    if not worn:
        return ()
    records = {record.png_sha256: record for record in _read_records(workspace)}
    found = []
    for source, name, variant, sha256 in worn:
        if sha256 is not None and (record := records.get(sha256)) is not None:
            seen = any(one.sha256 == weights_sha256 for one in record.networks)
            found.append(Training(source, name, variant, record.name, sha256, tuple(record.networks), seen))
    return tuple(found)


def _read_records(workspace: Workspace) -> Iterator[BoosterRecord]:
    """Records that are broken or absent are refused where they are used; here they tell nothing."""
    for patch_set in (None, *workspace.patch_sets()):
        for png in workspace.with_patches(patch_set).patches().values():
            with suppress(ToolkitError):
                yield read_json(png.with_suffix(".json"), PatchRecord)
    for png in workspace.textures().values():
        with suppress(ToolkitError):
            yield read_json(png.with_suffix(".json"), TextureRecord)


def mark_seen(training: Sequence[Training], source: str, name: str, variant: str) -> str:
    """`yes`, `no` or `partly` for a row of the table, pooled ones among them; empty where nothing is known."""
    asked = {
        one.seen for one in training
        if (one.source, one.variant) == (source, variant) and name in (one.object, POOLED)
    }  # fmt: skip
    return "" if not asked else "partly" if len(asked) == 2 else "yes" if asked == {True} else "no"


def describe_unseen(network: str, training: Sequence[Training]) -> list[str]:
    """A line for each source and variant that was judged by a network which its boosters never saw."""
    lines = []
    for source, variant in dict.fromkeys((one.source, one.variant) for one in training if not one.seen):
        some = [one for one in training if (one.source, one.variant, one.seen) == (source, variant, False)]
        names, archs = ({one.object: 0 for one in some}, {net.arch: 0 for one in some for net in one.networks})
        whose = ", ".join(names) if len(names) <= MOST_NAMED else f"{len(names)} objects"
        on = " and ".join(archs) or "no network"
        if network in archs:
            on += " with other weights"
        lines.append(f"{source}: {variant} ({whose}) was trained on {on}; {network} was not seen in training")
    return lines
