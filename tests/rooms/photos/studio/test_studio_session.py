import json

import pytest

from toolkit.captures.manifest import read_manifest
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.objects.load import load_object
from toolkit.rig import Pattern
from toolkit.rig.camera import Camera
from toolkit.rig.plan import make_plan, write_plan
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.importing.gather import REPLACED
from toolkit.rooms.photos.importing.import_photos import import_photos
from toolkit.rooms.photos.shot_order import list_shots, order_shots, write_shots
from toolkit.rooms.photos.studio.session import open_session


def poses_of(desk):
    return [(step.object, step.variant, step.pose_id) for step in desk.session.shots.steps]


def file_of(desk, number, suffix=".jpg"):
    name, variant, pose = poses_of(desk)[number - 1]
    return desk.session.source_dir / name / variant / f"pose_{pose:02d}{suffix}"


def test_a_kept_photograph_is_what_an_import_makes_of_it(desk, photo, tmp_path, make_crate_space):
    assert desk.send_and_keep(2, photo()).status_code == 200
    file = file_of(desk, 2)
    assert file.read_bytes() == photo() and desk.statuses() == ["open", "done", "open", "open"]

    other = make_crate_space(tmp_path / "other")
    original = tmp_path / "IMG_1.jpg"
    original.write_bytes(photo())
    name, variant, pose = poses_of(desk)[1]
    settings = ImportSettings(object=name, variant=variant, pose=pose)
    import_photos(other, [original], settings, locate=lambda *_: "no board is seen")
    (mine,) = read_manifest(desk.session.source_dir).values()
    (theirs,) = read_manifest(other.captures_dir / "real").values()
    assert mine.made.pop("gates") == {"brightness": pytest.approx(128, abs=3)}
    assert mine.made.pop("original_name") != theirs.made.pop("original_name")
    assert mine == theirs and len(mine.made["pose_sha256"]) == 64
    assert len(list(desk.session.source_dir.glob("crate/*/transforms.json"))) == 1


def test_a_photograph_of_an_older_plan_is_no_shot_of_this_one(desk, photo, reopen):
    desk.send_and_keep(2, photo())
    # the same numbers, and other places
    item = load_object(desk.space.object_spec("crate"))
    pattern = Pattern(name="ring", count=2, elevation_deg=(20, 20))
    plan = make_plan([item], Camera.from_fov(96, 72), pattern)
    write_plan(desk.space.plan_file, plan)
    write_shots(desk.space.root / "rig/shots.json", list_shots(plan, order_shots(plan, ["crate"])))
    assert reopen().statuses() == ["open"] * 4


def test_the_import_knows_what_the_studio_kept(desk, photo, tmp_path):
    desk.send_and_keep(1, photo())
    (tmp_path / "IMG_1.jpg").write_bytes(photo())
    name, variant, pose = poses_of(desk)[0]
    settings = ImportSettings(object=name, variant=variant, pose=pose)
    result = import_photos(desk.space, [tmp_path / "IMG_1.jpg"], settings, locate=lambda *_: "none")
    assert not result.imported and "imported before" in result.before[0][1]


def test_a_restart_in_the_middle_finds_everything_as_it_was(desk, reopen, photo):
    desk.send_and_keep(1, photo(1))
    waiting = desk.send(2, photo(2)).json()
    desk.client.post("/api/shots/3/skip")
    again = reopen()
    assert again.statuses() == ["done", "waiting", "skipped", "open"]
    state = again.client.get("/api/state").json()
    assert (state["done"], state["next"]) == (1, 2)
    verdict = again.client.get("/api/shots/2/verdict").json()
    assert verdict == {key: waiting[key] for key in verdict}
    assert again.keep(2, waiting["sha256"]).status_code == 200
    assert again.statuses() == ["done", "done", "skipped", "open"] and file_of(again, 2).read_bytes() == photo(2)


def test_a_lost_answer_may_be_asked_for_again(desk, photo):
    sha256 = desk.send(1, photo()).json()["sha256"]
    assert desk.keep(1, sha256).status_code == desk.keep(1, sha256).status_code == 200
    assert desk.send(1, photo()).json() == {"there": True}
    assert desk.statuses()[0] == "done" and len(read_manifest(desk.session.source_dir)) == 1


def test_a_kill_between_keeping_and_clearing_up_is_no_retake(desk, photo, reopen):
    desk.send(1, photo())
    waiting = desk.session.folders.find_waiting(desk.session.find_step(1))
    content, name = waiting.read_bytes(), waiting.name
    desk.keep(1, sha256_bytes(content))
    waiting.parent.mkdir(parents=True, exist_ok=True)
    (waiting.parent / name).write_bytes(content)
    assert reopen().statuses()[0] == "done"


def test_one_photograph_cannot_be_two_shots(desk, photo):
    desk.send_and_keep(1, photo())
    answer = desk.send(2, photo())
    assert answer.status_code == 409 and "stored already, as crate" in answer.json()["error"]
    assert desk.statuses() == ["done", "open", "open", "open"]


def test_only_the_photograph_that_was_looked_at_is_kept(desk, photo):
    first = desk.send(1, photo(1)).json()["sha256"]
    second = desk.send(1, photo(2)).json()["sha256"]
    assert desk.keep(1, first).status_code == 409 and desk.statuses()[0] == "waiting"
    assert desk.keep(1, second).status_code == 200 and file_of(desk, 1).read_bytes() == photo(2)


