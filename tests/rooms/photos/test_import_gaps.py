"""A session with a photograph missing, or one too many: what is certain is placed, the rest is asked or listed."""

from datetime import datetime, timedelta

import numpy as np
import pytest
from board_photos import QUICK
from import_bench import Board, camera, folder, imported, run, space, take  # noqa: F401, fixtures
from PIL import Image
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.workspace import make_workspace
from toolkit.objects.load import load_object
from toolkit.rig import Pattern
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.plan import make_plan, read_plan, write_plan
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.importing.align import EXTRA, LIKE, NO_SHOT, WRONG, align_shots, rate_corners
from toolkit.rooms.photos.shot_order import list_shots, order_shots, write_shots

FAR = 6.0


def costs_of(shown: list[int], count: int) -> np.ndarray:
    """Photographs that show these shots plainly."""
    costs = np.full((len(shown), count), FAR)
    for i, shot in enumerate(shown):
        if shot >= 0:
            costs[i, shot] = 0
    return costs


@pytest.mark.parametrize("gone", range(12))
def test_one_that_is_missing_shifts_the_rest(gone):
    shown = [shot for shot in range(12) if shot != gone]
    assert align_shots(costs_of(shown, 12)) == [(shot,) for shot in shown]


def test_many_gaps_and_a_photograph_of_something_else():
    shown = [0, 3, NO_SHOT, 4, 5, 9]
    placed = align_shots(costs_of(shown, 10) + np.where(np.arange(6) == 2, EXTRA, 0)[:, None])
    assert placed == [(0,), (3,), (NO_SHOT,), (4,), (5,), (9,)]


def test_what_nothing_speaks_for_is_left_open():
    assert align_shots(np.zeros((2, 3))) == [(0, 1), (1, 2)]


def test_only_those_beside_the_gap_are_open_where_a_picture_says_nothing():
    """Shots 2 and 3 look alike, and one of them is missing; all others are plain."""
    costs = costs_of([0, 1, 2, 4, 5], 6)
    costs[2, 3] = 0
    assert align_shots(costs) == [(0,), (1,), (2, 3), (4,), (5,)]


def test_the_cheapest_way_is_the_one_that_all_ways_tried_out_give():
    """Against trying out every increasing choice of shots."""
    from itertools import combinations

    costs = np.random.default_rng(4).uniform(0, 4, (4, 6))
    totals = {shots: sum(costs[i, shot] for i, shot in enumerate(shots)) for shots in combinations(range(6), 4)}
    best = min(totals.values())
    near = [shots for shots, total in totals.items() if total <= best + 3.0]
    placed = align_shots(costs)
    for i in range(4):
        assert {shots[i] for shots in near} <= set(placed[i])


def test_odds_decide_and_not_what_a_photograph_costs_alone():
    """A bent sheet is seen at its own shot with a cost of 2.5: far likelier than what is left, so it is placed."""
    costs = 2 * costs_of([0, 1, 3, 4], 5)
    costs[1, 1] = 2.5
    assert align_shots(costs) == [(0,), (1,), (3,), (4,)]
    costs[1, 1] = EXTRA - 1  # about as likely no shot at all
    assert align_shots(costs)[1] == (1, NO_SHOT)


def test_a_likeness_that_is_ahead_by_a_little_decides_beside_the_gap():
    """The last but one of 12 looks like its own render by 0.05 more than like that of the last, which is missing."""
    costs = costs_of(list(range(11)), 12)
    costs[10, 11] = 0.05 * LIKE
    assert align_shots(costs) == [(shot,) for shot in range(11)]
    costs[10, 11] = 0.02 * LIKE
    assert align_shots(costs)[10] == (10, 11)


@pytest.mark.parametrize(("turn_deg", "sheared", "most"), [(3, 0.04, 0.5), (27, 0.4, 3.5), (120, 0.4, 6.0)])
def test_corners_that_are_a_little_off_cost_little_and_none_more_than_plain_contradiction(turn_deg, sheared, most):
    square = np.array([(-1.0, -1), (1, -1), (1, 1), (-1, 1)])
    turn = np.radians(turn_deg)
    seen = (
        square
        @ np.array([[1, sheared], [0, 1]])
        @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    )
    assert most - 1.6 < min(rate_corners(seen, square), WRONG) <= most


@pytest.fixture
def session(space, folder):  # noqa: F811
    """Twelve shots of the crate, six poses bare and patched, and what the board says of each photograph."""
    item = load_object(space.object_spec("crate"))
    plan = make_plan([item], Camera.from_fov(96, 72), Pattern(name="ring", count=6, elevation_deg=(40, 40)))
    write_plan(space.plan_file, plan)
    steps = order_shots(plan, ["crate"], seed=3)
    write_shots(space.root / "rig" / "shots.json", list_shots(plan, steps, 3))
    azimuths = {pose.id: pose.azimuth_deg for pose in plan.objects["crate"]}
    cameras = {}
    for step in steps:
        take(folder / f"IMG_{step.number + 40}.jpg", step.number, step.number)
        cameras[f"IMG_{step.number + 40}.jpg"] = camera(space, azimuths[step.pose_id] + 2)
    return space, folder, steps, Board(cameras)


