"""What a photograph of an object, a variant and a pose should show, from the workspace's objects, patches and board."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from toolkit.captures.manifest import CaptureRecord
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.records import read_patch
from toolkit.photos.gates.check_photo import Expectation
from toolkit.photos.gates.patch import ExpectedPatch, PlacedSheet, place_cells
from toolkit.photos.gates.solid import Solid
from toolkit.photos.gates.which_object import KnownObjects
from toolkit.photos.posed_camera import PosedCamera
from toolkit.photos.prints.features import describe_patch
from toolkit.rig.board import Board
from toolkit.rig.board_file import read_board
from toolkit.rig.mount import MountedSheet, attach
from toolkit.rig.variants import VARIANTS, Print, apply_booster, find_booster, mount_printed

Built = tuple[Solid | None, ExpectedPatch | None, str]
"""What is expected of an object in a variant: its shape, its patch, and why that is not known."""


class ExpectationBuilder:
    """Makes expectations; objects are built once for each variant and kept.

    Args:
        workspace: whose objects, patches and board are meant.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace, self.known = workspace, KnownObjects(workspace)
        self._kept: dict[tuple[str, str], Built] = {}

    @cached_property
    def board(self) -> Board:
        """The board of the workspace; a broken `rig/board.json` is a `ToolkitError`."""
        return read_board(self._workspace)

    def expect(
        self, object_name: str, variant: str, pose_id: int | None = None, view: PosedCamera | None = None,
        no_pose: str = "no board is seen",
    ) -> Expectation:  # fmt: skip
        """What such a photograph should show.

        An object or a patch that cannot be read does not stop a photograph: the gates that need it say so.

        Args:
            object_name, variant, pose_id: what is shown.
            view: its camera, from the manifest or the board.
            no_pose: why there is none.
        """
        key = (object_name, variant)
        if key not in self._kept:
            self._kept[key] = self._build(object_name, variant)
        solid, patch, no_patch = self._kept[key]
        return Expectation(
            object_name, variant, pose_id, view, no_pose, board=self.board, solid=solid, patch=patch, no_patch=no_patch,
            known=self.known,
        )  # fmt: skip

    def prepare(self, object_name: str, variant: str) -> None:
        """Build now what the first photograph would wait for: the object, and the local features of all patches."""
        self.expect(object_name, variant)
        for pixels in self._patches.values():
            describe_patch(pixels)

    def expect_record(self, record: CaptureRecord) -> Expectation:
        """What the photograph of a manifest's line should show."""
        return self.expect(record.object, record.variant, record.pose_id, view_of_record(record))

    @cached_property
    def _patches(self) -> dict[str, np.ndarray]:
        """Pixels of the workspace's patches by name; those that are broken are none that could be seen."""
        found = {}
        for name, file in self._workspace.patches().items():
            try:
                found[name] = read_patch(file).pixels
            except ToolkitError:
                continue  # the command that prints or shoots it says what is wrong
        return found

    def _build(self, object_name: str, variant: str) -> Built:
        try:
            item = load_object(self._workspace.object_spec(object_name))
        except ToolkitError:
            return None, None, f"the object '{object_name}' is not known"
        if variant not in VARIANTS:
            return Solid(item.mesh), None, f"what '{variant}' has on it is not known"
        try:
            booster = find_booster(self._workspace, item, variant)
            if isinstance(booster, Print):
                return self._dress(item, variant, booster)
        except ToolkitError as error:
            return Solid(item.mesh), None, str(error)
        # paint changes no shape; the object's own patch is the one that may have been left on
        return Solid(item.mesh), self._without_patch(item), ""

    def _dress(self, item: TableObject, variant: str, booster: Print) -> Built:
        if variant == "grey-patch":
            return Solid(apply_booster(item, booster)), None, "a grey patch has no marks by which it could be found"
        patches = {**self._patches, booster.name: booster.pixels}
        if booster.alone:
            return Solid(apply_booster(item, booster)), ExpectedPatch(booster.name, patches), ""
        sheets = mount_printed(item, booster)
        return Solid(attach(item.mesh, *sheets)), ExpectedPatch(booster.name, patches, None, _place(item, sheets)), ""

    def _without_patch(self, item: TableObject) -> ExpectedPatch:
        try:
            home = find_booster(self._workspace, item, "patched")
            assert isinstance(home, Print)
            sheets = mount_printed(item, home)
        except ToolkitError:  # it has none, or none that fits: there is nothing to leave on
            return ExpectedPatch(None, self._patches)
        return ExpectedPatch(None, {**self._patches, home.name: home.pixels}, home.name, _place(item, sheets))


def _place(item: TableObject, sheets: Sequence[MountedSheet]) -> tuple[PlacedSheet, ...]:
    return tuple(place_cells(sheet, mount.at) for sheet, mount in zip(sheets, item.spec.mounts, strict=True))


def view_of_record(record: CaptureRecord) -> PosedCamera | None:
    """The camera that a manifest's line has; None where it has none."""
    if record.T_world_camera is None or (camera := record.camera) is None:
        return None
    return PosedCamera(np.array(record.T_world_camera, float), camera)
