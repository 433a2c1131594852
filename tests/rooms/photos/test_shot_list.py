"""The shot list's pages, read back by pdfplumber, against trigonometry from the plan's own file."""

import base64
import json
import re
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pdfplumber
import pytest
from PIL import Image
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.console import Ticker
from toolkit.objects.load import load_object
from toolkit.printing.canvas import POINTS_PER_MM
from toolkit.rig import Pattern, ShotListConfig
from toolkit.rig.board import DEFAULT_BOARD
from toolkit.rig.camera import Camera
from toolkit.rig.plan import make_plan, open_plan, read_plan, write_plan
from toolkit.rooms.photos.shot_list.job import write_shot_list
from toolkit.rooms.photos.shot_list.mounting import draw_mountings, draw_views, make_light_studio
from toolkit.rooms.photos.shot_list.session import equivalent_focal_mm
from toolkit.rooms.photos.shot_list.tour import trace_outline

COUNT = 8


def plan_more(space, count=COUNT):
    item = load_object(space.object_spec("crate"))
    pattern = Pattern(name="fibonacci", count=count, elevation_deg=(20, 75))
    write_plan(space.plan_file, make_plan([item], Camera.from_fov(64, 48), pattern))
    return read_plan(space.plan_file)


@pytest.fixture(scope="module")
def space(tmp_path_factory, make_crate_space):
    made = make_crate_space(tmp_path_factory.mktemp("shots") / "space")
    plan_more(made)
    return made


@dataclass(frozen=True)
class Listed:
    """A written list: what was said of it, its PDF, and the plan's and the order's plain JSON."""

    result: object
    pages: list
    plan: dict
    shots: dict

    @property
    def text(self) -> str:
        return "\n".join(page.extract_text() for page in self.pages)


def read_back(space, result) -> Listed:
    pages = pdfplumber.open(BytesIO(Path(result.pdf_file).read_bytes())).pages
    shots = json.loads((space.root / "rig" / "shots.json").read_text())
    return Listed(result, pages, json.loads(space.plan_file.read_text()), shots)


@pytest.fixture(scope="module")
def listed(space):
    result = write_shot_list(space, open_plan(space), ["crate"], ShotListConfig(), seed=2)
    return read_back(space, result)


def cards(listed):
    """Pose id and text of every card: the strip of the page from its word 'pose' to the next card's."""
    mm = POINTS_PER_MM
    for page in listed.pages[1:]:
        tops = [word["top"] for word in page.extract_words() if word["text"] == "pose" and word["x0"] < 25 * mm]
        for top, bottom in zip(tops, [*tops[1:], page.height - 14 * mm], strict=True):
            text = page.crop((0, top - 3 * mm, page.width, bottom - 3 * mm)).extract_text()
            yield (
                int(
                    max(
                        page.within_bbox((10 * mm, top - mm, 26 * mm, top + 14 * mm)).extract_words(
                            extra_attrs=["size"]
                        ),
                        key=lambda word: word["size"],
                    )["text"]
                ),
                text,
            )


@pytest.mark.slow
def test_every_card_states_the_trigonometry_of_its_matrix(listed):
    poses = {pose["id"]: pose for pose in listed.plan["objects"]["crate"]}
    seen = []
    for pose_id, text in cards(listed):
        seen.append(pose_id)
        T = np.array(poses[pose_id]["T_world_camera"])
        x, y, z = T[:3, 3]
        away = T[:3, 3] - poses[pose_id]["target_mm"]
        lengths = sorted(round(mm / 10, 1) for mm in (z, np.hypot(x, y), np.linalg.norm(away)))
        printed = sorted(float(number) for number in re.findall(r"([\d.]+) cm", text))
        assert printed == pytest.approx(lengths, abs=0.051)
        degrees = sorted(int(number) for number in re.findall(r"(\d+)°", text))
        azimuth, tilt = np.degrees(np.arctan2(y, x)) % 360, np.degrees(np.arctan2(away[2], np.hypot(*away[:2])))
        assert degrees == pytest.approx(sorted((azimuth, tilt)), abs=0.51)
    assert sorted(seen) == list(range(1, COUNT + 1))


def test_every_shot_stands_once_on_the_card_of_its_pose(listed):
    found = [
        (int(number), pose_id)
        for pose_id, text in cards(listed)
        for number in re.findall(r"(?<!after )shot (\d+)", text)
    ]
    assert sorted(found) == [(step["number"], step["pose_id"]) for step in listed.shots["steps"]]
    assert len(found) == 2 * COUNT == listed.result.shots


def test_pictures_are_of_the_plans_shape_and_only_the_patched_ones_show_the_patch(listed):
    seen = 0
    for page in listed.pages[1:]:
        images = sorted(page.images, key=lambda image: (round(image["top"]), image["x0"]))
        for bare, patched in zip(images[::2], images[1::2], strict=True):
            assert bare["width"] / bare["height"] == pytest.approx(4 / 3, rel=0.01)
            coloured = [colour_share(image) for image in (bare, patched)]
            assert coloured[0] < 0.001 and coloured[1] > 0.01
            seen += 1
    assert seen == COUNT


