"""Photographs find their object, variant and pose; what is in doubt is said, and not guessed."""

import json
import re

import import_bench
import numpy as np
import pytest
from import_bench import LENS, RANK, Board, camera, imported, reasons, run, take
from PIL import Image

from toolkit.captures.manifest import read_manifest
from toolkit.captures.read import read_captures
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.objects.load import load_object
from toolkit.rig import Pattern
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.plan import hash_pose, make_plan, read_plan, write_plan
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.importing.gather import CaptureKey
from toolkit.rooms.photos.importing.import_photos import import_photos
from toolkit.rooms.photos.importing.match import Decision, Doubt, RenderMatcher
from toolkit.rooms.photos.match_render import RenderMatch
from toolkit.rooms.photos.shot_order import list_shots, order_shots, write_shots

space, folder = import_bench.space, import_bench.folder


# --- which pose -----------------------------------------------------------------------------------------------------


def test_order_of_time_and_original_bytes(space, folder):
    """Names in another order than times; formats as they come."""
    for name, seed, minute in (("d.jpg", 1, 0), ("a.png", 2, 1), ("c.heic", 3, 2), ("b.jpeg", 4, 3)):
        take(folder / name, seed, minute)
    before = {file.name: (file.read_bytes(), file.stat().st_mtime_ns) for file in folder.iterdir()}
    result = run(space, folder)
    assert imported(result) == {
        "crate/patched/pose_01.jpg": "d.jpg", "crate/patched/pose_02.png": "a.png",
        "crate/patched/pose_03.heic": "c.heic", "crate/patched/pose_04.jpg": "b.jpeg",
    }  # fmt: skip
    assert not result.refused
    for record in result.imported:
        name = record.made["original_name"]
        assert (result.source_dir / record.path).read_bytes() == before[name][0]
        assert record.image_sha256 == record.made["original_sha256"] == sha256_file(folder / name)
        assert record.made["matched_by"] == "order" and record.made["camera"] == "Acme Phone 3"
    assert result.imported[0].made["taken"] == "2024-05-01T10:00:00"
    assert result.imported[0].booster_sha256 == sha256_file(space.patch("crate"))
    assert {file.name: (file.read_bytes(), file.stat().st_mtime_ns) for file in folder.iterdir()} == before
    row = next(row for row in result.coverage if row.variant == "patched")
    assert (row.imported, row.there, row.missing) == (4, 4, ())
    assert next(row for row in result.coverage if row.variant == "unpatched").missing == (1, 2, 3, 4)
    captures = read_captures(space.captures_dir).captures
    assert [(c.source, c.object, c.variant, c.pose_id) for c in captures] == [
        ("real", "crate", "patched", pose) for pose in (1, 2, 3, 4)
    ]


def test_another_count_says_nothing_of_the_order(space, folder):
    for i in range(3):
        take(folder / f"IMG_{i + 7}.jpg", i, i)
    result = run(space, folder)
    assert not result.imported and len(result.refused) == 3
    result = run(space, folder, ImportSettings(object="crate", variant="patched", match="order"))
    assert all("3 photographs for the 4 poses of the plan" in why for why in reasons(result).values())


def test_names_count_after_the_word_pose_or_when_they_are_the_plan(space, folder):
    take(folder / "pose_03.jpg", 1)
    assert list(imported(run(space, folder))) == ["crate/patched/pose_03.jpg"]
    others = folder.parent / "others"
    for i in range(1, 5):
        take(others / f"{5 - i}.jpg", 10 + i, i)  # named against the order of time
    result = run(space, others, ImportSettings(object="crate", variant="unpatched", match="name"))
    assert imported(result) == {f"crate/unpatched/pose_{i:02d}.jpg": f"{i}.jpg" for i in range(1, 5)}


def test_a_cameras_counter_is_no_pose_unless_asked(space, folder):
    take(folder / "IMG_0002.jpg", 1)
    assert "nothing is rendered" in reasons(run(space, folder))["IMG_0002.jpg"]
    result = run(space, folder, ImportSettings(object="crate", variant="patched", match="name"))
    assert list(imported(result)) == ["crate/patched/pose_02.jpg"]


