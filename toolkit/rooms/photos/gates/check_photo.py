"""All gates of a photograph, and what it should show by the workspace's objects, patches and board."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np

from toolkit.captures.manifest import CaptureRecord
from toolkit.core.errors import ToolkitError
from toolkit.core.text import join_words
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.records import read_patch
from toolkit.rig.applied.base import AppliedBooster
from toolkit.rig.applied.patch import PATCH, find_patch_booster
from toolkit.rig.board import Board
from toolkit.rig.board_file import read_board
from toolkit.rig.mount import MountedSheet, attach
from toolkit.rig.variants import IN_PIECES, KIND_OF, VARIANTS, find_booster
from toolkit.rooms.photos.board_pose import BoardSighting, find_board
from toolkit.rooms.photos.gates import GateResult
from toolkit.rooms.photos.gates.check_set import PatchLines, trace_patch
from toolkit.rooms.photos.gates.framing import (
    CUT_OFF,
    MISSING,
    OFF_CENTRE,
    check_blur,
    check_centred,
    check_cut_off,
    check_over_exposure,
    check_there,
    check_under_exposure,
    measure_paper,
    middle_of,
)
from toolkit.rooms.photos.gates.objects import OBJECT, KnownObjects, Solid, draw_silhouette, silhouette_px
from toolkit.rooms.photos.gates.patch import (
    HIDDEN,
    LEAST_SEEN,
    VARIANT,
    ExpectedPatch,
    PatchesSeen,
    PlacedSheet,
    check_patch_shows,
    check_variant,
    expect_cells,
    is_clear,
    list_shown,
    look_for_patches,
    place_cells,
    search_region,
)
from toolkit.rooms.photos.gates.pieces import ExpectedWrap, PiecesSeen, check_pieces, cut_squares, look_for_pieces
from toolkit.rooms.photos.lens import scale_lens
from toolkit.rooms.photos.posed_camera import PosedCamera
from toolkit.rooms.photos.prints.features import describe_patch

WORK_SIDE_PX = 1440
"""Longer side of the picture that is judged; larger pictures are shrunk. The gates still see all they need, and a
photograph of 12 megapixels takes a second."""
LEAST_REGION_PX = 400
NO_MARKS = "a grey patch has no marks by which it could be found"


@dataclass(frozen=True)
class Expectation:
    """Object, variant and pose that a photograph should show, and its camera; None for what is not known.

    Attributes:
        view: its camera, and `no_pose` why it is unknown.
        board: that the object stands on.
        solid: the object with its boosters, in its place.
        patch: the patch that belongs on it and those it could be confused with, and `no_patch` why they are unknown.
        wrap: the object's wrap, whether it belongs there or may have been left on.
        known: the objects that it could be mistaken for.
    """

    object: str
    variant: str
    pose_id: int | None = None
    view: PosedCamera | None = field(default=None, repr=False)
    no_pose: str = "no pose"
    board: Board | None = None
    solid: Solid | None = field(default=None, repr=False)
    patch: ExpectedPatch | None = field(default=None, repr=False)
    no_patch: str = "nothing is known of patches"
    wrap: ExpectedWrap | None = field(default=None, repr=False)
    known: KnownObjects | None = field(default=None, repr=False)


@dataclass(frozen=True)
class PhotoCheck:
    """Results of a photograph's gates, and lines of sight to its patch, for `check_set`."""

    results: tuple[GateResult, ...]
    lines: PatchLines | None


