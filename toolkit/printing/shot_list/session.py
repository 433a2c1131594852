"""All that the pages of one object show, worked out before anything is drawn."""

from dataclasses import dataclass

from toolkit.captures.shot_order import ShotStep
from toolkit.captures.variants import Paint, Print
from toolkit.console import Ticker
from toolkit.objects.load import TableObject
from toolkit.printing.shot_list.mounting import MountDrawing, draw_mounting
from toolkit.printing.shot_list.place_drawings import Surroundings, survey
from toolkit.printing.shot_list.places import CameraPlace, Stop, find_stops
from toolkit.printing.shot_list.views import draw_views
from toolkit.rig.board import Sheet
from toolkit.rig.camera import Camera
from toolkit.rig.plan import Pose


@dataclass(frozen=True)
class ObjectSession:
    """One object's part of the list.

    Attributes:
        item, camera: the object and the plan's camera.
        stops: its places along the tour.
        booster, mounting: the sheet and where it goes; None where nothing is stuck on.
        note: why nothing is, where it should have been.
        patch_pdf: name of the sheet's printed page, where there is one.
        board: what it stands on.
        around: what its drawings share.
        views: JPEGs by (variant, pose id).
        poses_sha256: `hash_poses` of the plan.
    """

    item: TableObject
    camera: Camera
    stops: tuple[Stop, ...]
    booster: Print | None
    mounting: MountDrawing | None
    note: str | None
    patch_pdf: str | None
    board: Sheet | None
    around: Surroundings
    views: dict[tuple[str, int], bytes]
    poses_sha256: str

    @property
    def places(self) -> list[CameraPlace]:
        """Of all stops."""
        return [stop.place for stop in self.stops]


def prepare_session(
    item: TableObject, camera: Camera, poses: list[Pose], steps: list[ShotStep],
    boosters: dict[str, Print | Paint | None], poses_sha256: str, bar: Ticker, board: Sheet | None = None,
    patch_pdf: str | None = None, note: str | None = None,
) -> ObjectSession:  # fmt: skip
    """Render and measure one object's part of the list.

    Args:
        item: the object.
        camera: the plan's.
        poses: of the object.
        steps: of the object, in order.
        boosters: by variant.
        poses_sha256: `hash_poses` of the plan.
        bar: counts one per picture, and one for the mounting.
        board, patch_pdf, note: as in `ObjectSession`.

    Raises:
        ToolkitError: the sheet cannot be mounted on the object.
    """
    stops = find_stops(poses, steps)
    views = draw_views(item, camera, poses, boosters, board, bar)
    stuck = [b for b in (boosters.get("patched"), *boosters.values()) if isinstance(b, Print) and not b.alone]
    mounting = draw_mounting(item, stuck[0]) if stuck else None
    bar.advance(note=f"{item.name}: where the patch goes")
    around = survey(item.mesh, [stop.place for stop in stops])
    return ObjectSession(
        item, camera, tuple(stops), stuck[0] if stuck else None, mounting, note, patch_pdf, board, around, views,
        poses_sha256,
    )  # fmt: skip
