"""Previews: all files are made once, go on after an interruption, and show what they say they show."""

import errno
import io
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image
from slow_cases import mark_slow
from walled_field import make_field

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.objects.export_mesh import to_glb
from toolkit.rooms.worlds import preview
from toolkit.rooms.worlds.picture import count_frames, write_film
from toolkit.rooms.worlds.place import place_object
from toolkit.rooms.worlds.preview import KINDS, MapSheet, PreviewSettings, preview_world, spread_labels
from toolkit.rooms.worlds.sky import make_sky

SKIES = [make_sky("afternoon", 0, 32), make_sky("dusk", 0, 32)]
SETTINGS = PreviewSettings((64, 64), (64, 64), 200, 0.4)
VIEWS = ("street", "roof", "air")
PICTURES = {f"{look}-{view}.jpg" for look in ("afternoon", "afternoon-fog-1", "dusk") for view in VIEWS}


@pytest.fixture(scope="module", autouse=True)
def chosen_once():
    """What takes most of the time of so little, and is tested beside: viewpoints and flights in a world."""
    chosen: dict[tuple[object, ...], object] = {}

    def keep(name, choose):
        def get(world, *given):
            key = name, world.sha256, repr(given)
            if key not in chosen:
                chosen[key] = choose(world, *given)
            return chosen[key]

        return get

    with pytest.MonkeyPatch.context() as patch:
        for name in ("choose_viewpoints", "plan_flight"):
            patch.setattr(preview, name, keep(name, getattr(preview, name)))
        yield


@pytest.fixture(scope="module")
def field():
    return make_field()


@pytest.fixture(scope="module")
def first(field, tmp_path_factory):
    return preview_world(field, SKIES, tmp_path_factory.mktemp("field"), SETTINGS)


@pytest.fixture
def folder(first, tmp_path) -> Path:
    """A copy of the whole preview."""
    for file in first.folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    return tmp_path


def read_all(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}


def test_every_file_is_there_and_nothing_else(first) -> None:
    assert set(first.made) == PICTURES | {"map.png", "flythrough.mp4"}
    assert {file.name for file in first.folder.iterdir()} == set(first.made) | {"preview.json"}
    record = json.loads((first.folder / "preview.json").read_text())
    assert set(record["T_world_camera"]) == set(VIEWS) and record["world"] == "field"


def test_what_is_there_is_not_made_again(field, folder, monkeypatch) -> None:
    before = read_all(folder)
    monkeypatch.setattr(preview, "make_renderer", lambda placed: pytest.fail("nothing is missing"))
    again = preview_world(field, SKIES, folder, SETTINGS)
    assert not again.made and set(again.kept) == PICTURES | {"map.png", "flythrough.mp4"}
    assert read_all(folder) == before


def test_what_is_lost_or_damaged_is_made_again_with_the_same_bytes(field, folder) -> None:
    before = read_all(folder)
    (folder / "dusk-roof.jpg").unlink()
    (folder / "map.png").write_bytes(b"half")
    again = preview_world(field, SKIES, folder, SETTINGS)
    assert set(again.made) == {"dusk-roof.jpg", "map.png"}
    assert read_all(folder) == before


@pytest.mark.parametrize(
    "content",
    mark_slow([b"{", b'{"files": 3}', b"\xff\xfe"], b"{", b'{"files": 3}'),
)
def test_a_damaged_record_costs_time_alone(field, folder, content) -> None:
    (folder / "preview.json").write_bytes(content)
    short = replace(SETTINGS, film_s=0)
    again = preview_world(field, SKIES[1:], folder, replace(short, weathers=()))
    assert set(again.made) == {f"dusk-{view}.jpg" for view in VIEWS} | {"map.png"}


@pytest.mark.slow
def test_the_work_ahead_is_all_of_it_and_a_frame_is_less_than_a_picture(field, folder, monkeypatch) -> None:
    """Or the time left, which the bar foresees by what was done, is wrong by as much."""
    counts: list[tuple[int, list[int]]] = []

    @contextmanager
    def count(title: str, total: int) -> Iterator[SimpleNamespace]:
        done: list[int] = []
        counts.append((total, done))
        yield SimpleNamespace(advance=lambda amount=1, note=None: done.append(amount))

    monkeypatch.setattr(preview, "progress", count)
    for lost in ("flythrough.mp4", "dusk-roof.jpg"):
        (folder / lost).unlink()
        preview_world(field, SKIES, folder, SETTINGS)
    (film, frames), (picture, _) = counts
    assert [sum(done) for _, done in counts] == [film, picture]
    assert len(frames) == 1 + 2 * SETTINGS.frames + 2 and max(frames[1:]) == 1  # its light, then each frame twice
    assert picture - preview.LIGHT > 2