def inspect_photo(image: np.ndarray, expectation: Expectation, sighting: BoardSighting | None = None) -> PhotoCheck:
    """Judge a photograph by every gate, each once and in the same order.

    A gate whose input is not known is `not checked`. So is a gate that would repeat another: a blurred photograph does
    not lack its patch as well.

    Args:
        image: (h, w, 3) uint8 sRGB, upright.
        expectation: what it should show.
        sighting: of its board in this image, if it was found before.

    Raises:
        ToolkitError: the view's lens is of pictures of another shape.
    """
    # a classifier sees far fewer pixels: nothing is lost, and every gate gets faster
    small, expectation, sighting = _shrink_all(image, expectation, sighting)
    if sighting is None and expectation.board is not None:
        sighting = find_board(small, expectation.board)
    silhouette = _find_object(small, expectation)
    # blur and exposure are judged on the object, where it is known: the table may be as dark as it likes
    region = middle_of(small) if silhouette is None else silhouette
    pixels = small[region]
    light = [
        check_blur(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), region, sighting, expectation.board),
        check_over_exposure(pixels, is_object=silhouette is not None),
        check_under_exposure(measure_paper(small, sighting) if sighting else None, pixels),
    ]
    framing = _check_framing(expectation, sighting)
    # a failed gate explains that no patch is found; but a patch can be found outside the middle square
    reasons = [result.name for result in (*light, *framing) if result.failed and result.name != OFF_CENTRE.name]
    why_blind = f"no patch is found, but the photograph fails by {join_words(reasons)}" if reasons else None
    # the patch last, since a fault of the picture explains why it is not found
    patch, seen = _check_patch(small, silhouette, expectation, why_blind)
    found = [sheet for sheet in seen.own if sheet is not None] if seen else []
    if silhouette is None and found:  # the sheet is all that is known of the object's place
        mask = np.zeros(small.shape[:2], np.uint8)
        for sheet in found:
            cv2.fillConvexPoly(mask, sheet.corners_px.round().astype(np.int32), 1)
        light[1] = check_over_exposure(small[mask > 0])
    lines = trace_patch(seen.own, expectation.view) if seen and expectation.view else None
    known = expectation.known
    shown = OBJECT.skip("there are no renders") if known is None else known.check(small, expectation.object)
    return PhotoCheck((*light, *framing, shown, *patch), lines)


def _shrink_all(
    image: np.ndarray, expectation: Expectation, sighting: BoardSighting | None
) -> tuple[np.ndarray, Expectation, BoardSighting | None]:  # fmt: skip
    """Return image, view and sighting at the size that is judged."""
    share = min(1.0, WORK_SIDE_PX / max(image.shape[:2]))
    w, h = max(1, round(image.shape[1] * share)), max(1, round(image.shape[0] * share))
    small = cv2.resize(image, (w, h), interpolation=cv2.INTER_AREA) if share < 1 else image
    # lens and corners follow the picture's size
    view = expectation.view
    if view is not None and (view.camera.width, view.camera.height) != (w, h):
        expectation = replace(expectation, view=replace(view, camera=scale_lens(view.camera, w, h)))
    if sighting is not None and (sighting.width, sighting.height) != (w, h):
        corners = sighting.corners_px * [w / sighting.width, h / sighting.height]
        sighting = replace(sighting, corners_px=corners, width=w, height=h)
    return np.ascontiguousarray(small), expectation, sighting


def _find_object(image: np.ndarray, expectation: Expectation) -> np.ndarray | None:
    """(h, w) bool: the object's place; None if it is not known, or outside the picture."""
    if expectation.view is None or expectation.solid is None:
        return None
    mask = draw_silhouette(expectation.solid, expectation.view).astype(np.uint8)
    mask = cv2.resize(mask, image.shape[1::-1], interpolation=cv2.INTER_NEAREST).astype(bool)
    return mask if mask.sum() >= LEAST_REGION_PX else None


def _check_framing(expectation: Expectation, sighting: BoardSighting | None) -> list[GateResult]:
    view, solid = expectation.view, expectation.solid
    if view is None or solid is None:
        why = f"no pose: {expectation.no_pose}" if view is None else "the object's shape is not known"
        return [gate.skip(why) for gate in (CUT_OFF, OFF_CENTRE, MISSING)]
    # an object that is cut off is not judged as off centre as well
    silhouette, size = silhouette_px(solid, view), (view.camera.width, view.camera.height)
    cut = check_cut_off(silhouette, size)
    centred = OFF_CENTRE.skip("it is cut off") if cut.failed else check_centred(silhouette, size)
    if expectation.board is None or sighting is None:
        return [cut, centred, MISSING.skip("no board is seen")]
    return [cut, centred, check_there(solid, view, expectation.board, sighting)]


