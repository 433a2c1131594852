"""Photographs to import, a workspace to import them into, and a board that sees what it is told."""

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from toolkit.imaging.read import register_heif
from toolkit.objects.load import load_object
from toolkit.rig import Pattern
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.plan import make_plan, read_plan, write_plan
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.importing.import_photos import import_photos
from toolkit.rooms.photos.importing.match import RenderMatcher
from toolkit.rooms.photos.posed_camera import PosedCamera

register_heif()
START = datetime(2024, 5, 1, 10)
PATCHED = ImportSettings(object="crate", variant="patched")
LENS = Camera(48, 36, fx=50.0, fy=50.0, cx=24.0, cy=18.0)
RANK = RenderMatcher.rank


@pytest.fixture
def space(tmp_path, make_crate_space, monkeypatch):
    """One light object, a plan of four poses 90° apart, none of the package's own objects.

    Nothing is rendered: the pictures are noise, which looks like no render. `RANK` put back renders.
    """
    monkeypatch.setattr(RenderMatcher, "rank", lambda *_: "nothing is rendered here")
    made = make_crate_space(tmp_path / "space")
    monkeypatch.setattr("toolkit.core.workspace.PACKAGE_DATA", tmp_path / "none")
    item = load_object(made.object_spec("crate"))
    pattern = Pattern(name="ring", count=4, elevation_deg=(40, 40))
    write_plan(made.plan_file, make_plan([item], Camera.from_fov(96, 72), pattern))
    return made


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "photos"
    made.mkdir()
    return made


def picture(seed: int, size=(48, 36)) -> Image.Image:
    return Image.fromarray(np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8))


def take(file: Path, seed: int, minute: float | None = None, offset: str = "", **options) -> Path:
    """A photograph of its own, taken `minute` minutes after the start, perhaps with an offset from UTC."""
    file.parent.mkdir(parents=True, exist_ok=True)
    exif = Image.Exif()
    exif[0x0110] = "Acme Phone 3"
    if minute is not None:
        taken = START + timedelta(minutes=minute)
        exif[0x8769] = {0x9003: taken.strftime("%Y:%m:%d %H:%M:%S"), **({0x9011: offset} if offset else {})}
    picture(seed).save(file, exif=exif.tobytes(), **options)
    return file


def camera(space, azimuth_deg: float, elevation_deg=40.0, closer=1.0) -> np.ndarray:
    pose = read_plan(space.plan_file).objects["crate"][0]
    return orbit_pose(np.array(pose.target_mm), azimuth_deg, elevation_deg, pose.distance_mm * closer)


@dataclass
class Board:
    """A board that is seen in the photographs named here, and says where their cameras stood."""

    cameras: dict[str, np.ndarray]
    seen: int = 0

    def __call__(self, photo, pixels):
        self.seen += 1
        assert pixels.shape[2] == 3
        found = self.cameras.get(photo.path.name)
        return "no board is seen" if found is None else PosedCamera(found, LENS, {"board_corners": 9})


NO_BOARD = Board({})


def run(space, paths, settings=PATCHED, board=NO_BOARD, **options):
    paths = paths if isinstance(paths, list) else [paths]
    return import_photos(space, paths, settings, locate=board, **options)


def imported(result) -> dict[str, str]:
    """Original name by path."""
    return {record.path: record.made["original_name"] for record in result.imported}


def reasons(result) -> dict[str, str]:
    return dict(result.refused)