def test_a_name_against_the_order_is_a_doubt_only_where_the_order_was_followed(space, folder):
    for i, name in enumerate(("pose_1.jpg", "pose_2.jpg", "pose_3.jpg", "pose_3_again.jpg")):
        take(folder / name, i, i)
    result = run(space, folder)
    assert set(imported(result).values()) == {"pose_1.jpg", "pose_2.jpg", "pose_3.jpg"}
    assert reasons(result) == {"pose_3_again.jpg": "its name says pose 3 and its order says pose 4"}
    others = folder.parent / "others"
    for i, pose in enumerate((4, 2, 1, 3)):  # named by a person, taken in any order
        take(others / f"pose_{pose}.jpg", 10 + i, i)
    result = run(space, others, ImportSettings(object="crate", variant="unpatched"))
    assert [record.pose_id for record in result.imported] == [4, 2, 1, 3] and not result.refused


def test_the_board_says_the_pose_and_by_how_much_it_was_missed(space, folder):
    board = Board({})
    for name, azimuth, minute in (("x.jpg", 273.0, 0), ("y.jpg", 87.0, 1), ("z.jpg", 181.5, 2)):
        take(folder / name, minute, minute)
        board.cameras[name] = camera(space, azimuth, closer=1.05)
    result = run(space, folder, board=board)
    assert imported(result) == {
        "crate/patched/pose_02.jpg": "y.jpg",
        "crate/patched/pose_03.jpg": "z.jpg",
        "crate/patched/pose_04.jpg": "x.jpg",
    }
    record = read_manifest(result.source_dir)["crate/patched/pose_03.jpg"]
    assert record.made["matched_by"] == "board" and record.made["board_corners"] == 9
    # a turn of 1.5° about the vertical at 40° of elevation is 1.5° · cos 40° between the directions
    assert record.made["pose_error_deg"] == pytest.approx(1.5 * np.cos(np.radians(40)), abs=0.01)
    plan = read_plan(space.plan_file).objects["crate"][2]
    gap = np.linalg.norm(camera(space, 181.5, closer=1.05)[:3, 3] - plan.matrix()[:3, 3])
    assert record.made["pose_error_mm"] == pytest.approx(gap, abs=0.05)
    np.testing.assert_allclose(record.T_world_camera, board.cameras["z.jpg"], atol=1e-6)
    assert record.intrinsics == LENS.intrinsics
    row = next(row for row in result.coverage if row.variant == "patched")
    assert row.missing == (1,) and 1 < row.mean_error_deg < 3
    assert json.loads((result.source_dir / "crate/patched/transforms.json").read_text())["frames"]


def test_the_board_between_two_poses_asks_the_order(space, folder):
    """45° is as near to pose 1 as to pose 2, and far from both: the order's word vouches only for near ones."""
    names = ["a.jpg", "b.jpg", "c.jpg", "d.jpg"]
    board = Board({name: camera(space, 90.0 * i) for i, name in enumerate(names)})
    for i, name in enumerate(names):
        take(folder / name, i, i)
    board.cameras["b.jpg"] = camera(space, 90.0 + 14)  # too far to stand alone, but the order says the same pose
    assert len(run(space, folder, board=board).imported) == 4
    lone = take(folder.parent / "lone" / "e.jpg", 9, 9)
    for azimuth, word in ((45.0, "ambiguous"), (14.0, "far from every pose")):
        board = Board({"e.jpg": camera(space, azimuth)})
        result = run(space, lone.parent, ImportSettings(object="crate", variant="unpatched"), board)
        assert not result.imported and word in reasons(result)["e.jpg"]


