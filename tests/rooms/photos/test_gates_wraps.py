"""The gates of a wrapped object: pieces that the pose shows are looked for, and the wrap is told from a bare object."""

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
import pytest
from crate_bench import CAMERA, CrateBench
from PIL import Image
from slow_cases import mark_slow

from toolkit.core.console import quietly
from toolkit.objects.load import load_object
from toolkit.rig import Pattern
from toolkit.rig.camera import orbit_pose
from toolkit.rig.plan import make_plan
from toolkit.rig.variants import apply_booster, find_booster
from toolkit.rooms.photos.gates.check_captures import hash_setup
from toolkit.rooms.photos.gates.check_photo import ExpectationBuilder, inspect_photo
from toolkit.rooms.photos.importing.align import WRONG, Clues
from toolkit.rooms.photos.importing.evidence import Evidence
from toolkit.rooms.photos.importing.gather import Candidate, CaptureKey
from toolkit.rooms.photos.importing.match import RenderMatcher
from toolkit.rooms.photos.photo import read_photo
from toolkit.rooms.photos.posed_camera import PosedCamera
from toolkit.rooms.wraps.config import WrapConfig
from toolkit.rooms.wraps.wrap import Wrap, WrapTraining, read_wrap, write_wrap
from toolkit.rooms.wraps.wrap_plan import plan_wrap

ABOVE, FAR = (30, 40, 470.0), (30, 40, 1500.0)
TRAINING = WrapTraining(
    class_index=1, networks=[], data={}, seed=0, settings={}, final={}, misfit={}, toolkit_version="0"
)


@dataclass(frozen=True)
class Bench(CrateBench):
    @cache  # noqa: B019 - one bench lives as long as the module
    def mesh(self, pieces: tuple[int, ...]):
        """The crate with some of its pieces stuck on, each a little beside its place."""
        item = load_object(self.space.object_spec("crate"))
        booster = find_booster(self.space, item, "wrapped", seed=5)
        wrap = booster.wrap
        record = wrap.record.model_copy(update={"pieces": [wrap.record.pieces[k] for k in pieces]})
        some = replace(booster, wrap=Wrap(record, tuple(wrap.pieces[k] for k in pieces), wrap.pixels))
        return apply_booster(item, some) if pieces else item.mesh

    @cache  # noqa: B019
    def shoot(self, view: tuple[float, float, float], pieces: tuple[int, ...] = (0, 1, 2)):
        return self.photograph(self.mesh(pieces), pose(view))

    def check(self, image, view: tuple[float, float, float], variant: str, with_pose: bool = True):
        camera = PosedCamera(pose(view), CAMERA) if with_pose else None
        results = inspect_photo(image, self.expecter.expect("crate", variant, 1, camera)).results
        return next(result for result in results if result.name == "wrong variant")


def pose(view: tuple[float, float, float]) -> np.ndarray:
    return orbit_pose(np.array([0, 0, 35.0]), *view)


def wrap_crate(space, seed: int) -> None:
    """Three pieces on a crate, a picture of coloured blobs on them."""
    if (space.wraps_dir / "crate").exists():
        plan = read_wrap(space.wraps_dir / "crate")
    else:
        with quietly(True):
            config = WrapConfig(pieces=3, sheet_mm=(95.0, 95.0), views=16)
            plan = plan_wrap(load_object(space.object_spec("crate")), config)
    blobs = np.random.default_rng(seed).integers(0, 256, (40, 40, 3), dtype=np.uint8)
    pixels = cv2.resize(blobs, plan.pixels.shape[1::-1], interpolation=cv2.INTER_CUBIC)
    trained = plan.record.model_copy(update={"class_name": "crate", "booster": TRAINING})
    write_wrap(space.wraps_dir / "crate", Wrap(trained, plan.pieces, pixels))


@pytest.fixture(scope="module")
def bench(tmp_path_factory, make_box) -> Bench:
    made = Bench.make(tmp_path_factory.mktemp("gates"), make_box((130.0, 90.0, 75.0)))
    wrap_crate(made.space, 3)
    return made


@pytest.mark.parametrize(
    ("variant", "right", "wrong", "words"),
    [
        ("wrapped", (0, 1, 2), (), "the wrap 'crate' is not seen, 'wrapped' should show it"),
        ("unpatched", (), (0, 1, 2), "the wrap 'crate' is seen, 'unpatched' should show no wrap"),
    ],
)
def test_a_wrap_is_told_from_a_bare_object(bench, variant, right, wrong, words):
    assert bench.check(bench.shoot(ABOVE, right), ABOVE, variant).passed
    result = bench.check(bench.shoot(ABOVE, wrong), ABOVE, variant)
    assert result.failed and words in result.advice


def test_a_piece_that_is_missing_is_named(bench):
    """The camera sees three sides; which piece lies where is the plan's business."""
    squares = bench.expecter.expect("crate", "wrapped").wrap.squares
    assert {square.at for square in squares} == {"piece 1", "piece 2", "piece 3"}
    missing = [
        bench.check(bench.shoot(ABOVE, tuple(k for k in range(3) if k != left_out)), ABOVE, "wrapped")
        for left_out in range(3)
    ]
    named = [f"piece {k} of the wrap 'crate' is not seen" in result.advice for k, result in enumerate(missing, 1)]
    assert sum(named) >= 2, [result.advice for result in missing]
    for is_named, result in zip(named, missing, strict=True):
        assert result.failed == is_named


@pytest.mark.parametrize("shown", mark_slow([(0, 1, 2), ()], ()))
def test_from_too_far_or_without_a_pose_it_is_not_checked(bench, shown):
    for variant in ("wrapped", "unpatched"):
        assert bench.check(bench.shoot(FAR, shown), FAR, variant).status == "not checked"
        result = bench.check(bench.shoot(ABOVE, shown), ABOVE, variant, with_pose=False)
        assert result.status == "not checked" and "no board is seen" in result.advice


@pytest.mark.parametrize(("pieces", "shown"), [((0, 1, 2), "wrapped"), ((), "unpatched")])
def test_a_session_with_gaps_is_laid_by_whether_the_wrap_is_on(bench, tmp_path, pieces, shown):
    Image.fromarray(bench.shoot(ABOVE, pieces)).save(tmp_path / "IMG_1.jpg", quality=95)
    seen = Evidence(
        Candidate(read_photo(tmp_path / "IMG_1.jpg"), "IMG_1.jpg", ()), located=PosedCamera(pose(ABOVE), CAMERA)
    )
    plan = make_plan([load_object(bench.space.object_spec("crate"))], CAMERA, Pattern(name="ring", count=4))
    variants = ["unpatched", "wrapped"]
    clues = Clues(bench.space, plan, RenderMatcher(bench.space, plan))
    costs = clues.weigh(seen, [CaptureKey("crate", variant, 1) for variant in variants])
    assert abs(costs[0] - costs[1]) == WRONG and variants[int(costs.argmin())] == shown


def test_another_wrap_makes_what_was_judged_be_judged_again(bench):
    before, photo = hash_setup(bench.space), bench.shoot(ABOVE)
    wrap_crate(bench.space, 4)
    other = Bench(bench.space, ExpectationBuilder(bench.space))
    assert hash_setup(bench.space) != before
    assert other.check(photo, ABOVE, "wrapped").failed
