"""Importing takes no photograph twice, loses none, and says what it could not use."""

import re
import shutil
from datetime import datetime, timedelta, timezone
from pathlib import Path

import import_bench
import numpy as np
import pytest
from import_bench import PATCHED, Board, camera, imported, reasons, run, take
from PIL import Image

from toolkit.captures.manifest import MANIFEST, read_manifest
from toolkit.captures.read import read_captures
from toolkit.core.files import sha256_file
from toolkit.objects.spec import read_spec
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.gates import Gate
from toolkit.rooms.photos.gates.check_photo import ExpectationBuilder
from toolkit.rooms.photos.importing.gather import REPLACED, Candidate, sort_by_time
from toolkit.rooms.photos.photo import Photo

space, folder = import_bench.space, import_bench.folder


# --- not twice, not lost --------------------------------------------------------------------------------------------


def test_the_same_photograph_is_not_taken_twice(space, folder):
    take(folder / "pose_1.jpg", 1)
    shutil.copy(folder / "pose_1.jpg", folder / "pose_2 (1).jpg")
    result = run(space, folder)
    assert list(imported(result)) == ["crate/patched/pose_01.jpg"]
    assert result.duplicates == (("pose_2 (1).jpg", "the same photograph as pose_1.jpg"),)
    moved = folder.parent / "moved"
    moved.mkdir()
    (folder / "pose_1.jpg").rename(moved / "pose_4.jpg")
    for settings in (PATCHED, ImportSettings(object="crate", variant="unpatched")):
        result = run(space, moved, settings)
        assert not result.imported and not result.refused
        assert result.before == (("pose_4.jpg", "imported before, as crate/patched/pose_01.jpg"),)