def test_a_retake_keeps_the_old_one_aside_and_undo_brings_it_back(desk, photo):
    desk.send_and_keep(1, photo(1, "PNG"))
    desk.send_and_keep(1, photo(2))
    aside = list((desk.session.source_dir / REPLACED).rglob("*.png"))
    assert [file.read_bytes() for file in aside] == [photo(1, "PNG")]
    assert file_of(desk, 1).read_bytes() == photo(2) and not file_of(desk, 1, ".png").exists()

    answer = desk.client.post("/api/shots/1/undo").json()
    assert answer["shot"]["status"] == "waiting" and answer["shot"]["there"]
    assert file_of(desk, 1, ".png").read_bytes() == photo(1, "PNG") and not file_of(desk, 1).exists()
    (record,) = read_manifest(desk.session.source_dir).values()
    assert record.image_sha256 == sha256_bytes(photo(1, "PNG")) and record.path.endswith(".png")
    assert desk.keep(1, sha256_bytes(photo(2))).status_code == 200  # and the undoing is undone
    assert file_of(desk, 1).read_bytes() == photo(2) and desk.statuses()[0] == "done"


def test_undo_of_a_first_photograph_lets_it_wait_again(desk, photo):
    desk.send_and_keep(1, photo())
    assert desk.client.post("/api/shots/1/undo").json()["shot"]["status"] == "waiting"
    assert not file_of(desk, 1).exists() and read_manifest(desk.session.source_dir) == {}
    assert desk.client.post("/api/shots/1/discard").json()["shot"]["status"] == "open"
    assert desk.client.post("/api/shots/1/undo").status_code == 409


def test_a_photograph_put_there_by_hand_counts_and_is_not_taken_away(desk, photo):
    file = file_of(desk, 3)
    file.parent.mkdir(parents=True)
    file.write_bytes(photo())
    assert desk.statuses() == ["open", "open", "done", "open"]
    answer = desk.client.post("/api/shots/3/undo")
    assert answer.status_code == 409 and "by hand" in answer.json()["error"] and file.exists()


def test_a_photograph_that_is_kept_against_advice_is_on_the_retake_list(desk, photo):
    desk.send_and_keep(1, photo(level=20))
    name, variant, pose = poses_of(desk)[0]
    lines = (desk.session.source_dir / "retake.txt").read_text().splitlines()
    assert lines[0].startswith(f"{name}/{variant} pose {pose}: brightness 2") and "-> use more light" in lines[0]
    assert desk.client.get("/api/shots/1").json()["advice"] == ["brightness: use more light"]
    for number in range(1, 5):
        desk.send_and_keep(number, photo(4 + number))
    assert not (desk.session.source_dir / "retake.txt").exists()


def test_the_studio_and_check_write_one_list(desk, photo):
    """In the order of the walk; each variant has begun, one pose is missing in the one and bad in the other."""
    bad, missing = 2, 3
    for number in {1, 2, 3, 4} - {missing}:
        desk.send_and_keep(number, photo(number, level=20 if number == bad else 128))
    said = [line.partition(":")[0] for line in (desk.session.source_dir / "retake.txt").read_text().splitlines()]
    assert said == [f"{name}/{variant} pose {pose}" for name, variant, pose in poses_of(desk)[1:3]]
    assert desk.client.get("/api/state").json()["first"] == bad


def test_skipped_shots_come_last(desk, photo):
    desk.client.post("/api/shots/1/skip")
    assert desk.client.get("/api/state").json()["next"] == 2
    for number in (2, 3, 4):
        desk.send_and_keep(number, photo(number))
    assert desk.client.get("/api/state").json()["next"] == 1
    desk.send_and_keep(1, photo(1))
    assert desk.statuses() == ["done"] * 4 and desk.client.get("/api/state").json()["next"] is None
    desk.client.post("/api/shots/1/undo")
    desk.client.post("/api/shots/1/discard")
    assert desk.statuses()[0] == "open"  # it was taken, so it is not put off any more


def test_pictures_are_made_anew_from_the_pixels(desk, photo):
    desk.send(1, photo(kind="PNG"))
    answer = desk.client.get("/api/shots/1/waiting.jpg")
    assert answer.headers["content-type"] == "image/jpeg" and answer.content.startswith(b"\xff\xd8")
    assert desk.client.get("/api/shots/1/photo.jpg").status_code == 404


def test_the_page_says_what_changes_before_a_shot(desk):
    changes = [desk.client.get(f"/api/shots/{number}").json()["change"] for number in (1, 2, 3, 4)]
    variants = [variant for _, variant, _ in poses_of(desk)]
    assert variants == ["unpatched", "patched", "patched", "unpatched"]
    assert changes == [
        "put the crate on the board's middle, its front to FRONT", "stick the patch on", "", "take the patch off",
    ]  # fmt: skip
    spec = desk.space.object_spec("crate")
    alone = spec.read_text().partition("[patch]")[0]
    spec.write_text(alone + '[[patch]]\nat = "top"\nsize_mm = 20\n[[patch]]\nat = "left"\nsize_mm = 20\n')
    assert desk.client.get("/api/shots/2").json()["change"] == "stick the 2 sheets of the patch on"


@pytest.mark.parametrize("missing", ["plan.json", "shots.json"])
def test_what_is_missing_is_said_with_its_command(shot_space, missing):
    (shot_space.root / "rig" / missing).unlink()
    with pytest.raises(ToolkitError, match=rf"{missing}.*toolkit plan --shot-list"):
        open_session(shot_space)


def test_a_list_of_another_plan_is_refused(shot_space):
    plan = json.loads(shot_space.plan_file.read_text())
    plan["camera"]["width"] = 128
    shot_space.plan_file.write_text(json.dumps(plan))
    with pytest.raises(ToolkitError, match="changed since"):
        open_session(shot_space)