@pytest.mark.parametrize("gone", [1, 5, 8, 12])
def test_a_session_of_twelve_with_one_missing_imports_eleven(session, gone):
    space, folder, steps, board = session  # noqa: F811
    (folder / f"IMG_{gone + 40}.jpg").unlink()
    result = run(space, folder, ImportSettings(), board)
    assert not result.refused
    assert imported(result) == {
        f"crate/{step.variant}/pose_{step.pose_id:02d}.jpg": f"IMG_{step.number + 40}.jpg"
        for step in steps if step.number != gone
    }  # fmt: skip
    late = take(folder / f"IMG_{gone + 40}.jpg", gone, 60)  # it is taken again, after all others
    result = run(space, folder, ImportSettings(), board)
    assert list(imported(result).values()) == [late.name] and len(result.before) == 11


@pytest.mark.slow
def test_what_is_open_is_asked_between_the_shots_that_it_may_be(session):
    """Without a board the noise in the pictures says nothing; the first photograph of eleven is shot 1 or 2."""
    space, folder, steps, _ = session  # noqa: F811
    (folder / "IMG_45.jpg").unlink()
    questions = []

    def ask(question, answers):
        questions.append((question, list(answers)))
        return "2" if question.startswith("IMG_41") else None

    result = run(space, folder, ImportSettings(), ask=ask)
    question, answers = questions[0]
    assert "could be crate/" in question and "11 photographs for the 12 shots" in question and answers == ["1", "2"]
    assert imported(result) == {f"crate/{steps[1].variant}/pose_{steps[1].pose_id:02d}.jpg": "IMG_41.jpg"}
    assert len(result.refused) == 10


def test_one_line_for_one_cause(session, monkeypatch):
    space, folder, _, _ = session  # noqa: F811
    monkeypatch.chdir(space.root)
    (space.root / "rig" / "shots.json").unlink()
    for file in list(folder.iterdir()):
        file.rename(file.with_name(f"crate_{file.name}"))
    take(folder / "crate_patched_pose_1.jpg", 99, 99)
    result = CliRunner().invoke(app, ["import", str(folder), "--quiet"])
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("not imported: ")]
    assert line.count("IMG_") == 10 and " and 2 more: nothing says which object and variant it shows" in line


@pytest.mark.slow
def test_pictures_alone_say_which_one_is_missing(tmp_path):
    """The rig's pictures of the racer in another light, on another table and beside the poses; no board, no names."""
    from toolkit.rig.raycast import RaycastRenderer
    from toolkit.rig.shading import tone_map
    from toolkit.rig.studio import make_studio
    from toolkit.rig.variants import apply_booster, find_booster

    space = make_workspace(tmp_path / "space")  # noqa: F811
    item = load_object(space.object_spec("racer"))
    write_plan(space.plan_file, make_plan([item], Camera.from_fov(640, 480), Pattern(count=4)))
    plan = read_plan(space.plan_file)
    steps = order_shots(plan, ["racer"], seed=3)
    write_shots(space.root / "rig" / "shots.json", list_shots(plan, steps, 3))
    poses, rng = {pose.id: pose for pose in plan.objects["racer"]}, np.random.default_rng(1)
    (tmp_path / "photos").mkdir()
    for variant in ("unpatched", "patched"):
        mesh = apply_booster(item, find_booster(space, item, variant))
        renderer = RaycastRenderer(mesh, make_studio(7, float(item.mesh.size_mm.max()), "oak", light="side"), QUICK)
        for step in (step for step in steps if step.variant == variant and step.number != 4):
            pose = poses[step.pose_id]
            beside = rng.normal(0, 3), rng.normal(0, 2)
            T = orbit_pose(
                np.array(pose.target_mm), pose.azimuth_deg + beside[0], pose.elevation_deg + beside[1],
                pose.distance_mm * rng.uniform(0.8, 1), rng.normal(0, 1.5),
            )  # fmt: skip
            pixels = tone_map(renderer.render(Camera.from_fov(480, 360, 50), T), (3, step.number))
            exif, taken = Image.Exif(), datetime(2024, 5, 1, 10) + timedelta(minutes=step.number)
            exif[0x8769] = {0x9003: taken.strftime("%Y:%m:%d %H:%M:%S")}
            Image.fromarray(pixels).save(tmp_path / "photos" / f"IMG_{step.number}.jpg", exif=exif.tobytes())
    result = run(space, tmp_path / "photos", ImportSettings())
    assert not result.refused
    assert imported(result) == {
        f"racer/{step.variant}/pose_{step.pose_id:02d}.jpg": f"IMG_{step.number}.jpg"
        for step in steps if step.number != 4
    }  # fmt: skip
