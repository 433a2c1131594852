"""The patch in rendered and pasted photographs, against where the renderer or the paste put it."""

import json
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_photos import QUICK
from PIL import Image
from printed_photos import shipped_patch

from toolkit.core.workspace import PACKAGE_DATA
from toolkit.imaging.read import read_image
from toolkit.objects.load import load_object
from toolkit.rig.camera import Camera, orbit_pose, project
from toolkit.rig.mount import attach, mount_patch
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.shading import tone_map
from toolkit.rig.studio import make_studio
from toolkit.rooms.photos.gates.check_set import (
    SIZE,
    CheckedPhoto,
    PatchLines,
    find_wrong_sizes,
    measure_side,
    trace_patch,
)
from toolkit.rooms.photos.gates.patch import ExpectedPatch, look_for_patches
from toolkit.rooms.photos.posed_camera import PosedCamera
from toolkit.rooms.photos.prints.align import FLAT, UNIT_CORNERS, PatchWarp, draw_patch, fit_warp, is_plausible
from toolkit.rooms.photos.prints.find import SearchedPhoto, find_patch, rectify_patch, search_photo, shrink_image

CAMERA = Camera.from_fov(640, 480, 40.0)
PATCH_MM = 88.194
PATCHES = ("coffeepot", "eggnog", "racer", "warplane")
POSES = {"racer": ((20, 30), (140, 62), (80, 45)), "eggnog": ((10, 28), (325, 45), (345, 60))}
"""Azimuth and elevation; the sheet on the car lies flat, the one round the bottle is bent."""


def shoot(name: str, azimuth: float, elevation: float, renderer: RaycastRenderer) -> tuple[np.ndarray, np.ndarray]:
    """A photo and its `T_world_camera`."""
    pose = orbit_pose(np.array([0, 0, 60.0 if name == "racer" else 130.0]), azimuth, elevation, 620.0)
    return tone_map(renderer.render(CAMERA, pose), (0, int(azimuth))), pose


def dress(name: str, size_mm: float | None):
    """An object's spec and mesh, and a renderer of it with its patch, or bare."""
    item = load_object(PACKAGE_DATA / "objects" / f"{name}.toml")
    mesh = item.mesh
    if size_mm is not None:
        mesh = attach(mesh, mount_patch(mesh, shipped_patch(name), size_mm, item.spec.mounts[0], name))
    return item, RaycastRenderer(mesh, make_studio(1, 270.0, backdrop="oak"), QUICK)


@pytest.fixture(scope="module")
def photos() -> dict[str, tuple]:
    """Per object: its spec and mesh, and (searched photo, pose) of each pose with its patch on."""
    made = {}
    for name, poses in POSES.items():
        item, renderer = dress(name, PATCH_MM)
        shots = [shoot(name, *pose, renderer) for pose in poses]
        made[name] = (item, [(search_photo(photo), T_world_camera) for photo, T_world_camera in shots])
    return made