def _check_patch(
    image: np.ndarray, region: np.ndarray | None, expectation: Expectation, why_blind: str | None
) -> tuple[list[GateResult], PatchesSeen | None]:
    """The two gates of patches and wraps, and which patch was found; `region` as from `_find_object`."""
    patch, wrap, variant = expectation.patch, expectation.wrap, expectation.variant
    # nothing to look for
    if patch is None or not (patch.patches or wrap):
        why = expectation.no_patch
        return [VARIANT.skip(why), HIDDEN.skip(why)], None
    if wrap is not None and wrap.is_on:
        return _check_wrapped(image, region, expectation, patch, why_blind)
    # look for the patch where it should show, and for a wrap if no patch is seen
    expected = [expect_cells(sheet, expectation.solid, expectation.view) for sheet in patch.sheets] or [None]
    shown = list_shown(expected)
    seen = look_for_patches(search_region(image, region), patch, expectation.view, shown)
    pieces = _look_for_wrap(image, expectation) if seen.other is None and not any(seen.own) else None
    # a wrap is on, and should not be
    if wrap is not None and pieces is not None and pieces.is_on:
        should = f"the patch '{patch.own}'" if patch.own else "no wrap"
        said = f"the wrap '{wrap.name}' is seen, '{variant}' should show {should}: change it, or sort the photo again"
        return [VARIANT.judge(1, said), HIDDEN.skip("the wrap is seen, see 'wrong variant'")], seen
    # a missing patch is judged only if it could be seen
    if patch.own is not None and seen.other is None and seen.lacks_own(shown):
        if not any(seen.own) and all(cells is not None and cells.mean() < LEAST_SEEN for cells in expected):
            why_blind = "from this pose the object itself hides most of the patch"
        if why_blind is not None:
            return [VARIANT.skip(why_blind), HIDDEN.skip(why_blind)], seen
    # an absent patch is believed only if it could be seen
    if patch.own is None and seen.other is None:
        why_unsure = why_blind or _why_unsure(expectation, expected) or _why_no_wrap(expectation, pieces)
        if why_unsure is not None:
            return [VARIANT.skip(why_unsure), HIDDEN.skip(f"'{variant}' has none")], seen
    result = check_variant(seen, patch, variant, shown)
    if patch.own is None:
        return [result, HIDDEN.skip(f"'{variant}' has none")], seen
    return [result, check_patch_shows(seen, expected)], seen


def _check_wrapped(
    image: np.ndarray, region: np.ndarray | None, expectation: Expectation, patch: ExpectedPatch, why_blind: str | None
) -> tuple[list[GateResult], PatchesSeen | None]:
    """The same of a variant that should show the object's wrap."""
    wrap, pieces = expectation.wrap, _look_for_wrap(image, expectation)
    assert wrap is not None
    # the wrap is on: only single pieces may be missing
    hidden = HIDDEN.skip("of a wrap each piece is looked for, see 'wrong variant'")
    if pieces is not None and pieces.is_on:
        return [check_pieces(pieces, wrap, expectation.variant), hidden], None
    # a patch in its place is a wrong variant
    seen = look_for_patches(search_region(image, region), patch, expectation.view)
    # where pieces are too small to be told, they may look like a patch
    if seen.other is not None and (pieces is None or pieces.is_judged):
        return [check_variant(seen, patch, expectation.variant), hidden], seen
    unsure = why_blind or _why_no_wrap(expectation, pieces)
    if pieces is None or unsure is not None:
        return [VARIANT.skip(unsure or expectation.no_pose), hidden], seen
    return [check_pieces(pieces, wrap, expectation.variant), hidden], seen


def _look_for_wrap(image: np.ndarray, expectation: Expectation) -> PiecesSeen | None:
    """Look for the object's wrap; None if it has none, or no pose gives the places of its pieces."""
    if expectation.wrap is None or expectation.view is None or expectation.solid is None:
        return None
    return look_for_pieces(image, expectation.wrap, expectation.solid, expectation.view)


def _why_no_wrap(expectation: Expectation, pieces: PiecesSeen | None) -> str | None:
    """Why the wrap may be there although it is not found; None if it is not there, or the object has none."""
    if expectation.wrap is None or (pieces is not None and pieces.is_judged):
        return None
    if pieces is None:
        return f"the places of its wrap's pieces are not known: {expectation.no_pose}"
    return "the pieces of its wrap are turned away, hidden, or too small to tell"


def _why_unsure(expectation: Expectation, expected: Sequence[np.ndarray | None]) -> str | None:
    """Why a patch may be there although it is not found: the place of the object's own does not show."""
    patch, view = expectation.patch, expectation.view
    if patch is None or patch.home is None:
        return None  # there is none that could have been left on
    if view is None:
        return f"no patch is found, but its place is not known: {expectation.no_pose}"
    places = zip(patch.sheets, expected, strict=True)
    if any(cells is not None and cells.mean() >= LEAST_SEEN and is_clear(sheet, view) for sheet, cells in places):
        return None
    return "no patch is found, but its place is turned away, hidden, or too slanted to tell"


Built = tuple[Solid | None, ExpectedPatch | None, str, ExpectedWrap | None]
"""Shape of an object in a variant, its patch, why that is not known, and its wrap."""