def test_the_board_against_the_order_is_a_doubt_only_where_the_order_was_followed(space, folder):
    names = ["a.jpg", "b.jpg", "c.jpg", "d.jpg"]
    for i, name in enumerate(names):
        take(folder / name, i, i)
    azimuths = [0.0, 90.0, 180.0, 90.0]  # the last one repeats pose 2 where the order says 4
    board = Board({name: camera(space, azimuth) for name, azimuth in zip(names, azimuths, strict=True)})
    result = run(space, folder, board=board)
    assert list(reasons(result)) == ["d.jpg"] and "its order says pose 4" in reasons(result)["d.jpg"]
    # walked round the other way: the order was never meant
    board = Board({name: camera(space, azimuth) for name, azimuth in zip(names, (270, 180, 90, 0), strict=True)})
    result = run(space, folder, ImportSettings(object="crate", variant="patched", source="other"), board)
    assert [record.pose_id for record in result.imported] == [4, 3, 2, 1] and not result.refused


def test_the_nearest_render_is_asked_last_and_only_when_sure(space, folder):
    asked = []

    def by_render(evidence, group):
        asked.append(evidence.candidate.label)
        if evidence.candidate.label == "a.jpg":
            return Decision(CaptureKey(*group, 2), "render")
        return Doubt("it looks like pose 1 and pose 3")

    take(folder / "a.jpg", 1), take(folder / "b.jpg", 2), take(folder / "pose_4.jpg", 3)
    result = run(space, folder, by_render=by_render)
    assert asked == ["a.jpg", "b.jpg"]
    assert {record.pose_id: record.made["matched_by"] for record in result.imported} == {2: "render", 4: "name"}
    assert reasons(result) == {"b.jpg": "it looks like pose 1 and pose 3"}


def test_one_photograph_of_a_pose_that_is_named(space, folder):
    photo = take(folder / "x.jpg", 1)
    result = run(space, photo, ImportSettings(object="crate", variant="patched", pose=3))
    assert list(imported(result)) == ["crate/patched/pose_03.jpg"]
    take(folder / "y.jpg", 2)
    with pytest.raises(ToolkitError, match="pose 3: is of a single photograph, 2 were given"):
        run(space, folder, ImportSettings(object="crate", variant="patched", pose=3))
    with pytest.raises(ToolkitError, match="has poses 1 to 4"):
        run(space, photo, ImportSettings(object="crate", variant="patched", pose=9))


# --- which object and variant ---------------------------------------------------------------------------------------


def shoot_list(space, folder, count=None):
    """A session that follows the shot list; returns its steps."""
    plan = read_plan(space.plan_file)
    steps = order_shots(plan, ["crate"], seed=3)
    write_shots(space.root / "rig" / "shots.json", list_shots(plan, steps, 3))
    for step in steps[:count]:
        take(folder / f"IMG_{step.number + 40}.jpg", step.number, step.number)
    return steps


def test_a_whole_session_follows_the_shot_list(space, folder):
    steps = shoot_list(space, folder)
    result = run(space, folder, ImportSettings())
    assert imported(result) == {
        f"crate/{step.variant}/pose_{step.pose_id:02d}.jpg": f"IMG_{step.number + 40}.jpg" for step in steps
    }
    assert {record.booster_sha256 for record in result.imported if record.variant == "unpatched"} == {None}


@pytest.mark.slow
def test_a_part_of_a_session_says_where_it_begins(space, folder):
    steps = shoot_list(space, folder, count=5)
    result = run(space, folder, ImportSettings())
    assert not result.imported and "give its first shot with --first-shot" in next(iter(reasons(result).values()))
    result = run(space, folder, ImportSettings(first_shot=1))
    assert len(result.imported) == 5
    for step in steps[5:]:
        take(folder / f"IMG_{step.number + 40}.jpg", step.number, step.number)
    result = run(space, folder, ImportSettings())  # the whole list now, the first five being there
    assert len(result.imported) == 3 and len(result.before) == 5 and not result.refused


def test_boards_that_do_not_follow_the_shot_list_stop_it(space, folder):
    steps = shoot_list(space, folder)
    wrong = {f"IMG_{step.number + 40}.jpg": camera(space, 90.0 * (step.pose_id % 4)) for step in steps}
    result = run(space, folder, ImportSettings(), Board(wrong))
    assert not result.imported and all("not taken in this order" in why for why in reasons(result).values())