def colour_share(image) -> float:
    """Share of saturated pixels: crate, board and table are grey, the patch is noise in all colours."""
    jpeg = base64.a85decode(image["stream"].rawdata.strip().removesuffix(b"~>"))
    pixels = np.asarray(Image.open(BytesIO(jpeg)).convert("RGB")).astype(int)
    return float((np.ptp(pixels, axis=-1) > 70).mean())


def test_a_box_for_each_shot(listed):
    side = 3.6 * POINTS_PER_MM
    boxes = [
        shape
        for page in listed.pages[1:]
        for shape in (*page.curves, *page.rects)
        if abs(shape["width"] - side) < 0.2 and abs(shape["height"] - side) < 0.2
    ]
    assert len(boxes) == 2 * COUNT


def test_the_first_page_measures_the_sheet_on_the_object(listed):
    """A sheet of 40 + 2 × 5 mm in the middle of a top of 100 × 60 mm: 25 mm to either end, 5 mm to either side."""
    numbers = re.findall(r"^[\d ]+$|\b\d+\b", listed.pages[0].extract_text())
    assert numbers.count("25") >= 2 and numbers.count("50") >= 2 and numbers.count("5") >= 2
    text = listed.pages[0].extract_text()
    assert "sheet 50.0 mm" in text and "patch 40.0 mm" in text and "seen from above" in text
    assert "toolkit print --board" in text and f"{2 * COUNT} shots at {COUNT} poses" in text


@pytest.mark.slow
def test_the_outline_lies_on_the_picture_where_the_patch_is(space):
    """The patch is the only colour: its pixels' extent, in the picture's millimetres, is its 40 mm about the middle."""
    from toolkit.rig.variants import find_booster

    item = load_object(space.object_spec("crate"))
    (drawing,) = draw_mountings(item, find_booster(space, item, "patched"))
    pixels = np.asarray(Image.open(BytesIO(drawing.jpeg)).convert("RGB")).astype(int)
    rows, columns = np.nonzero(np.ptp(pixels, axis=-1) > 60)
    left, _, right, top = drawing.frame_mm
    per_mm = pixels.shape[1] / (right - left)
    x = left + np.quantile(columns, [0, 1]) / per_mm
    y = top - np.quantile(rows, [1, 0]) / per_mm
    np.testing.assert_allclose([*x, *y], [-20, 20, -20, 20], atol=0.8)
    np.testing.assert_allclose(drawing.patch_mm.min(axis=0), [-20, -20], atol=0.5)
    np.testing.assert_allclose(drawing.gaps_mm, [25, 5, 25, 5], atol=0.6)
    np.testing.assert_allclose(drawing.arrow_mm, [1, 0], atol=0.01)  # towards +x, the front
    white = np.asarray(Image.open(BytesIO(drawing.jpeg)))[:4].mean()
    assert white > 250


def test_pages_name_object_plan_and_number(listed):
    sha = listed.shots["plan_sha256"]["crate"][:12]
    total = len(listed.pages)
    for number, page in enumerate(listed.pages, 1):
        text = page.extract_text()
        assert f"crate, page {number} of {total}" in text and f"plan {sha}" in text and f"{number}/{total}" in text
        assert text.startswith("crate") and "order aba, seed 2" in text
    assert (listed.result.pages, total) == (3, 3)
    assert "after shot 4: stick the patch on" in listed.text and "after shot 12: take the patch off" in listed.text


def test_nothing_is_drawn_outside_the_margins(listed):
    for page in listed.pages:
        for word in page.extract_words():
            assert word["x0"] > 9 * POINTS_PER_MM and word["x1"] < page.width - 9 * POINTS_PER_MM
            assert word["top"] > 9 * POINTS_PER_MM and word["bottom"] < page.height - 8 * POINTS_PER_MM


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_and_letter_is_letter(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path / "letter")

    def made():
        asked = ShotListConfig(paper="letter", variants=("unpatched",), order="blocks")
        result = write_shot_list(space, open_plan(space), ["crate"], asked, seed=1)
        return Path(result.pdf_file).read_bytes(), Path(result.shots_file).read_bytes()

    first = made()
    assert first == made()
    page = pdfplumber.open(BytesIO(first[0])).pages[1]
    assert (float(page.width), float(page.height)) == pytest.approx((612, 792), abs=0.01)
    assert "take the" not in page.extract_text() and "order blocks, seed 1" in page.extract_text()


