"""A patch for one object by the default recipe, its class and size from its spec; and places for it, tried out."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from toolkit.boosters.data import DataConfig
from toolkit.boosters.patch import TrainedPatch, train_patch
from toolkit.boosters.patch_config import limit_renders, make_config, size_by_spec
from toolkit.boosters.pixels import Network
from toolkit.boosters.validation import Validation
from toolkit.core.workspace import Workspace, copy_objects
from toolkit.objects.spec import PatchMount, read_spec, write_mounts


def train_for_object(
    workspace: Workspace, name: str, networks: Sequence[Network], overrides: Mapping[str, Any], seed: int = 0
) -> TrainedPatch:
    """Train the patch of an object on renders of it, as `toolkit train-patch --object NAME` does.

    Raises:
        ToolkitError: an unknown object, or as `train_patch`.
    """
    spec = read_spec(workspace.object_spec(name))
    data = DataConfig(sources=(f"rig:{name}",), seed=seed)
    config = make_config("default", size_by_spec({**overrides, "seed": seed}, spec), data)
    config, data = limit_renders(config, data)
    return train_patch(config, spec.class_name, networks, data, workspace, name=name)


def try_place(
    workspace: Workspace, name: str, networks: Sequence[Network], mounts: Sequence[PatchMount], steps: int,
    seed: int = 0,
) -> list[Validation]:  # fmt: skip
    """Train a patch briefly in a place: per network, held-out random views with it, and with grey paper for `bare`.

    In as many places as there are mounts, one for each sheet. Nothing of it is kept.
    """
    with TemporaryDirectory() as folder:
        space = copy_objects(workspace, Path(folder))
        write_mounts(workspace.object_spec(name), space.objects_dir / f"{name}.toml", mounts)
        return train_for_object(space, name, networks, {"steps": steps}, seed).on_object