def test_another_seed_makes_all_anew(field, first, folder) -> None:
    settings = replace(SETTINGS, seed=1, film_s=0)
    again = preview_world(field, SKIES[:1], folder, settings)
    assert not again.kept
    assert (folder / "afternoon-street.jpg").read_bytes() != (first.folder / "afternoon-street.jpg").read_bytes()


@pytest.mark.slow
def test_an_interrupted_film_goes_on(field, first, folder, monkeypatch) -> None:
    (folder / "flythrough.mp4").unlink()
    written = preview.write_bytes

    def stop_after_four(file: Path, content: bytes) -> Path:
        if file.name.endswith("00004.jpg"):
            raise KeyboardInterrupt
        return written(file, content)

    monkeypatch.setattr(preview, "write_bytes", stop_after_four)
    with pytest.raises(KeyboardInterrupt):
        preview_world(field, SKIES, folder, SETTINGS)
    assert len(list((folder / preview.FRAMES).iterdir())) == 4 and not (folder / "flythrough.mp4").exists()
    made = []
    monkeypatch.setattr(preview, "write_bytes", lambda file, content: made.append(file) or written(file, content))
    preview_world(field, SKIES, folder, SETTINGS)
    assert len(made) == 6  # of the ten frames
    assert set(read_all(folder)) == set(read_all(first.folder)) and not (folder / preview.FRAMES).exists()


