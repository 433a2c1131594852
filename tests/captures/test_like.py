"""Photographs shot again: the same camera, whatever its lens and frame; what cannot be is said."""

import json
import shutil
from dataclasses import replace

import board_photos
import cv2
import numpy as np
import pytest
from board_photos import QUICK
from PIL import Image
from typer.testing import CliRunner

from toolkit.captures.like import NOT_MEASURED, read_measured, scale_camera, shoot_like
from toolkit.captures.manifest import MANIFEST, CaptureRecord, append_record, read_manifest
from toolkit.captures.shoot import ShootSettings
from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.workspace import Workspace
from toolkit.objects.load import load_object
from toolkit.rig.camera import Camera, orbit_pose, pixel_rays, project
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.scene import Table
from toolkit.rig.studio import make_studio

SETTINGS = ShootSettings(backdrop="white")
LANDSCAPE = Camera(420, 300, fx=520.0, fy=531.0, cx=188.3, cy=164.6)
PORTRAIT = Camera(300, 401, fx=480.0, fy=480.0, cx=157.25, cy=189.5)
TARGET = np.array([4.0, -3.0, 18.0])
VIEWS = {
    "pose_01": (1, LANDSCAPE, orbit_pose(TARGET, 25, 35, 300, 4)),
    "pose_02": (2, PORTRAIT, orbit_pose(TARGET, 140, 60, 330, -12)),
    "pose_02_b": (2, LANDSCAPE, orbit_pose(TARGET, 150, 55, 320, 0)),
}
MAX_PX = 210


def record(path, pose_id, lens, T_world_camera, **more):
    return CaptureRecord(
        path=path, object="crate", variant=path.split("/")[1], pose_id=pose_id,
        T_world_camera=None if T_world_camera is None else T_world_camera.tolist(), intrinsics=lens.intrinsics, **more
    )  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def quick():
    """Light baked coarsely: these tests ask where things are, not how they are lit."""
    patch = pytest.MonkeyPatch()
    patch.setattr("toolkit.captures.shoot.make_renderer", lambda _, mesh, studio: RaycastRenderer(mesh, studio, QUICK))
    yield
    patch.undo()


@pytest.fixture(scope="module")
def shot(tmp_path_factory, make_crate_space):
    """(workspace, result): a red crate, three photographs of it with known cameras, and all shot again."""
    space = make_crate_space(tmp_path_factory.mktemp("like"))
    mesh = space.objects_dir / "crate.obj"
    lines = mesh.read_text().splitlines()
    mesh.write_text("\n".join(f"{line} 0.8 0.1 0.1" if line.startswith("v ") else line for line in lines) + "\n")
    crate = load_object(space.object_spec("crate")).mesh
    real = space.captures_dir / "real"
    for name, (pose_id, lens, T_world_camera) in VIEWS.items():
        path = f"crate/unpatched/{name}.jpg"
        pixels = board_photos.photograph(crate, None, lens, T_world_camera, backdrop="white")
        board_photos.save_photo(real / path, pixels)
        append_record(real, record(path, pose_id, lens, T_world_camera, image_sha256=sha256_file(real / path)))
    return space, shoot_like(space, real, SETTINGS, max_px=MAX_PX)


def outline(picture) -> np.ndarray:
    """Where a picture is red, as the crate is and the table is not."""
    pixels = np.asarray(picture.convert("RGB"), float)
    return pixels[..., 0] - pixels[..., 1:].max(axis=-1) > 0.35 * pixels[..., 0]


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return (one & other).sum() / (one | other).sum()


@pytest.mark.slow
@pytest.mark.parametrize("name", VIEWS)
def test_the_silhouette_is_the_photographs(shot, name):
    space, _ = shot
    photo = Image.open(space.captures_dir / f"real/crate/unpatched/{name}.jpg")
    again = Image.open(space.captures_dir / f"sim-like-real/crate/unpatched/{name}.jpg")
    assert max(again.size) == MAX_PX
    small = photo.resize(again.size, Image.Resampling.BOX)
    assert outline(again).mean() > 0.05
    assert overlap(outline(again), outline(small)) > 0.97
    moved = np.roll(outline(small), 1, axis=1)
    assert overlap(outline(again), moved) < 0.97  # one pixel beside it would be seen


@pytest.mark.parametrize("name", VIEWS)
def test_the_silhouette_is_the_hull_of_opencvs_projection(shot, name):
    """The crate is convex, so that its outline is the hull of its corners, and OpenCV knows where these are."""
    space, _ = shot
    _, lens, T_world_camera = VIEWS[name]
    corners = load_object(space.object_spec("crate")).mesh.vertices.astype(float)
    again = Image.open(space.captures_dir / f"sim-like-real/crate/unpatched/{name}.jpg")
    places = opencv(lens, T_world_camera, corners) * (np.array(again.size) / [lens.width, lens.height])
    hull = cv2.convexHull(((places - 0.5) * 16).round().astype(np.int32))
    expected = np.zeros(again.size[::-1], np.uint8)
    cv2.fillConvexPoly(expected, hull, 1, shift=4)
    assert overlap(outline(again), expected > 0) > 0.97