def test_folders_and_names_say_the_object_and_variant(space, folder):
    for i in range(4):
        take(folder / "crate" / "unpatched" / f"DSC_{i}.jpg", i, i)
        take(folder / "crate" / "patched" / f"DSC_{i}.jpg", 10 + i, 10 + i)
    take(folder / "crate_grey-patch_pose_2.jpg", 30, 30)
    result = run(space, folder, ImportSettings())
    assert sorted(imported(result)) == sorted(
        [f"crate/{variant}/pose_{i:02d}.jpg" for variant in ("patched", "unpatched") for i in range(1, 5)]
        + ["crate/grey-patch/pose_02.jpg"]
    )


def test_a_folder_that_contradicts_the_command_is_not_imported(space, folder):
    take(folder / "unpatched" / "pose_1.jpg", 1)
    result = run(space, folder)
    assert reasons(result) == {
        "unpatched/pose_1.jpg": "its name or folder names the variant 'unpatched', the command 'patched'"
    }


def test_nothing_says_what_they_show(space, folder):
    take(folder / "a.jpg", 1)
    with pytest.raises(ToolkitError, match=r"give object and variant, .*toolkit plan --shot-list"):
        run(space, folder, ImportSettings())


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"object": "crat", "variant": "patched"}, "did you mean crate"),
        ({"object": "crate", "variant": "pached"}, "did you mean patched"),
        ({"object": "crate", "variant": "../../x"}, "expected a name of letters"),
        ({"match": "boards"}, "match boards: expected auto, board, name, order or render; did you mean board"),
        ({"source": "../x"}, "source ../x: expected the name of one folder below captures/"),
        ({"object": "crate", "pose": 1}, "pose 1: the pose of a photograph: give object and variant with it"),
        ({"object": "crate", "first_shot": 2}, "first_shot 2: counts in the whole shot list: leave object and variant"),
    ],
)
def test_settings_that_cannot_be_are_one_line(space, folder, settings, words):
    take(folder / "a.jpg", 1)
    with pytest.raises(ToolkitError, match=words):
        run(space, folder, ImportSettings(**settings))
    assert not (space.captures_dir / "real").exists()


def test_captures_are_not_imported_into_themselves(space, folder):
    (space.captures_dir / "real" / "crate" / "patched").mkdir(parents=True)
    for path in (space.captures_dir / "real", space.root, space.root.parent):
        with pytest.raises(ToolkitError, match="name the folder with the camera's photos"):
            run(space, path)
    with pytest.raises(ToolkitError, match="holds no photographs"):
        run(space, folder)
    with pytest.raises(ToolkitError, match="does not exist"):
        run(space, folder / "none")


def test_another_boosters_name_is_taken_with_a_note(space, folder):
    take(folder / "pose_1.jpg", 1)
    result = run(space, folder, ImportSettings(object="crate", variant="my-sticker"))
    assert list(imported(result)) == ["crate/my-sticker/pose_01.jpg"] and "my-sticker" in result.notes[0]


