"""The parts of the report: pose charts, contact sheets, thumbnails, console tables."""

import base64
import io
from math import cos, radians, sin
from pathlib import Path

import numpy as np
import pypdf
import pytest
from PIL import Image
from rich.console import Console

from toolkit.captures.capture import Capture
from toolkit.evaluation.contact_sheet import (
    MAX_BYTES,
    chart_poses,
    lay_out,
    lay_out_flips,
    make_thumbnails,
    read_direction,
)
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.metrics import (
    MAX_FLIPS,
    compare_unpatched,
    group_predictions,
    index_poses,
    list_flips,
    pair_with_unpatched,
)
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.tables import build_tables
from toolkit.rig.camera import orbit_pose


def look_at(azimuth_deg, elevation_deg, target=(0.0, 0.0, 40.0), distance=700.0, roll_deg=0.0):
    """`T_world_camera` of a camera on a sphere, built from the definition: x right, y down, z forward."""
    azimuth, elevation = radians(azimuth_deg), radians(elevation_deg)
    outward = np.array([cos(azimuth) * cos(elevation), sin(azimuth) * cos(elevation), sin(elevation)])
    forward = -outward
    right = np.array([-sin(azimuth), cos(azimuth), 0.0])
    down = np.cross(forward, right)
    c, s = cos(radians(roll_deg)), sin(radians(roll_deg))
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = np.stack([c * right + s * down, c * down - s * right, forward], axis=1)
    T_world_camera[:3, 3] = np.array(target) + distance * outward
    return tuple(map(tuple, T_world_camera.tolist()))


def one(pose_id, variant="patched", right=True, T_world_camera=None, name="racer", source="sim"):
    path = f"{source}/{name}/{variant}/{pose_id}.png"
    capture = Capture(source, name, variant, pose_id, Path(path), path, None, T_world_camera)
    return Prediction(capture, 0, name, 0 if right else 1, "guess", 0.6, 0.6 if right else 0.1, 1 if right else 4)


@pytest.mark.parametrize("azimuth", [0, 45, 90, 200, 359])
@pytest.mark.parametrize("elevation", [-20, 0, 15, 65, 89])
def test_direction_is_that_of_the_plan(azimuth, elevation):
    T_world_camera = look_at(azimuth, elevation, target=(10, -5, 33), roll_deg=12)
    found = read_direction(one(1, T_world_camera=T_world_camera).capture)
    assert found == pytest.approx((azimuth, elevation), abs=1e-6)


def test_direction_is_that_of_the_rigs_camera():
    T_world_camera = np.asarray(orbit_pose(np.array([0.0, 0.0, 20.0]), 30.0, 25.0, 500.0, roll_deg=5.0))
    found = read_direction(one(1, T_world_camera=tuple(map(tuple, T_world_camera.tolist()))).capture)
    assert found == pytest.approx((30, 25), abs=1e-6)


def test_chart_places_front_below_and_left_to_the_right():
    seen = [one(1, T_world_camera=look_at(0, 0)), one(2, T_world_camera=look_at(90, 45)), one(3)]
    (chart,) = chart_poses(seen)
    front, left = chart.dots
    assert (front.x, front.y) == pytest.approx((0, 100), abs=1e-6)
    assert (left.x, left.y) == pytest.approx((50, 0), abs=1e-6)
    assert chart.rings[0] == (pytest.approx(100), "0°")


def test_chart_counts_objects_per_pose():
    seen = [one(1, name=name, right=right, T_world_camera=look_at(60, 30)) for name, right in
            (("a", True), ("b", True), ("c", True), ("d", False))]  # fmt: skip
    (chart,) = chart_poses(seen)
    (dot,) = chart.dots
    assert (dot.n, dot.n_right) == (4, 3)
    assert " 0 1 1 " in dot.wedge  # three quarters: the large arc
    assert chart_poses([one(1)]) == []


def test_cameras_below_the_table_widen_the_chart():
    (chart,) = chart_poses([one(1, T_world_camera=look_at(0, -20)), one(2, T_world_camera=look_at(0, 30))])
    assert [label for _, label in chart.rings] == ["-30°", "0°", "30°", "60°"]
    assert all(abs(dot.y) <= 100 for dot in chart.dots)


def test_contact_sheet_pairs_poses():
    seen = [one(2), one(1), one(1, "unpatched"), one(None)]
    (sheet,), hidden = lay_out(seen)
    assert [card.title for card in sheet.cards] == ["pose 1", "pose 2", "None.png"]
    assert [cell.capture.variant for cell in sheet.cards[0].cells] == ["unpatched", "patched"]
    assert hidden == 0