def test_an_object_without_a_patch_is_shot_unpatched_and_told_so(tmp_path, make_crate_space, monkeypatch):
    monkeypatch.setattr("toolkit.core.workspace.PACKAGE_DATA", tmp_path / "none")
    bare = make_crate_space(tmp_path / "bare")
    for file in bare.patches_dir.iterdir():
        file.unlink()
    result = CliRunner().invoke(app, ["plan", "--shot-list", "--workspace", str(bare.root), "--quiet"])
    assert result.exit_code == 0, result.output
    assert "crate: unpatched only: no patch for object 'crate'" in result.stderr
    shots = json.loads((bare.root / "rig" / "shots.json").read_text())
    assert [step["variant"] for step in shots["steps"]] == ["unpatched"] * 2
    text = pdfplumber.open(bare.print_dir / "shot_list.pdf").pages[0].extract_text()
    assert "Unpatched only" in text and "toolkit train-patch" in text
    again = CliRunner().invoke(
        app, ["plan", "--shot-list", "--variant", "patched", "--workspace", str(bare.root), "--quiet"]
    )
    assert again.exit_code != 0 and "no patch for object 'crate'" in str(again.exception)


@pytest.mark.slow
def test_the_command_keeps_the_plan_unless_poses_are_asked_for(tmp_path, make_crate_space, monkeypatch):
    monkeypatch.setattr("toolkit.core.workspace.PACKAGE_DATA", tmp_path / "none")
    space = make_crate_space(tmp_path / "kept")
    before = space.plan_file.read_bytes()

    def call(*arguments):
        result = CliRunner().invoke(app, ["plan", "--shot-list", "--workspace", str(space.root), *map(str, arguments)])
        assert result.exit_code == 0, (result.output, result.exception)
        return result.stdout

    told = json.loads(call("--json"))
    assert space.plan_file.read_bytes() == before
    assert (told["shots"], told["pages"], told["replaced"]) == (4, 2, False)
    words = call("--count", 1, "--variant", "unpatched", "--quiet")
    assert len(read_plan(space.plan_file).objects["crate"]) == 1
    assert "held other shots" in words and "1 shot of crate" in words and "toolkit import" in words


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--paper", "a5"], "expected at least"),
        (["--variant", "pached"], "no variant called 'pached'"),
        (["--order", "random"], "expected aba, blocks or alternate"),
        (["--object", "crat"], "no object called 'crat'"),
    ],
)
def test_what_cannot_be_listed_is_one_line(space, arguments, words):
    result = CliRunner().invoke(app, ["plan", "--shot-list", "--workspace", str(space.root), *arguments])
    assert result.exit_code != 0 and words in str(result.exception) and "\n" not in str(result.exception)


@pytest.mark.slow
def test_the_picture_shows_the_board_where_opencv_looks_for_it(space):
    """Corners that OpenCV finds in a render from above lie where the camera projects the board's own corners."""
    from toolkit.rig.camera import orbit_pose, project
    from toolkit.rig.raycast import RaycastRenderer
    from toolkit.rig.shading import tone_map

    item = load_object(space.object_spec("crate"))
    camera, pose = Camera.from_fov(1000, 750, 40.0), orbit_pose(np.array([0, 0, 20.0]), 30, 60, 700)
    picture = RaycastRenderer(item.mesh, make_light_studio(item, DEFAULT_BOARD)).render(camera, pose)
    grey = cv2.cvtColor(tone_map(picture, (0,), noise=0), cv2.COLOR_RGB2GRAY)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(DEFAULT_BOARD.to_cv()).detectBoard(grey)
    assert ids is not None and len(ids) > 60
    wanted, _ = project(camera, pose, DEFAULT_BOARD.object_points(ids))
    off = np.linalg.norm(corners.reshape(-1, 2) + 0.5 - wanted, axis=1)
    assert np.median(off) < 0.7


def test_views_are_one_per_variant_and_pose(space):
    item = load_object(space.object_spec("crate"))
    plan = open_plan(space)
    poses = plan.objects["crate"][:2]
    views = draw_views(item, plan.camera, poses, {"unpatched": None}, None, Ticker(None, None))
    assert set(views) == {("unpatched", poses[0].id), ("unpatched", poses[1].id)}
    assert views["unpatched", 1] != views["unpatched", 2]


def test_a_box_is_outlined_as_a_rectangle(make_box):
    (outline,) = trace_outline(make_box((100.0, 60.0, 40.0)), np.array([0.0, 1, 0]), np.array([0.0, 0, 1]))
    np.testing.assert_allclose(outline.min(axis=0), [-30, 0], atol=0.5)
    np.testing.assert_allclose(outline.max(axis=0), [30, 40], atol=0.5)
    assert len(outline) <= 6


def test_the_equivalent_focal_length_is_the_textbooks():
    """A 50 mm lens on 36 × 24 mm sees 39.6° across."""
    assert equivalent_focal_mm(Camera.from_fov(3600, 2400, 39.598)) == pytest.approx(50, abs=0.02)