def test_a_full_disk_is_a_line_and_leaves_no_partial_file(field, folder, monkeypatch) -> None:
    (folder / "map.png").unlink()

    def fail(number: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("toolkit.core.files.os.fsync", fail)
    with pytest.raises(ToolkitError, match=r"map\.png: the disk is full"):
        preview_world(field, SKIES, folder, SETTINGS)
    assert not list(folder.glob(".*"))


def test_a_film_that_was_not_written_whole_is_a_line(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("toolkit.rooms.worlds.picture.count_frames", lambda path: 1)
    frames = [np.zeros((64, 64, 3), np.uint8)] * 3
    with pytest.raises(ToolkitError, match="of 3 frames 1 can be read back: is the disk full"):
        write_film(tmp_path / "x.mp4", frames, (64, 64), 3)
    assert not list(tmp_path.iterdir())


def test_the_film_is_read_back_by_another_reader(tmp_path) -> None:
    ramp = np.tile(np.linspace(0, 255, 64, dtype=np.uint8)[None, :, None], (64, 1, 3))
    frames = [np.roll(ramp, 4 * k, axis=1) // (1, 2, 4) for k in range(12)]
    frames = [frame.astype(np.uint8) for frame in frames]
    file = write_film(tmp_path / "ramp.mp4", frames, (64, 64), 12)
    assert count_frames(file) == 12
    reader = cv2.VideoCapture(str(file))
    assert reader.get(cv2.CAP_PROP_FPS) == 25
    for frame in frames:
        error = np.abs(reader.read()[1][..., ::-1].astype(int) - frame)
        assert error.mean() < 12  # colours of half resolution, lossy; swapped ones would be 60 off
    assert b"vp09" in file.read_bytes() or b"mp4v" in file.read_bytes()


def test_fog_takes_contrast_and_dusk_light(first) -> None:
    def read(name: str) -> np.ndarray:
        return np.asarray(Image.open(first.folder / name).convert("L"), float)

    for view in VIEWS:
        assert read(f"afternoon-fog-1-{view}.jpg").std() < 0.8 * read(f"afternoon-{view}.jpg").std()
    assert read("dusk-air.jpg").mean() < 0.7 * read("afternoon-air.jpg").mean()


def test_the_map_has_its_places_where_they_are(field, first) -> None:
    drawn, sheet = np.asarray(Image.open(first.folder / "map.png")), MapSheet.over(field, 200)
    for spot in field.spots[:2]:  # the third is hidden by its name
        north = np.array([spot.position]) + [[0, spot.free_radius_m, 0]]
        (x, y), (x0, y0) = sheet.place(north)[0], sheet.place(np.array([spot.position]))[0]
        assert x == pytest.approx(x0, abs=0.5) and y < y0, "north is up"
        near = drawn[round(y) - 4 : round(y) + 5, round(x) - 2 : round(x) + 3].reshape(-1, 3)
        assert (near == KINDS["ground"]).all(axis=1).any()


@pytest.mark.parametrize(
    "wrong", [{"resolution": (10, 10)}, {"film_size": (65, 64)}, {"film_s": -1.0}, {"film_s": float("nan")}]
)
def test_settings_out_of_range_are_named(wrong) -> None:
    with pytest.raises(FieldError, match=f"^{next(iter(wrong))} "):
        PreviewSettings(**wrong)


def test_an_object_is_in_all_pictures_and_has_two_of_its_own(field, make_box, tmp_path) -> None:
    box = replace(make_box((100, 60, 40)), vertices=make_box((100, 60, 40)).vertices * np.float32(0.04))
    placed = place_object(box, field, field.spots[0], SKIES[0])
    result = preview_world(field, SKIES[:1], tmp_path, replace(SETTINGS, film_s=0, weathers=()), placed)
    assert {"afternoon-object.jpg", "afternoon-object-far.jpg", "afternoon-street.jpg"} <= set(result.made)
    record = json.loads((tmp_path / "preview.json").read_text())
    pose = np.array(record["T_world_camera"]["object"])
    assert pose[:3, 2] @ (placed.centre - pose[:3, 3]) == pytest.approx(1.4 * 4.0, abs=1e-3)  # looks at its middle


def test_a_world_as_glb_is_the_same_in_metres_with_y_up(field, make_box) -> None:
    content = to_glb(field.mesh, "field", units_per_m=1.0)
    scene = trimesh.load_scene(io.BytesIO(content), file_type="glb")
    assert scene.bounds == pytest.approx(np.array([(-40, 0, -40), (40, 5, 40)]), abs=1e-4)  # left, up, front
    assert sum(len(one.faces) for one in scene.geometry.values()) == len(field.mesh.faces)
    looks = [np.asarray(one.visual.material.baseColorTexture.convert("RGB")) for one in scene.geometry.values()]
    assert {look.tobytes() for look in looks} == {one.texture.tobytes() for one in field.mesh.materials}


def test_lamps_are_in_a_glb_only_where_asked_for(field) -> None:
    glow = np.full((8, 8, 3), (255, 120, 0), np.uint8)
    first, second = field.mesh.materials
    lit = replace(field.mesh, materials=(first, replace(second, emission=glow)))
    plain = to_glb(field.mesh, "field", 1.0)
    assert to_glb(lit, "field", 1.0) == plain
    scene = trimesh.load_scene(io.BytesIO(to_glb(lit, "field", 1.0, lamps=True)), file_type="glb")
    emissive = [one.visual.material for one in scene.geometry.values() if one.visual.material.emissiveTexture]
    assert len(emissive) == 1 and emissive[0].emissiveFactor == pytest.approx([1, 1, 1])
    assert np.array_equal(np.asarray(emissive[0].emissiveTexture.convert("RGB")), glow)
    assert np.array_equal(np.asarray(emissive[0].baseColorTexture.convert("RGB")), second.texture)


def test_labels_of_a_map_do_not_overlap_and_stay_in_it() -> None:
    wanted = [(100.0, 100.0)] * 6 + [(2.0, 2.0), (398.0, 200.0)]
    sizes = [(90.0, 21.0), (40.0, 21.0)] * 4
    boxes = [
        (x - w / 2, y - h / 2, x + w / 2, y + h / 2)
        for (x, y), (w, h) in zip(spread_labels(wanted, sizes, (400, 400)), sizes, strict=True)
    ]
    assert all(min(box) >= 0 and max(box) <= 400 for box in boxes)
    for k, one in enumerate(boxes):
        for other in boxes[:k]:
            assert one[0] >= other[2] or other[0] >= one[2] or one[1] >= other[3] or other[1] >= one[3]
    assert spread_labels([(50, 60), (300, 60)], sizes[:2], (400, 400)) == [(50, 60), (300, 60)]