def paste(patch: np.ndarray, corners_px: np.ndarray, quality: int = 85, seed: int = 0) -> np.ndarray:
    """A patch in front of a lively background: warped at eight times the resolution and averaged; as JPEG."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 256, (30, 40, 3), dtype=np.uint8)
    photo = cv2.resize(coarse, (640, 480), interpolation=cv2.INTER_CUBIC)
    fine, n = 8, patch.shape[0] * 4
    large = patch.repeat(4, axis=0).repeat(4, axis=1)
    T = cv2.getPerspectiveTransform((UNIT_CORNERS * n).astype(np.float32), (corners_px * fine).astype(np.float32))
    low, high = np.floor(corners_px.min(axis=0)).astype(int) - 1, np.ceil(corners_px.max(axis=0)).astype(int) + 1
    shift = np.array([[1, 0, -low[0] * fine], [0, 1, -low[1] * fine], [0, 0, 1]])
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    size = tuple(int(side) for side in (high - low) * fine)
    M = np.linalg.inv(half) @ shift @ T @ half
    colour = cv2.warpPerspective(large, M, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    mask = cv2.warpPerspective(np.ones((n, n), np.float32), M, size)
    small = tuple(int(side) for side in high - low)
    colour, mask = (cv2.resize(one, small, interpolation=cv2.INTER_AREA) for one in (colour, mask))
    window = photo[low[1] : high[1], low[0] : high[0]]
    window[:] = np.round(window * (1 - mask[..., None]) + (20 + 0.8 * colour) * mask[..., None]).astype(np.uint8)
    noisy = np.clip(photo + rng.normal(0, 3, photo.shape), 0, 255).astype(np.uint8)
    file = BytesIO()
    Image.fromarray(noisy).save(file, "JPEG", quality=quality)
    return np.asarray(Image.open(file))


def slanted(side: float, slant_deg: float, turn_deg: float) -> np.ndarray:
    """Corners of a square of `side` px seen from afar, turned in its plane and then tilted."""
    turn = np.radians(turn_deg)
    square = (UNIT_CORNERS - 0.5) @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) * side
    depth = 1 + 0.15 * square[:, 1:] / side * np.sin(np.radians(slant_deg))
    return square * [1, np.cos(np.radians(slant_deg))] / depth + [331.3, 242.7]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "side", "slant_deg", "turn_deg", "limit_px"),
    [
        ("racer", 60, 0, 30, 0.3), ("warplane", 150, 40, 200, 0.3), ("eggnog", 110, 60, -70, 0.4),
        ("coffeepot", 90, 60, 120, 0.4),
    ],
)  # fmt: skip
def test_corners_of_a_pasted_patch_are_found(name, side, slant_deg, turn_deg, limit_px):
    corners = slanted(side, slant_deg, turn_deg)
    sighting = find_patch(paste(shipped_patch(name), corners), shipped_patch(name))
    assert sighting is not None and sighting.confidence > 0.8 and sighting.shown == 1
    assert np.abs(sighting.corners_px - corners).max() < limit_px
    flat = cv2.perspectiveTransform(UNIT_CORNERS[None], sighting.homography)[0]
    assert np.abs(flat - corners).max() < 1.0


def name_patch(photo, patches: dict[str, np.ndarray]) -> str | None:
    """Which patch is on an object that should have none, as the gate of variants names it."""
    return look_for_patches(photo, ExpectedPatch(None, patches), None).other


@pytest.mark.slow
def test_the_other_patches_are_not_found_and_the_right_one_is_named():
    known = {name: shipped_patch(name) for name in PATCHES}
    for name, turn in (("racer", 15), ("coffeepot", 140)):
        photo = search_photo(paste(known[name], slanted(100, 45, turn)))
        assert [other for other in PATCHES if find_patch(photo, known[other]) is not None] == [name]
        assert name_patch(photo, known) == name
        assert name_patch(photo, {other: known[other] for other in PATCHES if other != name}) is None


def test_a_photo_without_any_feature_is_no_error():
    assert find_patch(np.full((240, 320, 3), 128, np.uint8), shipped_patch("racer")) is None
    assert find_patch(np.zeros((9, 11, 3), np.uint8), shipped_patch("racer")) is None


def test_two_equally_good_patches_are_not_decided_between():
    racer = shipped_patch("racer")
    photo = search_photo(paste(racer, slanted(120, 20, 5)))
    assert name_patch(photo, {"a": racer, "b": racer.copy()}) in ("a or b", "b or a")


def test_half_a_patch_is_found_and_half_is_said_to_show():
    photo = paste(shipped_patch("warplane"), slanted(140, 25, 0)).copy()
    middle = 331
    photo[:, middle:] = 90
    sighting = find_patch(photo, shipped_patch("warplane"))
    assert sighting is not None and 0.3 <= sighting.shown <= 0.6
    assert np.abs(sighting.corners_px[[0, 3]] - slanted(140, 25, 0)[[0, 3]]).max() < 1.5


def test_the_straightened_patch_is_the_file():
    patch = shipped_patch("racer")  # the eggnog's is much the same upright and turned
    photo = paste(patch, slanted(220, 35, 77))
    found = rectify_patch(photo, find_patch(photo, patch), 50)
    file = cv2.resize(patch, (50, 50), interpolation=cv2.INTER_AREA)
    assert found.shape == (50, 50, 3)
    upright, *turned = (
        np.corrcoef(found.ravel().astype(float), np.rot90(file, turns).ravel())[0, 1] for turns in range(4)
    )
    assert upright > 0.9 and max(turned) < min(0.5, upright - 0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(POSES))
def test_a_mounted_patch_is_found_where_the_rig_mounted_it(photos, name):
    item, shots = photos[name]
    sheet = mount_patch(item.mesh, shipped_patch(name), PATCH_MM, item.spec.mounts[0], name)
    side = PATCH_MM + 10
    # along the bend, at the lower and upper straight edge: points of the sheet, and their place on the patch
    uv = (sheet.mesh.uv[:162] * side - 5) / PATCH_MM
    for photo, pose in shots:
        sighting = find_patch(photo, shipped_patch(name))
        assert sighting is not None and sighting.confidence > 0.8
        kept = ((uv > -0.08) & (uv < 1.08)).all(axis=1)
        truth, _ = project(CAMERA, pose, sheet.mesh.vertices[:162][kept])
        places = sighting.warp.to_pixels(np.c_[uv[kept, 0], 1 - uv[kept, 1]])
        assert np.median(np.linalg.norm(places - truth, axis=1)) < 0.8
        for other in PATCHES:
            assert other == name or find_patch(photo, shipped_patch(other)) is None


def test_a_bare_object_has_no_patch():
    _, renderer = dress("racer", None)
    photo, _ = shoot("racer", 140, 62, renderer)
    assert name_patch(search_photo(photo), {name: shipped_patch(name) for name in PATCHES}) is None


def trace(photo: np.ndarray | SearchedPhoto, name: str, T_world_camera: np.ndarray) -> PatchLines:
    """The lines of sight of a patch that is found in a photo."""
    return trace_patch([find_patch(photo, shipped_patch(name))], PosedCamera(T_world_camera, CAMERA))


@pytest.mark.parametrize("name", list(POSES))
def test_a_mounted_patch_is_measured_to_a_percent(photos, name):
    _, shots = photos[name]
    assert measure_side([trace(photo, name, pose) for photo, pose in shots]) == pytest.approx(PATCH_MM, rel=0.01)


@pytest.mark.slow
def test_a_patch_that_the_print_dialog_shrank_is_noticed():
    _, renderer = dress("racer", 0.94 * PATCH_MM)
    shots = [shoot("racer", *pose, renderer) for pose in POSES["racer"]]
    lines = [trace(photo, "racer", pose) for photo, pose in shots]
    assert measure_side(lines) == pytest.approx(0.94 * PATCH_MM, rel=0.01)
    checked = [CheckedPhoto("racer", "patched", i, lines=one) for i, one in enumerate(lines, 1)]
    (finding,) = find_wrong_sizes(checked, {("racer", "patched"): (PATCH_MM,)})
    assert finding.results[0].failed and finding.results[0].value == pytest.approx(6, abs=1)
    assert "intended 88.2 mm" in finding.results[0].advice
    assert "100 %" in finding.results[0].advice and "\n" not in finding.results[0].advice


def test_a_page_on_the_table_is_measured_in_space():
    corners = (UNIT_CORNERS - 0.5) * [80, -80] + [12, -7]
    lines = []
    for azimuth in (20, 140, 260):
        pose = orbit_pose(np.zeros(3), azimuth, 55, 500.0)
        pixels, _ = project(CAMERA, pose, np.c_[corners, np.zeros(4)])
        lines.append(trace(paste(shipped_patch("warplane"), pixels), "warplane", pose))
    assert measure_side(lines) == pytest.approx(80, rel=0.004)


def test_one_side_alone_does_not_place_a_patch_in_space():
    pose = orbit_pose(np.zeros(3), 20, 55, 500.0)
    pixels, _ = project(CAMERA, pose, np.c_[(UNIT_CORNERS - 0.5) * [80, -80], np.zeros(4)])
    line = trace(paste(shipped_patch("racer"), pixels), "racer", pose)
    for lines in ([], [line], [line] * 2, [line] * 4):
        assert measure_side(lines) is None
    (finding,) = find_wrong_sizes([CheckedPhoto("racer", "patched", 1, lines=line)], {("racer", "patched"): (80.0,)})
    assert finding.results[0].status == "not checked"


def test_the_size_check_keeps_its_threshold():
    assert SIZE.judge(1.9).passed and not SIZE.judge(2.1).passed


def test_a_bent_warp_and_its_inverse_undo_each_other():
    rng = np.random.default_rng(0)
    H = np.array([[120, 30, 200], [-20, 90, 150], [0.1, 0.2, 1.0]])
    warp = PatchWarp(H, rng.normal(0, 2, (7, 2)))
    uv = rng.uniform(0, 1, (50, 2))
    np.testing.assert_allclose(warp.to_patch(warp.to_pixels(uv)), uv, atol=1e-4)
    np.testing.assert_allclose(warp.scaled(0.5).to_pixels(uv), warp.to_pixels(uv) / 2)


def test_a_warp_is_fitted_in_spite_of_wrong_pairs():
    rng = np.random.default_rng(1)
    truth = PatchWarp(np.array([[120, 30, 200], [-20, 90, 150], [0.1, 0.2, 1.0]]), FLAT)
    uv = rng.uniform(0, 1, (120, 2))
    pixels = truth.to_pixels(uv) + rng.normal(0, 0.05, (120, 2))
    pixels[:30] += rng.uniform(20, 60, (30, 2)) * rng.choice([-1, 1], (30, 2))
    start = PatchWarp(np.array([[95, 20, 202], [-28, 70, 151], [0, 0, 1.0]]), FLAT)
    fitted = fit_warp(uv, pixels, start, float("inf"), near_px=2.0)
    assert np.abs(fitted.corners - truth.corners).max() < 0.5
    assert fit_warp(uv[:5], pixels[:5], start, float("inf")) is start


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0], [0, 50], [50, 50], [50, 0]],  # mirrored
        [[10, 10], [14, 10], [14, 14], [10, 14]],  # too small
        [[900, 10], [990, 10], [990, 99], [900, 99]],  # outside
    ],
)
def test_impossible_warps_are_refused(corners):
    T = cv2.getPerspectiveTransform(UNIT_CORNERS.astype(np.float32), np.array(corners, np.float32))
    assert not is_plausible(PatchWarp(T, FLAT), (480, 640, 3))


def test_a_drawn_patch_keeps_its_mean_and_its_place():
    patch = np.zeros((10, 10, 1), np.float32)
    patch[:, 5:] = 1
    H = np.array([[40.0, 0, 20.5], [0, 40, 30.5], [0, 0, 1]])
    drawn = draw_patch(patch, PatchWarp(H, FLAT), (100, 100))
    assert drawn.picture[drawn.inside].mean() == pytest.approx(0.5, abs=0.02)
    row = drawn.picture[drawn.inside.shape[0] // 2, :, 0]
    columns = drawn.left + np.arange(len(row)) + 0.5
    # the step lies at 20.5 + 20 = 40.5, the middle of pixel 40, which is then half of each
    assert np.interp(40.5, columns, row) == pytest.approx(0.5, abs=0.03)
    assert np.interp(38.5, columns, row) < 0.01 and np.interp(42.5, columns, row) > 0.99


@pytest.mark.parametrize("size", [(640, 480), (641, 479)])
def test_shrinking_keeps_places(size):
    x = np.broadcast_to(np.arange(size[0], dtype=np.float32) + 0.5, size[::-1])
    picture = np.ascontiguousarray(np.stack([x, x, x], -1) / 4).astype(np.float32)
    small = shrink_image(picture, 0.37)
    columns = np.arange(small.shape[1]) + 0.5
    inner = slice(5, -5)
    np.testing.assert_allclose(small[20, inner, 0] * 4, (columns / 0.37)[inner], atol=0.1)
    assert shrink_image(picture, 1.0) is picture


RECORDS = Path(__file__).parents[3] / "docs" / "records" / "photographs"


@pytest.mark.slow
def test_real_stickers_lie_where_a_hand_marked_their_corners() -> None:
    """A percent of the side is asked; the marks are sure to half a pixel."""
    shared = Path(__file__).resolve().parents[4] / "shared" / "photos" / "stickers-keyboard"
    if not shared.is_dir():
        pytest.skip(f"the photographs of printed stickers are not in {shared}")
    marked = json.loads((RECORDS / "corners.json").read_text())["marked_px"]
    order = ["upper left", "upper right", "lower right", "lower left"]
    for name in ("basketball2_6in_over", "bear2_3in_side"):
        patch = read_image(shared / "originals" / f"{name.split('_')[0]}.png")
        sighting = find_patch(read_image(shared / f"{name}.jpg"), patch)
        assert sighting is not None
        for corner, place in marked[name].items():
            off = np.linalg.norm(sighting.corners_px[order.index(corner)] - place)
            assert off < 0.01 * sighting.warp.side_px, (name, corner)


WORDS = {
    "drawn into the true one": "drawn into the true photograph", "8 px beside": "shifted by 8 px",
    "two true ones, other stickers": "two true photographs, other stickers", "30 px beside": "shifted by 30 px",
    "2 % nearer": "2 % closer",
}  # fmt: skip
"""What the page calls rows of a record."""


def test_the_pages_say_what_the_records_of_photographs_hold() -> None:
    docs = RECORDS.parents[1]
    pages = ("tasks/photograph.md", "results/photographs.md", "reference/photographs.md")
    steps, results, how = ((docs / page).read_text() for page in pages)
    task = steps + results
    answers = json.loads((RECORDS / "keyboard.json").read_text())
    for place, said in (("3in_over", "3 inches, on the keys"), ("6in_over", "6 inches, on the keys")):
        counts = [answers[net][f"{what} {place}"] for net in answers for what in ("sticker", "picture")]
        assert f"| {said} | " + " | ".join(f"{hits} of {n}" for hits, n in counts) + " |" in task
    put = json.loads((RECORDS / "retextured.json").read_text())
    for said, key in (("trained patch", "patched"), ("grey paper", "grey-patch"), ("random texels", "random-patch")):
        cells = [put[network][one] for network in ("resnet18", "mobilenet_v2") for one in (key, f"{key} 6in_over")]
        assert f"| {said} (put there) | " + " | ".join(f"{h} of {n}, {mean:.2f}" for h, n, mean in cells) + " |" in task
    finder = json.loads((RECORDS / "finder.json").read_text())
    small = [finder["found"][side] for side in ("45", "40", "35", "30")]
    assert f"{sum(h for h, _ in small)} of {sum(n for _, n in small)}" in how
    assert f"{finder['looks']} searches | | {len(finder['false'])} |" in how
    assert all(finder["found"][side] == [16, 16] for side in ("50", "75", "100", "as taken"))
    rows = json.loads((RECORDS / "time.json").read_text())["photographs"]
    assert f"takes about {max(r['whole_s'] for r in rows):.0f} s on one core" in task
    assert f"{max(r['memory_mb'] for r in rows)} MB" in task
    corners = json.loads((RECORDS / "corners.json").read_text())
    assert f"{corners['n']} corners" in how and f"{corners['error_percent_of_side']['largest']} % at most" in how
    gates = {key: hits for key, (hits, _) in json.loads((RECORDS / "gates.json").read_text())["counts"].items()}
    shakes = [f"{kind} {sigma} px" for kind in ("straight", "hand") for sigma in (1, 2)]
    for said, label, more in (
        ("97, no board expected", "", ""), ("the same, then sharpened as phones do", "", ", sharpened"),
        ("28 with their ChArUco board", "board: ", ""), ("the same, sharpened", "board: ", ", sharpened"),
    ):  # fmt: skip
        assert f"| {said} | " + " | ".join(str(gates[f"{label}{shake}{more}"]) for shake in shakes) + " |" in how
    card, sheet = json.loads((RECORDS / "boards.json").read_text()).values()
    assert f"We measure {card['fx']:.1f} ± {card['sigma']} px" in how
    flat = " | ".join(f"{one['opencv_px']} / {one['flat_px']}" for one in (card, sheet))
    assert f"| error with a flat board, px: OpenCV / here | {flat} |" in how
    contain = [f"{one['within'][0]} of {one['within'][1]}" for one in (card, sheet)]
    assert f"| {contain[0]} (owner's measurement) | {contain[1]} (focal length of all) |" in how
    rooms = json.loads((RECORDS / "rooms.json").read_text())["delta_e_median"].values()
    assert f"**{' and '.join(f'{one:.1f}' for one in rooms)}**, a colour card" in how
    put = json.loads((RECORDS / "retexture.json").read_text())
    for said, place in (
        ("3 inches, on the keys, 12 pairs", "3in_over"), ("3 inches, beside, 12", "3in_side"),
        ("6 inches, on the keys, 12", "6in_over"), ("6 inches, beside, 12", "6in_side"),
    ):  # fmt: skip
        row = put["delta_e"][place]
        cells = [f"{row['texel_px']:.0f} px", *(f"{x:.1f}" for x in (*row["other"], row["own"]))]
        assert f"| {said} | " + " | ".join(cells) + " |" in how, place
    for key, counts in put["alike"]["resnet18"].items():
        both = (counts, put["alike"]["mobilenet_v2"][key])
        assert f"| {WORDS.get(key, key)} | " + " | ".join(f"{hits} of {n}" for hits, n in both) + " |" in how, key
    sets = json.loads((RECORDS / "rehearsal.json").read_text())["sets"]
    rehearsed = sets["rehearsed, white table"]
    cameras = [one for name, one in sets.items() if name.startswith(("phone", "camera", "webcam"))]
    for key, (low, median, high) in ((k, v) for k, v in rehearsed.items() if k not in ("n", "clipped %")):
        assert f"{median:.2f} ({low:.2f} to {high:.2f})" in how, key
        within = min(one[key][0] for one in cameras) <= median <= max(one[key][2] for one in cameras)
        assert within == (key != "contrast"), "the page says of which numbers the rehearsal is like the cameras"