def test_raw_and_film_beside_a_photograph_are_one_shot(space, folder):
    import cv2

    take(folder / "pose_1.heic", 1, 1)
    take(folder / "pose_1.jpg", 2, 1)
    writer = cv2.VideoWriter(str(folder / "pose_1.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 30, (64, 48))
    for _ in range(30):
        writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    result = run(space, folder)
    assert imported(result) == {"crate/patched/pose_01.heic": "pose_1.heic"}
    assert dict(result.duplicates) == {
        "pose_1.jpg": "the same shot as pose_1.heic, in another format",
        "pose_1.mp4": "the film of the live photo pose_1.heic",
    }


def test_two_photographs_of_a_pose_are_both_left_out(space, folder):
    take(folder / "pose_1.jpg", 1, 1), take(folder / "pose_1b_pose_1.jpg", 2, 2), take(folder / "pose_2.jpg", 3, 3)
    result = run(space, folder)
    assert list(imported(result)) == ["crate/patched/pose_02.jpg"]
    assert len(result.refused) == 2 and all("shown as well by" in why for why in reasons(result).values())


def test_a_retake_waits_for_the_word_and_the_old_one_is_kept(space, folder):
    take(folder / "pose_1.jpg", 1, 1)
    run(space, folder)
    old = (folder / "pose_1.jpg").read_bytes()
    again = take(folder.parent / "again" / "pose_1.png", 2, 5)
    result = run(space, again)
    assert not result.imported and "crate/patched/pose_01.jpg (from pose_1.jpg)" in reasons(result)["pose_1.png"]
    result = run(space, again, ImportSettings(object="crate", variant="patched", replace=True))
    place = result.source_dir / "crate" / "patched"
    assert [file.name for file in place.glob("pose_*")] == ["pose_01.png"]
    assert list(read_manifest(result.source_dir)) == ["crate/patched/pose_01.png"]
    (kept,) = (result.source_dir / REPLACED).rglob("*.jpg")
    assert kept.read_bytes() == old
    # neither comes back, and what an older one would replace stays
    for settings in (PATCHED, ImportSettings(object="crate", variant="patched", replace=True)):
        result = run(space, [folder, again.parent], settings)
        assert not result.imported and not result.refused and len(result.before) == 2
    older = take(folder.parent / "older" / "pose_1.jpg", 3, 0)
    result = run(space, older, ImportSettings(object="crate", variant="patched", replace=True))
    assert "has the later photograph" in reasons(result)["pose_1.jpg"]
    assert len(read_captures(space.captures_dir).captures) == 1


def test_a_retake_in_the_hour_that_comes_twice_is_the_later(space, folder):
    """Summer time ended between the two: 10:50 +02:00 is 08:50 UTC, 10:10 +01:00 is 09:10 UTC."""
    take(folder / "pose_1.jpg", 1, 50, "+02:00")
    run(space, folder)
    again = take(folder.parent / "again" / "pose_1.jpg", 2, 10, "+01:00")
    result = run(space, again, ImportSettings(object="crate", variant="patched", replace=True))
    assert len(result.imported) == 1 and not result.refused
    # and the earlier does not come back
    early = take(folder.parent / "early" / "pose_1.jpg", 3, 55, "+02:00")
    result = run(space, early, ImportSettings(object="crate", variant="patched", replace=True))
    assert "has the later photograph" in reasons(result)["pose_1.jpg"]


def test_photographs_of_equal_clocks_and_other_offsets_are_no_tie(space, folder):
    for number, (minute, offset) in enumerate([(0, "+02:00"), (0, "+01:00"), (60, "+02:00"), (90, "+01:00")]):
        take(folder / f"{'badc'[number]}.jpg", number, minute, offset)
    result = run(space, folder)
    # b at 8:00 UTC; a and d both at 9:00, a tie; c at 10:30
    assert list(imported(result).values()) == ["b.jpg", "a.jpg", "d.jpg", "c.jpg"]
    assert [note for note in result.notes if "same time" in note] == [
        "taken at the same time, and so ordered by name: a.jpg, d.jpg"
    ]


def test_a_film_in_utc_is_not_sorted_among_local_times():
    """A film at 9:00 UTC may have been shot after a photograph at 10:00 of a clock two hours ahead."""
    film = Photo(Path("b.mp4"), "f" * 64, "video", 4, 3, taken=datetime(2024, 5, 1, 9, tzinfo=timezone.utc))
    for offset, expected in ((None, False), (timezone(timedelta(hours=2)), True)):
        taken = datetime(2024, 5, 1, 10, tzinfo=offset)
        still = Photo(Path("c.jpg"), "a" * 64, "jpeg", 4, 3, taken=taken)
        ordered, by_time = sort_by_time([Candidate(photo, photo.path.name, ()) for photo in (film, still)])
        assert by_time == expected
        assert [own.label for own in ordered] == (["c.jpg", "b.mp4"] if expected else ["b.mp4", "c.jpg"])


def test_with_replace_the_latest_of_several_counts(space, folder):
    for minute, name in ((3, "pose_1_a.jpg"), (9, "pose_1_c.jpg"), (5, "pose_1_b.jpg")):
        take(folder / name, minute, minute)
    for _ in range(2):  # and again it is so
        result = run(space, folder, ImportSettings(object="crate", variant="patched", replace=True))
        assert read_manifest(result.source_dir)["crate/patched/pose_01.jpg"].made["original_name"] == "pose_1_c.jpg"
        assert len(list((result.source_dir / REPLACED).rglob("*.jpg"))) == 2
    assert not result.imported and len(result.before) == 3


def test_an_image_that_was_put_there_by_hand_is_not_overwritten(space, folder):
    hand = space.captures_dir / "real" / "crate" / "patched" / "1.jpg"
    take(hand, 5)
    content = hand.read_bytes()
    take(folder / "pose_1.jpg", 1)
    result = run(space, folder)
    assert not result.imported and "pose 1 has crate/patched/1.jpg" in reasons(result)["pose_1.jpg"]
    result = run(space, folder, ImportSettings(object="crate", variant="patched", replace=True))
    assert [file.name for file in hand.parent.iterdir() if file.suffix != ".json"] == ["pose_01.jpg"]
    (kept,) = (result.source_dir / REPLACED).rglob("*.jpg")
    assert kept.read_bytes() == content


def test_a_deleted_image_is_imported_again(space, folder):
    take(folder / "pose_1.jpg", 1)
    result = run(space, folder)
    (result.source_dir / "crate/patched/pose_01.jpg").unlink()
    assert len(run(space, folder).imported) == 1


@pytest.mark.parametrize("replace", [False, True])
def test_a_kill_at_any_write_loses_nothing(space, folder, monkeypatch, replace):
    """Every write fails once, at each place in turn; the same command then ends where an undisturbed one does."""
    from toolkit.rooms.photos.importing import gather as index_module
    from toolkit.rooms.photos.importing import store as store_module

    class Killed(BaseException):
        pass

    settings = ImportSettings(object="crate", variant="patched", replace=replace, match="name")
    take(folder / "pose_1.jpg", 1, 1), take(folder / "pose_2.png", 2, 2)
    source = space.captures_dir / "real"
    originals = {sha256_file(file) for file in folder.iterdir()}
    if replace:
        first = [take(folder.parent / "first" / f"pose_{i}.jpg", 10 + i, -i) for i in (1, 2)]
        run(space, first[0].parent)
        originals |= {sha256_file(file) for file in first}
        shutil.copytree(source, folder.parent / "start")
    names = ((store_module, "write_bytes"), (store_module, "append_record"), (index_module, "write_text"))
    real = {name: getattr(module, name) for module, name in names}
    for nth in range(20):
        shutil.rmtree(source, ignore_errors=True)
        if replace:
            shutil.copytree(folder.parent / "start", source)
        calls = []

        def dying(name, *arguments, nth=nth, calls=calls):
            calls.append(name)
            if len(calls) == nth + 1:
                raise Killed
            return real[name](*arguments)

        for module, name in names:
            monkeypatch.setattr(module, name, lambda *a, name=name, dying=dying: dying(name, *a))
        finished = True
        try:
            run(space, folder, settings)
        except Killed:
            finished = False
        for module, name in names:
            monkeypatch.setattr(module, name, real[name])
        result = run(space, folder, settings)
        assert not result.refused
        assert {record.made["original_name"] for record in read_manifest(source).values()} == {
            "pose_1.jpg",
            "pose_2.png",
        }
        there = {file.name for file in (source / "crate/patched").iterdir()} - {"transforms.json"}
        assert there == {"pose_01.jpg", "pose_02.png"}
        files = [file for file in source.rglob("*") if file.suffix in (".jpg", ".png")]
        assert {sha256_file(file) for file in files} == originals
        for path, record in read_manifest(source).items():
            assert sha256_file(source / path) == record.image_sha256
        if finished:
            break
    assert finished and nth >= (6 if replace else 4)


def test_links_share_the_file_and_leave_it_whole(space, folder):
    take(folder / "pose_1.jpg", 1), take(folder / "pose_2.jpg", 2)
    result = run(space, folder, ImportSettings(object="crate", variant="patched", link=True))
    for i in (1, 2):
        assert (result.source_dir / f"crate/patched/pose_{i:02d}.jpg").samefile(folder / f"pose_{i}.jpg")
    (result.source_dir / MANIFEST).unlink()  # again over links that are there already
    again = run(space, folder, ImportSettings(object="crate", variant="patched", link=True))
    assert len(again.imported) == 2
    assert len(list((result.source_dir / "crate/patched").glob("*.jpg"))) == 2
    assert len(read_captures(space.captures_dir).captures) == 2


# --- raw and video --------------------------------------------------------------------------------------------------


def test_a_preview_and_a_frame_become_photographs_with_their_origin(space, folder):
    from test_photos import hold, jpeg, make_dng, move, scene, write_video

    (folder / "pose_2.dng").write_bytes(make_dng([jpeg(scene())], orientation=6))
    clip = write_video(folder / "clip.mp4", [hold(0, 20), move(0, 300, 12), hold(300, 20)])
    board = Board({"clip.mp4": camera(space, 0.0)})
    result = run(space, folder, board=board)
    record = read_manifest(result.source_dir)["crate/patched/pose_02.jpg"]
    assert record.made["how"] == "preview of a raw photograph"
    assert record.made["original_sha256"] == sha256_file(folder / "pose_2.dng") != record.image_sha256
    with Image.open(result.source_dir / record.path) as image:
        assert image.format == "JPEG" and image.getexif()[0x0112] == 6
    # both frames show pose 1, so neither is taken
    assert len(result.refused) == 2 and all("frame" in name for name in reasons(result))
    result = run(space, clip, ImportSettings(object="crate", variant="patched", replace=True), board)
    record = read_manifest(result.source_dir)["crate/patched/pose_01.jpg"]
    assert record.made["how"] == "frame of a video" and record.made["original_sha256"] == sha256_file(clip)
    assert 32 <= record.made["frame"] < 52
    again = run(space, clip, ImportSettings(object="crate", variant="patched", replace=True), board)
    assert not again.imported and len(again.before) == 2


# --- what is broken, hostile or asked -------------------------------------------------------------------------------


def test_bad_files_are_listed_and_the_good_part_is_done(space, folder):
    take(folder / "pose_1.jpg", 1)
    whole = take(folder / "pose_2.jpg", 2, quality=95)
    whole.write_bytes(whole.read_bytes()[:-600])
    (folder / "pose_3.jpg").write_bytes(b"")
    (folder / "pose_4.jpg").write_text("not an image")
    strange = "pose_3 \u2028\n\x1b[31m ü.jpg"
    take(folder / strange, 4)
    outside = take(folder.parent / "secret.jpg", 5)
    (folder / "link.jpg").symlink_to(outside)
    (folder / "notes.txt").write_text("x")
    result = run(space, folder)
    assert imported(result) == {"crate/patched/pose_01.jpg": "pose_1.jpg", "crate/patched/pose_03.jpg": strange}
    why = reasons(result)
    assert set(why) == {"pose_2.jpg", "pose_3.jpg", "pose_4.jpg", "link.jpg"}
    assert "truncated" in why["pose_2.jpg"] and "empty" in why["pose_3.jpg"] and "leaves the folder" in why["link.jpg"]
    assert any("notes.txt" in note for note in result.notes)
    assert len((result.source_dir / MANIFEST).read_text().split("\n")) == 3


def test_a_broken_photograph_keeps_its_place_in_the_order(space, folder):
    for i in range(4):
        take(folder / f"IMG_{i + 20}.jpg", i, i, quality=95)
    broken = folder / "IMG_21.jpg"
    broken.write_bytes(broken.read_bytes()[:-600])
    result = run(space, folder)
    assert [record.pose_id for record in result.imported] == [1, 3, 4] and list(reasons(result)) == ["IMG_21.jpg"]


def test_doubts_are_asked_where_somebody_answers(space, folder):
    asked = []

    def ask(question, answers):
        asked.append((question, tuple(answers)))
        return {"a.jpg": "3", "b.jpg": None}.get(question.split(":")[0], "2")

    take(folder / "a.jpg", 1), take(folder / "b.jpg", 2)
    result = run(space, folder, ask=ask)
    assert imported(result) == {"crate/patched/pose_03.jpg": "a.jpg"} and list(reasons(result)) == ["b.jpg"]
    assert result.imported[0].made["matched_by"] == "user"
    assert asked[0][1] == ("1", "2", "3", "4") and "Which pose of crate/patched" in asked[0][0]
    twice = folder.parent / "twice"
    take(twice / "pose_1_a.jpg", 3, 1), take(twice / "pose_1_b.jpg", 4, 2)
    result = run(space, twice, ask=ask)
    assert imported(result) == {"crate/patched/pose_01.jpg": "pose_1_b.jpg"}
    assert reasons(result)["pose_1_a.jpg"] == "crate/patched pose 1: pose_1_b.jpg was chosen"
    take(folder.parent / "third" / "pose_1.jpg", 5, 9)
    result = run(space, folder.parent / "third", ask=lambda question, answers: "y")
    assert len(result.imported) == 1 and len(list((result.source_dir / REPLACED).rglob("*.jpg"))) == 1


def test_what_the_gates_say_is_kept_with_each_photograph(space, folder):
    blur = Gate("blur", 4.0, "px", "hold still", at_most=False)
    exposure = Gate("exposure", 0.7, "", "less light")
    hidden = Gate("patch", 1.0, "", "move your hand")

    def check(photo, pixels, record):
        assert pixels.shape == (36, 48, 3) and record.pose_id in (1, 2)
        sharp = record.pose_id == 1 or "again" in str(photo.path)
        return [blur.judge(5.0 if sharp else 3.5), exposure.judge(0.5), hidden.skip("no patch")]

    take(folder / "pose_1.jpg", 1, 1), take(folder / "pose_2.jpg", 2, 2)
    result = run(space, folder, check=check)
    assert read_manifest(result.source_dir)["crate/patched/pose_02.jpg"].made["retake"] == ["blur: hold still"]
    assert read_manifest(result.source_dir)["crate/patched/pose_01.jpg"].made["gates"] == {
        "blur": 5.0,
        "exposure": 0.5,
        "patch": None,
    }
    again = take(folder.parent / "again" / "pose_2.jpg", 3, 3)
    result = run(space, again, ImportSettings(object="crate", variant="patched", replace=True), check=check)
    assert "retake" not in read_manifest(result.source_dir)["crate/patched/pose_02.jpg"].made


def test_a_board_that_gives_no_pose_is_not_called_unseen_by_the_gates(space, folder):
    """Without a lens the board's corners say nothing: to print another board would be the wrong advice."""
    take(folder / "pose_1.jpg", 1)
    why = "a board is seen, but the lens is not known: no lens is calibrated"
    (record,) = run(space, folder, board=lambda *_: why).imported
    assert ExpectationBuilder(space).expect_record(record).no_pose == why
    take(folder / "pose_2.jpg", 2)
    (record,) = run(space, folder).imported
    assert ExpectationBuilder(space).expect_record(record).no_pose == "no board is seen"


# --- what it shows ---------------------------------------------------------------------------------------------------


def test_a_photograph_keeps_the_class_and_the_sheet_that_it_was_imported_with(space, folder):
    spec = space.object_spec("crate")
    text = spec.read_text()
    for seed in (1, 2):
        take(folder / f"pose_{seed}.jpg", seed)
    run(space, folder)
    # the same PNG, printed at another size
    spec.write_text(
        re.sub(r"(?m)^size_mm.*$", "", text) + ("" if "[patch]" in text else "\n[patch]") + "\nsize_mm = 33\n"
    )
    for seed in (3, 4):
        take(folder / f"pose_{seed}.jpg", seed)
    run(space, folder)
    lines = read_manifest(space.captures_dir / "real")
    assert {one.made["class"] for one in lines.values()} == {str(read_spec(spec).class_name)}
    assert len({one.booster_sha256 for one in lines.values()}) == 1
    found = read_captures(space.captures_dir / "real").captures
    assert len({one.variant for one in found}) == 2 and all(one.variant.startswith("patched-") for one in found)


def test_names_that_contradict_the_order_are_told(space, folder):
    for minute in range(4):
        take(folder / f"pose_{4 - minute}.jpg", minute, minute)
    result = run(space, folder, ImportSettings(object="crate", variant="patched", match="order"))
    (note,) = [one for one in result.notes if "in their name" in one]
    assert note.startswith("4 of 4 photographs have another pose in their name") and "pose_4.jpg: pose 1" in note