@pytest.mark.slow
def test_real_boards_are_found_and_measured(space, folder, make_box):
    """The rig's photographs of the crate on the printed board, as a phone stores them; its cameras are known."""
    from board_photos import focal_35mm, photograph, save_photo

    from toolkit.rig.board import DEFAULT_BOARD
    from toolkit.rooms.photos.locate import match_pose

    lens, crate = Camera.from_fov(640, 480, 62.0), make_box()
    poses = read_plan(space.plan_file).objects["crate"]
    truth = {}
    for i, (name, orientation) in enumerate((("a.heic", 6), ("b.jpg", 8), ("c.jpg", 1))):
        pose = poses[2 - i]  # against the plan's order
        target = np.add(pose.target_mm, (3.0, -2.0, 1.0))
        T = orbit_pose(target, pose.azimuth_deg + 2, pose.elevation_deg - 1.5, pose.distance_mm * 1.03, 1.0)
        pixels = photograph(crate, DEFAULT_BOARD, lens, T, px_per_mm=2.5)
        save_photo(folder / name, pixels, focal_35mm_mm=focal_35mm(lens), orientation=orientation)
        truth[pose.id] = T
    result = import_photos(space, [folder], ImportSettings(object="crate", variant="unpatched"))
    assert not result.refused and [record.pose_id for record in result.imported] == [3, 2, 1]
    for record in result.imported:
        T = np.array(record.T_world_camera)
        exact = match_pose(truth[record.pose_id], poses)
        distance = np.linalg.norm(truth[record.pose_id][:3, 3])
        # a focal length that EXIF rounds to a whole millimetre is good to about 2 % of the distance
        assert np.linalg.norm(T[:3, 3] - truth[record.pose_id][:3, 3]) < 0.03 * distance
        assert record.made["pose_error_deg"] == pytest.approx(exact.error_deg, abs=0.7)
        assert record.made["lens"] == "exif" and record.made["reprojection_px"] < 1
        assert record.intrinsics["width"] == 640 and record.intrinsics["height"] == 480


@pytest.mark.slow
def test_a_render_that_looks_the_same_from_two_sides_is_no_answer(space, folder, make_box, monkeypatch):
    """The crate is the same after half a turn, so poses 1 and 3 cannot be told apart, and 2 and 4 are not meant."""
    from board_photos import photograph, save_photo

    monkeypatch.setattr(RenderMatcher, "rank", RANK)
    pose = read_plan(space.plan_file).objects["crate"][0]
    pixels = photograph(make_box(), None, Camera.from_fov(320, 240, 45.0), pose.matrix(), backdrop="concrete")
    save_photo(folder / "IMG_7.jpg", pixels)
    result = import_photos(space, [folder], ImportSettings(object="crate", variant="unpatched"))
    assert not result.imported
    assert re.search(r"no board is seen, and it looks .* pose [13] .* pose [13] ", reasons(result)["IMG_7.jpg"])
    sure = import_photos(space, [folder], ImportSettings(object="crate", variant="unpatched", match="board"))
    assert reasons(sure) == {"IMG_7.jpg": "no board is seen"}


# --- the order, compared with renders -------------------------------------------------------------------------------


def rank_as(shows: dict[str, int], count: int = 4, right: float = 0.8, wrong: float = 0.4):
    """Likeness to renders of photographs that show these poses; of others it is too small to say anything."""

    def rank(matcher, evidence, group):
        shown = shows.get(evidence.candidate.label)
        scores = {pose: wrong for pose in range(1, count + 1)} | ({} if shown is None else {shown: right})
        ranking = sorted(scores.items(), key=lambda one: -one[1]) if shown else [(pose, 0.1) for pose in scores]
        return RenderMatch(tuple(ranking))

    return rank


def test_photographs_that_changed_places_are_told_by_their_renders(space, folder, monkeypatch):
    """Two of ten are exchanged: they are doubts, and the others keep their order."""
    pattern = Pattern(name="ring", count=10)
    write_plan(space.plan_file, make_plan([load_object(space.object_spec("crate"))], Camera.from_fov(96, 72), pattern))
    shows = dict(zip("abcdefghij", (1, 3, 2, 4, 5, 6, 7, 8, 9, 10), strict=True))
    for number, name in enumerate(shows):
        take(folder / f"{name}.jpg", number, number)
    likeness = {f"{name}.jpg": pose for name, pose in shows.items() if name != "h"}
    monkeypatch.setattr(RenderMatcher, "rank", rank_as(likeness, 10))
    result = run(space, folder)
    assert reasons(result) == {
        "b.jpg": "its order says pose 2 and its likeness to the renders says pose 3",
        "c.jpg": "its order says pose 3 and its likeness to the renders says pose 2",
    }
    assert {record.pose_id for record in result.imported} == {1, 4, 5, 6, 7, 8, 9, 10}
    assert any("1 of 8 photographs are placed by their order alone" in note for note in result.notes), "h is like none"
    # asked for, the order decides, and what speaks against it is said
    result = run(space, folder, ImportSettings(object="crate", variant="patched", match="order", source="other"))
    assert len(result.imported) == 10 and any(
        note.startswith("2 of 10 photographs look like another pose than that of their order (b.jpg: pose 3, not 2)")
        for note in result.notes
    )