class ExpectationBuilder:
    """Makes expectations; objects are built once for each variant and kept."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace, self.known = workspace, KnownObjects(workspace)
        self._kept: dict[tuple[str, str], Built] = {}

    @cached_property
    def board(self) -> Board:
        """The workspace's board; a broken file raises `ToolkitError`."""
        return read_board(self._workspace)

    def expect(
        self, object_name: str, variant: str, pose_id: int | None = None, view: PosedCamera | None = None,
        no_pose: str = "no board is seen",
    ) -> Expectation:  # fmt: skip
        """Return what such a photograph should show; gates of an unreadable object or patch are `not checked`."""
        key = (object_name, variant)
        if key not in self._kept:
            self._kept[key] = self._build(object_name, variant)
        solid, patch, no_patch, wrap = self._kept[key]
        return Expectation(
            object_name, variant, pose_id, view, no_pose, board=self.board, solid=solid, patch=patch, no_patch=no_patch,
            wrap=wrap, known=self.known,
        )  # fmt: skip

    def prepare(self, object_name: str, variant: str) -> None:
        """Build ahead what the first photograph needs: the object, and the local features of all patches."""
        self.expect(object_name, variant)
        for pixels in self._patches.values():
            describe_patch(pixels)

    def expect_record(self, record: CaptureRecord) -> Expectation:
        """Return what the photograph of a manifest's line should show."""
        why = record.made.get("no_pose", "no board is seen")
        return self.expect(record.object, record.variant, record.pose_id, view_of_record(record), why)

    @cached_property
    def _patches(self) -> dict[str, np.ndarray]:
        """Pixels of the workspace's readable patches by name."""
        found = {}
        for name, file in self._workspace.patches().items():
            with suppress(ToolkitError):  # the command that prints or shoots it names the fault
                found[name] = read_patch(file).pixels
        return found

    def _build(self, object_name: str, variant: str) -> Built:
        try:
            item = load_object(self._workspace.object_spec(object_name))
        except ToolkitError:
            return None, None, f"the object '{object_name}' is not known", None
        # a variant of the user: its silhouette is judged all the same
        if variant not in VARIANTS:
            return Solid(item.mesh), None, f"what '{variant}' has on it is not known", None
        try:
            booster = find_booster(self._workspace, item, variant)
            if booster is not None and booster.sizes_mm:
                return self._dress(item, variant, booster)
        except ToolkitError as error:
            return Solid(item.mesh), None, str(error), None
        # paint and thin pieces change no shape; only the object's own patch may have been left on
        wrap = self._wrap_of(item, is_on=variant in IN_PIECES)
        return Solid(item.mesh), self._without_patch(item), "", wrap

    def _dress(self, item: TableObject, variant: str, booster: AppliedBooster) -> Built:
        if variant == "grey-patch":
            return Solid(booster.apply(item)), None, NO_MARKS, None
        # a patch alone on the board has no mesh to say where it lies
        patches = {**self._patches, booster.name: booster.pixels}
        if booster.alone:
            return Solid(booster.apply(item)), ExpectedPatch(booster.name, patches), "", None
        sheets = booster.sheets(item)
        patch = ExpectedPatch(booster.name, patches, None, _place(item, sheets))
        return Solid(attach(item.mesh, *sheets)), patch, "", self._wrap_of(item)

    def _wrap_of(self, item: TableObject, *, is_on: bool = False) -> ExpectedWrap | None:
        """The object's wrap; None if it has none, or nothing is trained on it, so that nobody printed it."""
        for find in filter(None, (KIND_OF[variant].find_pieces for variant in IN_PIECES)):
            with suppress(ToolkitError):
                pieces = find(self._workspace, item)
                if pieces is not None and pieces.is_finished:
                    return ExpectedWrap(pieces.name, is_on, cut_squares(item.mesh, pieces))
        return None

    def _without_patch(self, item: TableObject) -> ExpectedPatch:
        try:
            home = find_patch_booster(self._workspace, item, PATCH.variant)
            sheets = home.sheets(item)
        except ToolkitError:  # it has none, or none that fits: there is nothing to leave on
            return ExpectedPatch(None, self._patches)
        return ExpectedPatch(None, {**self._patches, home.name: home.pixels}, home.name, _place(item, sheets))


def _place(item: TableObject, sheets: Sequence[MountedSheet]) -> tuple[PlacedSheet, ...]:
    return tuple(place_cells(sheet, mount.at) for sheet, mount in zip(sheets, item.spec.mounts, strict=True))


def view_of_record(record: CaptureRecord) -> PosedCamera | None:
    """The camera of a manifest's line, if it has a camera."""
    if record.T_world_camera is None or (camera := record.camera) is None:
        return None
    return PosedCamera(np.array(record.T_world_camera, float), camera)
