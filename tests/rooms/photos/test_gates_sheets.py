"""The gates of an object with two sheets: what the pose shows is looked for, and one that is missing is named."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from crate_bench import CAMERA, CrateBench, by_name, lines_to

from toolkit.objects.load import load_object
from toolkit.objects.records import read_patch
from toolkit.rig.camera import orbit_pose
from toolkit.rig.mount import attach, mount_sheets
from toolkit.rooms.photos.gates.check_photo import inspect_photo
from toolkit.rooms.photos.gates.check_set import CheckedPhoto, check_set, measure_moves, measure_side
from toolkit.rooms.photos.posed_camera import PosedCamera
from toolkit.rooms.photos.prints.align import cell_centres

SIZES_MM = (60.0, 45.0)
BOTH, TOP_ONLY, SIDE_ONLY = (70, 40), (250, 50), (85, 8)
"""Azimuth and elevation from which they show; the second sheet is on the left, azimuth 90°."""


@dataclass(frozen=True)
class Bench(CrateBench):
    @cache  # noqa: B019 - one bench lives as long as the module
    def mesh(self, stuck: tuple[int, ...], name: str):
        item = load_object(self.space.object_spec("crate"))
        pixels = read_patch(self.space.patch(name)).pixels
        sheets = mount_sheets(item.mesh, pixels, item.spec.mounts, SIZES_MM)
        return attach(item.mesh, *(sheets[k] for k in stuck))

    @cache  # noqa: B019
    def shoot(self, angles: tuple[float, float], stuck: tuple[int, ...] = (0, 1), name: str = "racer"):
        return self.photograph(self.mesh(stuck, name), pose(angles))

    def check(self, image, angles: tuple[float, float], variant: str = "patched", with_pose: bool = True):
        view = PosedCamera(pose(angles), CAMERA) if with_pose else None
        return inspect_photo(image, self.expecter.expect("crate", variant, 1, view))


def pose(angles: tuple[float, float]) -> np.ndarray:
    return orbit_pose(np.array([0, 0, 35.0]), *angles, 470.0)


@pytest.fixture(scope="module")
def bench(tmp_path_factory, make_box) -> Bench:
    sheets = f'[[patch]]\nsize_mm = {SIZES_MM[0]}\n[[patch]]\nat = "left"\nsize_mm = {SIZES_MM[1]}\n'
    return Bench.make(tmp_path_factory.mktemp("gates"), make_box((130.0, 90.0, 75.0)), sheets)


@pytest.mark.parametrize(("angles", "shown"), [(BOTH, (True, True)), (TOP_ONLY, (True, False))])
def test_what_the_pose_shows_is_found_and_passes(bench, angles, shown):
    check = bench.check(bench.shoot(angles), angles)
    results = by_name(check.results)
    assert results["wrong variant"].passed and results["patch hidden"].passed, results
    cells = check.lines.shows.reshape(2, 25)
    assert [bool(one.mean() > 0.7) for one in cells] == list(shown)


@pytest.mark.parametrize(
    ("stuck", "variant", "words"),
    [
        (((0,),), "patched", "sheet 2 (left) of 2 is not seen"),
        (((1,),), "patched", "sheet 1 (top) of 2 is not seen"),
        (((),), "patched", "no patch is seen"),
        (((0, 1), "warplane"), "patched", "the patch 'warplane' is seen"),
        (((0,),), "unpatched", "the patch 'racer' is seen"),
        (((1,),), "unpatched", "the patch 'racer' is seen"),
    ],
)
def test_a_sheet_that_is_missing_anothers_or_left_on_is_named(bench, stuck, variant, words):
    result = by_name(bench.check(bench.shoot(BOTH, *stuck), BOTH, variant).results)["wrong variant"]
    assert result.failed and result.value == 1 and words in result.advice


def test_one_that_the_pose_hides_is_not_missed(bench):
    """From the right the left sheet is behind the crate: whether it is there cannot be told, and nobody asks."""
    assert by_name(bench.check(bench.shoot(TOP_ONLY, (0,)), TOP_ONLY).results)["wrong variant"].passed
    assert by_name(bench.check(bench.shoot(BOTH, ()), BOTH, "unpatched").results)["wrong variant"].passed


def test_half_of_one_sheet_covered_is_hidden_though_the_other_shows(bench):
    corners = bench.expecter.expect("crate", "patched").patch.sheets[1].corners_mm
    x, y = PosedCamera(pose(BOTH), CAMERA).project(corners).T.round().astype(int)
    image = bench.shoot(BOTH).copy()
    image[y.min() : y.max(), x.min() : (x.min() + x.max()) // 2] = (205, 160, 135)
    results = by_name(bench.check(image, BOTH).results)
    assert results["patch hidden"].failed and results["wrong variant"].passed


def test_without_a_pose_either_sheet_will_do(bench):
    results = by_name(bench.check(bench.shoot(BOTH, (0,)), BOTH, with_pose=False).results)
    assert results["wrong variant"].passed


def test_each_sheet_has_its_own_size_and_moves_on_its_own():
    """Flat sheets at the origin and 200 mm beside it, seen from five places; in one photograph the second has moved."""
    flat = [np.c_[(cell_centres(5) - 0.5) * [side, -side], np.zeros(25)] for side in SIZES_MM]
    points = np.concatenate([flat[0], flat[1] + [200, 0, 0]])
    origins = [np.array([400 * np.cos(a), 400 * np.sin(a), 300]) for a in np.linspace(0, 5, 5)]
    photos = [lines_to(points, origin) for origin in origins]
    assert [measure_side(photos, sheet) for sheet in (0, 1)] == pytest.approx(SIZES_MM, abs=0.1)
    moved = points + np.repeat([[0, 0, 0], [0, 12, 0]], 25, axis=0)
    moves = measure_moves([lines_to(moved, origins[0]), *photos[1:]])
    assert moves[0] > 8 and max(moves[1:]) < 2
    checked = [CheckedPhoto("crate", "patched", k, lines=one) for k, one in enumerate(photos, 1)]
    found = [
        one.results[0]
        for one in check_set(checked, {("crate", "patched"): (60.0, 50.0)})
        if one.results[0].name == "patch size"
    ]
    assert [one.status for one in found] == ["passed", "failed"] and "sheet 2: the patch measures 45.0" in found[
        1
    ].advice
    unseen = [replace(one, shows=np.r_[np.ones(25, bool), np.zeros(25, bool)]) for one in photos]
    assert measure_side(unseen, 1) is None and max(measure_moves(unseen)) < 2