def test_long_contact_sheets_are_thinned_evenly():
    seen = [
        one(pose, variant, name=name) for pose in range(100) for variant in ("patched", "unpatched") for name in "ab"
    ]
    sheets, hidden = lay_out(seen, max_pictures=40)
    assert hidden == 0
    assert [(len(sheet.cards), sheet.n_cards) for sheet in sheets] == [(10, 100), (10, 100)]
    assert [card.title for card in sheets[0].cards][:3] == ["pose 0", "pose 10", "pose 20"]
    many = [one(1, name=f"o{index:03d}") for index in range(300)]
    sheets, hidden = lay_out(many, max_pictures=50)
    (sheet,) = sheets
    assert (len(sheet.cards), sheet.n_cards, hidden) == (50, 50, 250)
    assert sheet.object == "50 objects" and sheet.cards[0].title == "o000 · pose 1"


def test_flips_are_sorted_and_counted():
    seen = [one(pose, "unpatched", right=pose >= 50) for pose in range(60)] + [
        one(pose, right=pose < 50) for pose in range(60)
    ]
    gained, lost = list_flips(pair_with_unpatched(index_poses(seen)))
    assert (len(gained.shown), gained.n, len(lost.shown), lost.n) == (MAX_FLIPS, 50, 10, 10)
    assert all(len(card.cells) == 2 for card in lay_out_flips(gained))


def test_thumbnails_are_small_upright_jpegs(tmp_path, colour_classifier):
    draw = np.random.default_rng(0)
    noise = Image.fromarray(draw.integers(0, 256, (900, 1200, 3), dtype=np.uint8))
    exif = Image.Exif()
    exif[0x0112] = 6
    noise.save(tmp_path / "noise.jpg", exif=exif)
    (tmp_path / "bad.jpg").write_bytes(b"x")
    captures = [Capture("s", "o", "v", 1, tmp_path / name, name) for name in ("noise.jpg", "bad.jpg", "noise.jpg")]
    thumbnails = make_thumbnails(captures, colour_classifier)
    assert list(thumbnails) == ["noise.jpg"]
    content = base64.b64decode(thumbnails["noise.jpg"].split(",")[1])
    assert len(content) <= MAX_BYTES
    assert Image.open(io.BytesIO(content)).size == (180, 240)


def printed(seen) -> str:
    console = Console(width=80, record=True, file=io.StringIO())
    for table in build_tables(group_predictions(seen), compare_unpatched(pair_with_unpatched(index_poses(seen)))):
        console.print(table)
    return console.export_text()


def test_console_table_fits_eighty_columns():
    seen = [one(p, v, right=v == "patched", name=n) for p in range(18) for v in ("unpatched", "patched") for n in
            ("coffeepot", "racer")]  # fmt: skip
    text = printed(seen)
    assert "unpatched" in text and "all" in text and "0–18" in text and "82–100" in text
    assert "< 0.0001" in text
    assert max(map(len, text.splitlines())) <= 80
    assert "all" not in printed([one(1), one(1, "unpatched")])


def test_console_table_of_many_objects_is_the_pooled_row():
    text = printed([one(1, name=f"o{index}") for index in range(100)])
    assert "100 objects" in text and "o42" not in text and "all" in text


@pytest.mark.slow
def test_on_a_phone_all_numbers_are_on_the_screen_and_pictures_open_large(browser, put, workspace, colour_classifier):
    for pose in range(1, 5):
        put(f"sim/racer/unpatched/{pose}.png", "warplane" if pose > 2 else "racer")
        put(f"sim/racer/patched/{pose}.png", "racer")
    page = evaluate_captures(workspace.captures_dir, workspace, colour_classifier).report_file
    browser.get(page.as_uri())
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
    cells = browser.execute_script(
        "return [...document.querySelectorAll('td[data-label]')].map(one => "
        "[getComputedStyle(one, '::before').content, one.getBoundingClientRect().right])"
    )
    named = {words.strip('"') for words, _ in cells}
    assert {"gained", "lost", "p", "95 % interval"} <= named and max(right for _, right in cells) <= 390
    captions = browser.execute_script(
        "return [...document.querySelectorAll('table')].map(one => one.caption?.textContent)"
    )
    assert captions and all(captions)
    assert browser.execute_script("return [...document.querySelectorAll('th')].every(one => one.scope)")
    large = browser.execute_script(
        "const box = document.querySelector('.zoom input'); box.click();"
        "return box.nextElementSibling.getBoundingClientRect().width"
    )
    assert large == 390
    browser.execute_script("document.querySelector('.zoom input').click()")
    assert browser.execute_script("return document.querySelector('.zoom img').getBoundingClientRect().width") < 200


@pytest.mark.slow
def test_on_paper_folded_parts_are_open(browser, put, workspace, colour_classifier):
    for pose in range(1, 7):
        put(f"sim/racer/unpatched/{pose}.png", "warplane")
        put(f"sim/racer/patched/{pose}.png", "racer")
    page = evaluate_captures(workspace.captures_dir, workspace, colour_classifier).report_file
    browser.get(page.as_uri())
    sheets = pypdf.PdfReader(io.BytesIO(base64.b64decode(browser.print_page()))).pages
    text = " ".join(" ".join(sheet.extract_text() for sheet in sheets).split())
    for folded in ("Of 6 pairs, 6 became correct", "Gained: 6 pairs", "Wilson score interval"):
        assert folded in text, folded