def opencv(lens, T_world_camera, points):
    """(n, 2) pixels of the full-size photograph, pixel centres at half integers as the matrix has them."""
    T_camera_world = np.linalg.inv(T_world_camera)
    rotation, _ = cv2.Rodrigues(T_camera_world[:3, :3])
    return cv2.projectPoints(points, rotation, T_camera_world[:3, 3], lens.matrix, None)[0].reshape(-1, 2)


@pytest.mark.parametrize("max_px", [64, 187, 1280])
@pytest.mark.parametrize("lens", [LANDSCAPE, PORTRAIT])
def test_known_points_project_within_a_tenth_of_a_pixel(lens, max_px):
    T_world_camera = VIEWS["pose_01"][2]
    points = np.random.default_rng(3).uniform(-50, 50, (40, 3))
    camera = scale_camera(lens, max_px)
    size = np.array([camera.width, camera.height])
    assert size.max() == min(max_px, max(lens.width, lens.height))
    expected = opencv(lens, T_world_camera, points) * (size / [lens.width, lens.height])
    pixels, depth = project(camera, T_world_camera, points)
    assert np.abs(pixels - expected).max() < 1e-6
    rays = pixel_rays(camera, T_world_camera, pixels)
    reach = np.linalg.norm(points - T_world_camera[:3, 3], axis=1)
    np.testing.assert_allclose(rays[:, :3] + reach[:, None] * rays[:, 3:], points, atol=2e-3)
    assert (depth > 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("lens", [LANDSCAPE, PORTRAIT])
def test_the_table_is_seen_where_the_lens_puts_it(lens, make_box):
    """The middle of a small disc painted on the table, in the picture: the backdrop has formulas of its own."""
    table = np.zeros((1200, 1600, 3), np.uint8)
    place = np.array([[36.0, -22.0, 0.0]])
    cv2.circle(table, ((800 + 36 * 4) * 16 - 8, (600 + 22 * 4) * 16 - 8), 3 * 4 * 16, (255, 255, 255), -1, shift=4)
    studio = replace(make_studio(0, 100.0, "white"), table=Table(table, (400.0, 300.0), 1.0))
    renderer = RaycastRenderer(make_box((4, 4, 4)), studio, QUICK)
    T_world_camera = VIEWS["pose_01"][2]
    camera = scale_camera(lens, 1280)
    light = renderer.render(camera, T_world_camera).mean(axis=-1)
    expected = opencv(lens, T_world_camera, place)[0]
    left, top = np.floor(expected).astype(int) - 14
    window = light[top : top + 28, left : left + 28]
    weight = np.maximum(window - 0.5 * window.max(), 0)
    rows, columns = np.mgrid[:28, :28] + 0.5
    found = [left + (weight * columns).sum() / weight.sum(), top + (weight * rows).sum() / weight.sum()]
    np.testing.assert_allclose(found, expected, atol=0.1)


def test_every_photograph_has_its_own_image_and_pose_id(shot):
    space, result = shot
    records = read_manifest(space.captures_dir / "sim-like-real")
    assert sorted(records) == [f"crate/unpatched/{name}.jpg" for name in VIEWS]
    assert (result.shoot.shot, result.shoot.kept, result.shoot.stale, result.skipped) == (3, 0, [], ())
    for name, (pose_id, lens, T_world_camera) in VIEWS.items():
        again = records[f"crate/unpatched/{name}.jpg"]
        assert (again.pose_id, again.made["like"]) == (pose_id, f"real/crate/unpatched/{name}.jpg")
        assert again.made["like_sha256"] == sha256_file(space.captures_dir / again.made["like"])
        np.testing.assert_allclose(again.T_world_camera, T_world_camera, atol=1e-5)
        share = again.intrinsics["width"] / lens.width
        assert again.intrinsics["fx"] == pytest.approx(lens.fx * share)
        assert again.intrinsics["cx"] == pytest.approx(lens.cx * share)
        assert again.intrinsics["fy"] == pytest.approx(lens.fy * again.intrinsics["height"] / lens.height)


@pytest.fixture
def space(shot, tmp_path):
    """A copy of that workspace, to be changed."""
    shutil.copytree(shot[0].root, tmp_path / "space")
    return Workspace(tmp_path / "space")


def again(space, **more):
    return shoot_like(space, space.captures_dir / "real", SETTINGS, max_px=MAX_PX, **more)


def test_only_a_photograph_with_a_new_pose_is_shot_again(space):
    assert (again(space).shoot.shot, again(space).shoot.kept) == (0, 3)
    _, lens, T_world_camera = VIEWS["pose_01"]
    moved = T_world_camera.copy()
    moved[:3, 3] *= 1.01
    append_record(space.captures_dir / "real", record("crate/unpatched/pose_01.jpg", 1, lens, moved))
    result = again(space)
    assert (result.shoot.shot, result.shoot.kept) == (1, 2)
    latest = read_manifest(space.captures_dir / "sim-like-real")["crate/unpatched/pose_01.jpg"]
    np.testing.assert_allclose(latest.T_world_camera, moved, atol=1e-5)


def test_what_cannot_be_shot_again_is_said(space):
    real, (_, lens, pose) = space.captures_dir / "real", VIEWS["pose_01"]
    bad, below = np.diag([2.0, 1, 1, 1]), pose.copy()
    below[2, 3] = -5
    odd = {
        "patched/pose_04.jpg": (record("crate/patched/pose_04.jpg", 4, lens, pose, booster_sha256="0" * 64), "another"),
        "sticker/pose_05.jpg": (record("crate/sticker/pose_05.jpg", 5, lens, pose), "no variant called 'sticker'"),
        "unpatched/pose_06.jpg": (record("crate/unpatched/pose_06.jpg", 6, lens, None), NOT_MEASURED),
        "unpatched/pose_07.jpg": (record("crate/unpatched/pose_07.jpg", 7, lens, bad), "T_world_camera is no pose"),
        "unpatched/pose_08.jpg": (record("crate/unpatched/pose_08.jpg", 8, lens, below), "below the table"),
        "unpatched/pose_09.jpg": (None, "manifest.jsonl does not list it"),
    }
    for level, (path, (line, _)) in enumerate(odd.items()):
        file = real / "crate" / path
        file.parent.mkdir(exist_ok=True)
        Image.new("RGB", (8, 8), (9 * level,) * 3).save(file)  # equal ones would count once
        if line is not None:
            append_record(real, line)
    result = again(space)
    assert (result.shoot.shot, result.shoot.kept) == (0, 3)
    assert sorted(path for path, _ in result.skipped) == sorted(f"crate/{path}" for path in odd)
    for path, reason in result.skipped:
        assert odd[path.removeprefix("crate/")][1] in reason and "\n" not in reason
    with pytest.raises(ToolkitError, match=r"none of the 1 photographs .*another patch"):
        again(space, variants=["patched"])


def test_two_photographs_that_differ_in_their_format_both_get_an_image(space):
    real, (_, lens, pose) = space.captures_dir / "real", VIEWS["pose_01"]
    Image.new("RGB", (8, 8)).save(real / "crate/unpatched/pose_01.png")
    append_record(real, record("crate/unpatched/pose_01.png", 1, lens, pose))
    assert again(space).shoot.shot == 1
    assert sorted(f.name for f in (space.captures_dir / "sim-like-real/crate/unpatched").glob("*.jpg")) == [
        "pose_01.jpg", "pose_01.png.jpg", "pose_02.jpg", "pose_02_b.jpg",
    ]  # fmt: skip


def test_bad_calls_are_refused_before_anything_is_written(space):
    real = space.captures_dir / "real"
    before = sha256_file(real / MANIFEST)
    for call, words in (
        ({"source": "real"}, "would overwrite the photographs"),
        ({"objects": ["crat"]}, "no object in this folder called 'crat': did you mean crate"),
        ({"source": "../x"}, "expected the name of one folder"),
    ):
        with pytest.raises(ToolkitError, match=words):
            again(space, **call)
    assert sha256_file(real / MANIFEST) == before
    with pytest.raises(ToolkitError, match=r"like .*: has no manifest\.jsonl .*expected a source"):
        read_measured(space.captures_dir)


def test_the_command_says_what_it_did_and_what_not(space, monkeypatch):
    real = space.captures_dir / "real"
    base = ["capture-sim", "--workspace", str(space.root), "--backdrop", "white", "--max-px", str(MAX_PX), "--like"]
    done = CliRunner().invoke(app, [*base, "captures/real", "--json"])
    assert done.exit_code == 0
    assert json.loads(done.stdout) == {
        "folder": str(space.captures_dir / "sim-like-real"), "shot": 0, "kept": 3, "skipped": 0,
    }  # fmt: skip
    Image.new("RGB", (8, 8)).save(real / "crate/unpatched/pose_09.jpg")
    done = CliRunner().invoke(app, [*base, str(real)])
    assert done.exit_code == 1
    assert "3 kept from before, 1 photograph left out" in done.stdout.replace("\n", " ")
    assert "skipped crate/unpatched/pose_09.jpg: manifest.jsonl does not list it" in done.stderr
    refused = CliRunner().invoke(app, ["capture-sim", "--workspace", str(space.root), "--max-px", "99"])
    assert isinstance(refused.exception, ToolkitError) and "--max-px 99: goes with --like" in str(refused.exception)