def test_an_order_that_most_renders_contradict_is_not_believed(space, folder, monkeypatch):
    """Each then goes where its render says."""
    shows = {"a.jpg": 2, "b.jpg": 1, "c.jpg": 4, "d.jpg": 3}
    for number, name in enumerate(shows):
        take(folder / name, number, number)
    monkeypatch.setattr(RenderMatcher, "rank", rank_as(shows))
    result = run(space, folder)
    assert {record.made["original_name"]: record.pose_id for record in result.imported} == shows
    assert {record.made["matched_by"] for record in result.imported} == {"render"}


def test_a_likeness_that_is_ahead_by_chance_changes_no_order(space, folder, monkeypatch):
    for number, name in enumerate("abcd"):
        take(folder / f"{name}.jpg", number, number)
    alike = rank_as({"a.jpg": 2, "b.jpg": 1, "c.jpg": 3, "d.jpg": 4}, right=0.64, wrong=0.6)
    monkeypatch.setattr(RenderMatcher, "rank", alike)
    result = run(space, folder)
    assert [record.pose_id for record in result.imported] == [1, 2, 3, 4] and not result.refused


def test_a_name_that_was_taken_comes_after_it_and_ties_are_said(space, folder):
    """An app that names photographs by the second adds (1) to the second one; their times are the same."""
    names = ["IMG_31.jpg", "IMG_31 (1).jpg", "IMG_32.jpg", "IMG_34.jpg"]
    for number, name in enumerate(names):
        take(folder / name, number, (0, 0, 1, 2)[number])
    result = run(space, folder)
    assert list(imported(result).values()) == names
    assert "taken at the same time, and so ordered by name: IMG_31.jpg, IMG_31 (1).jpg" in result.notes


def test_each_shot_saved_twice_counts_once_in_the_order(space, folder):
    for number in range(2):
        file = take(folder / f"IMG_{number}.jpg", number, number, quality=95)
        Image.open(file).save(folder / f"IMG_{number}.png")
        Image.open(file).save(folder / f"IMG_{number} copy.jpg", quality=100, subsampling=0)
    result = run(space, folder, ImportSettings(object="crate", variant="patched", match="order"))
    assert not result.imported and "2 photographs for the 4 poses" in reasons(result)["IMG_0.jpg"]
    assert {label for label, _ in result.duplicates} == {
        f"IMG_{number}{rest}" for number in range(2) for rest in (".png", " copy.jpg")
    }


def test_a_photograph_keeps_the_pose_of_the_plan_it_was_imported_by(space, folder):
    """After the plan changed, the same numbers mean other places: each says its own, and the run says so."""
    plan = read_plan(space.plan_file)
    take(folder / "a" / "pose_1.jpg", 1), take(folder / "a" / "pose_2.jpg", 2)
    first = run(space, folder / "a", ImportSettings(object="crate", variant="unpatched"))
    poses = plan.objects["crate"]
    assert [one.made["pose_sha256"] for one in first.imported] == [hash_pose(plan.camera, one) for one in poses[:2]]
    pattern = Pattern(name="ring", count=4, elevation_deg=(20, 20))
    write_plan(space.plan_file, make_plan([load_object(space.object_spec("crate"))], plan.camera, pattern))
    take(folder / "b" / "pose_1.jpg", 3), take(folder / "b" / "pose_2.jpg", 4)
    second = run(space, folder / "b")
    hashes = {one.made["pose_sha256"] for one in (*first.imported, *second.imported)}
    assert len(hashes) == 4
    assert any(note.startswith("crate/unpatched: 2 photographs are of another plan") for note in second.notes)
