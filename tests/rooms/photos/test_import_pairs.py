"""Photographs that a table pairs: no plan, no board, any names; copies count once; the evaluation compares variants."""

import csv
import unicodedata
from pathlib import Path

import cv2
import numpy as np
import pytest

from toolkit.captures.like import read_measured
from toolkit.captures.manifest import read_manifest
from toolkit.captures.read import read_captures
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.evaluation.metrics import compare_unpatched, index_poses, pair_with_unpatched
from toolkit.evaluation.prediction import Prediction
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.gates.check_captures import check_captures
from toolkit.rooms.photos.importing.gather import Candidate, Gathered, SourceIndex
from toolkit.rooms.photos.importing.import_photos import import_photos
from toolkit.rooms.photos.importing.pairs import PairRow, match_pairs, read_pairs
from toolkit.rooms.photos.photo import Photo
from toolkit.rooms.photos.posed_camera import PosedCamera

VARIANTS = ("unpatched", "bear1", "bearcontrol")
VIEWS = ("2in_over", "4in_side", "6in_over")


def take(file: Path, seed: int, quality: int = 95) -> Path:
    """A photograph of something: blobs of many sizes and colours."""
    rng = np.random.default_rng(seed)
    picture = cv2.resize(rng.integers(0, 256, (12, 16, 3), dtype=np.uint8), (640, 480), interpolation=cv2.INTER_CUBIC)
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return file


def write_table(file: Path, rows: list[tuple[str, ...]], heading: str = "file,object,variant,pose,class") -> Path:
    with file.open("w", newline="") as out:
        csv.writer(out).writerows([heading.split(","), *rows])
    return file


@pytest.fixture
def space(tmp_path) -> Workspace:
    return make_workspace(tmp_path / "lab")


@pytest.fixture
def photos(tmp_path) -> Path:
    """Names as people give them; every one is of another moment."""
    for i, variant in enumerate(VARIANTS):
        for j, view in enumerate(VIEWS):
            take(tmp_path / "phone" / f"keyboard_{variant}_{view}.jpg", 10 * i + j)
    return tmp_path / "phone"


def rows_of(*, class_name: str = "computer keyboard") -> list[tuple[str, ...]]:
    return [
        (f"keyboard_{variant}_{view}.jpg", "desk", variant, view, class_name) for variant in VARIANTS for view in VIEWS
    ]


def test_a_table_says_what_each_photograph_shows(space, photos, tmp_path):
    table = write_table(tmp_path / "pairs.csv", rows_of())
    result = import_photos(space, [photos], ImportSettings(pairs=table))
    assert len(result.imported) == 9 and result.refused == ()
    assert {(row.variant, row.there, row.missing) for row in result.coverage} == {(name, 3, ()) for name in VARIANTS}
    found = read_captures(space.captures_dir).captures
    assert {(one.variant, one.pose_id) for one in found} == {(name, pose) for name in VARIANTS for pose in (1, 2, 3)}
    assert {one.class_name for one in found} == {"computer keyboard"}
    assert not (space.root / "rig" / "plan.json").exists() and result.imported[0].made["pose"] == "2in_over"
    again = import_photos(space, [photos], ImportSettings(pairs=table))
    assert again.imported == () and len(again.before) == 9
    assert check_captures(space).unreadable == (), "the gates of an object without a mesh are not checked, and no error"


def test_a_table_and_a_board_record_the_cameras_of_freehand_photographs(space, photos, tmp_path):
    """What is far from every pose of a plan can be shot again by `capture-sim --like` all the same."""
    camera = PosedCamera(orbit_pose(np.zeros(3), 77.0, 12.0, 900.0), Camera.from_fov(640, 480, 50.0))

    def locate(photo, pixels):
        return "no board is seen" if "bear1_2in" in photo.path.name else camera

    table = write_table(tmp_path / "pairs.csv", rows_of())
    result = import_photos(space, [photos], ImportSettings(pairs=table), locate=locate)
    measured, skipped = read_measured(result.source_dir)
    assert len(measured) == 8 and len(skipped) == 1
    np.testing.assert_allclose(measured[0].T_world_camera, camera.T_world_camera, atol=1e-5)
    (note,) = (one for one in result.notes if "camera" in one)
    assert note == "keyboard_bear1_2in_over.jpg: its camera is not known: no board is seen"
    # corrected without the board: what was measured stays
    write_table(table, [(*row[:4], "keyboard") for row in rows_of()])
    assert len(import_photos(space, [photos], ImportSettings(pairs=table)).imported) == 9
    again, _ = read_measured(result.source_dir)
    assert len(again) == 8
    np.testing.assert_allclose(again[0].T_world_camera, camera.T_world_camera, atol=1e-5)


def test_each_variant_is_compared_with_the_bare_one(space, photos, tmp_path):
    import_photos(space, [photos], ImportSettings(pairs=write_table(tmp_path / "pairs.csv", rows_of())))
    right = {"unpatched": (), "bear1": (1, 2, 3), "bearcontrol": (2,)}
    answers = [
        Prediction(
            one, true_index=1, true_label="yes", top1_index=int(one.pose_id in right[one.variant]), top1_label="",
            top1_prob=1.0, true_prob=0.5, true_rank=1 + (one.pose_id not in right[one.variant]),
        )
        for one in read_captures(space.captures_dir).captures
    ]  # fmt: skip
    rows = {
        row.second: row for row in compare_unpatched(pair_with_unpatched(index_poses(answers))) if row.object == "desk"
    }
    assert {name: (len(row.pairs), row.outcomes.only_second) for name, row in rows.items()} == {
        "bear1": (3, 3),
        "bearcontrol": (3, 1),
    }


def test_what_the_table_does_not_list_and_copies_are_left_out(space, photos, tmp_path):
    take(photos / "stranger.jpg", 99)
    copy = photos / "again.jpg"
    picture = cv2.imread(str(photos / "keyboard_unpatched_2in_over.jpg"))
    cv2.imwrite(str(copy), picture, [cv2.IMWRITE_JPEG_QUALITY, 70])  # other bytes, the same photograph
    rows = [*rows_of(), ("again.jpg", "desk", "unpatched", "8in", "computer keyboard")]
    result = import_photos(space, [photos], ImportSettings(pairs=write_table(tmp_path / "pairs.csv", rows)))
    reasons = dict(result.refused)
    assert "does not list it" in reasons["stranger.jpg"] and len(result.imported) == 9
    assert any("a copy of" in reason and "counts once" in reason for reason in reasons.values())


def test_a_photograph_that_two_lines_name_differently_is_an_error(space, photos, tmp_path):
    """Once by its name, once with its folder: neither line may be dropped without a word."""
    camera = tmp_path / "camera"
    photos.rename(camera.mkdir() or camera / "phone")
    name, *said = rows_of()[0]
    for other in (f"phone/{name}", f"phone\\{name}"):
        table = write_table(tmp_path / "pairs.csv", [(name, *said), (other, "desk", "bear2", *said[2:])])
        with pytest.raises(
            ToolkitError, match=r"lines 2 and 3 of the table of pairs both name phone/keyboard_unpatched_2in_over\.jpg"
        ):
            import_photos(space, [camera], ImportSettings(pairs=table))


@pytest.mark.parametrize(
    ("rows", "heading", "words"),
    [
        ([("a.jpg", "desk", "bare", "1")], "file,object,variant", "no column pose"),
        ([("a.jpg", "desk", "", "1")], "file,object,variant,pose", "line 2: no variant"),
        ([("a.jpg", "desk", "b/c", "1")], "file,object,variant,pose", "line 2: variant 'b/c'"),
        (
            [("a.jpg", "d", "b", "1"), ("a.jpg", "d", "c", "1")],
            "file,object,variant,pose",
            "line 3: a.jpg is listed twice",
        ),
        ([("a.jpg", "d", "b", "1"), ("c.jpg", "d", "b", "1")], "file,object,variant,pose", "are both d/b pose 1"),
        ([("none.jpg", "desk", "bare", "1")], "file,object,variant,pose", "none.jpg in the table of pairs: no such"),
        ([], "file,object,variant,pose", "no photograph is listed"),
        ([("a.jpg", "d", "b", "9" * 5000)], "file,object,variant,pose", "line 2: pose '999"),
        ([("a.jpg", "d", "b", "1", "x" * 5000)], "file,object,variant,pose,class", "line 2: class 'xxx"),
        ([("a.jpg", "d", "b", "\x1b[31m")], "file,object,variant,pose", "letters that can be shown"),
        (
            [("a.jpg", "d", "b", "x" * 200_000)],
            "file,object,variant,pose",
            "line 2: not a readable CSV table (field larger than",
        ),
        ([], "file,object,variant,pose," + "x" * 200_000, "line 1: not a readable CSV table (field larger than"),
    ],
)
def test_a_wrong_table_is_one_clear_line(space, photos, tmp_path, rows, heading, words):
    table = write_table(tmp_path / "pairs.csv", rows, heading)
    with pytest.raises(ToolkitError) as caught:
        import_photos(space, [photos], ImportSettings(pairs=table))
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_long_table_takes_work_in_proportion(tmp_path):
    """300,000 lines took an hour: poses were looked for in a list, and photographs once more for each line."""
    photo = Photo(Path("0.jpg"), "0" * 64, "jpeg", 640, 480)
    rows = [PairRow(f"{k}.jpg", "desk", "bare", f"view {k}") for k in range(100_000)]
    candidates = tuple(Candidate(photo, row.file, ()) for row in rows)
    found = match_pairs(rows, Gathered(candidates, False, (), (), ()), SourceIndex(tmp_path, {}, {}, {}), "pairs.csv")
    assert len(found.resolved) == 100_000 and found.resolved[-1][1].key.pose_id == 100_000


def import_table(space, photos, tmp_path, rows, name: str = "pairs.csv", **settings):
    table = write_table(tmp_path / name, rows)
    return import_photos(space, [photos], ImportSettings(pairs=table, **settings))


def list_places(space) -> dict[str, tuple[str, int]]:
    """Variant and pose of each photograph that counts, by its own name."""
    records = read_manifest(space.captures_dir / "real")
    found = {record.made["original_name"]: (record.variant, record.pose_id) for record in records.values()}
    assert sorted(records) == sorted(one.path_in_source for one in read_captures(space.captures_dir).captures)
    for path, record in records.items():
        assert sha256_file(space.captures_dir / "real" / path) == record.made["original_sha256"]
    return found


def test_a_corrected_table_moves_what_was_wrong_and_says_so(space, photos, tmp_path):
    """Two swapped variants, a pose and a class: the second run leaves what the first would have made."""
    right = rows_of()
    wrong = list(right)
    wrong[0], wrong[3] = (right[0][0], *right[3][1:]), (right[3][0], *right[0][1:])
    wrong = [(*row[:4], "mouse") for row in wrong]
    import_table(space, photos, tmp_path, wrong)
    assert list_places(space)[right[0][0]] == ("bear1", 1)
    result = import_table(space, photos, tmp_path, right)
    expected = {name: (variant, VIEWS.index(view) + 1) for name, _, variant, view, _ in right}
    assert list_places(space) == expected and len(result.imported) == 9 and not result.refused
    said = [note for note in result.notes if "moved" in note]
    assert len(said) == 9
    assert (
        f"{right[0][0]}: moved from desk/bear1/pose_01.jpg to desk/unpatched/pose_01.jpg, class mouse to computer "
        "keyboard by the new table"
    ) in said
    assert import_table(space, photos, tmp_path, right).imported == ()


def test_a_photograph_keeps_the_row_it_was_imported_by(space, photos, tmp_path):
    result = import_table(space, photos, tmp_path, rows_of())
    by_name = {row[0]: f"pairs.csv:{line}" for line, row in enumerate(rows_of(), 2)}
    assert {record.made["original_name"]: record.made["row"] for record in result.imported} == by_name


def test_a_row_that_is_gone_is_told(space, photos, tmp_path):
    rows = rows_of()
    import_table(space, photos, tmp_path, rows)
    result = import_table(space, photos, tmp_path, rows[1:])
    assert dict(result.refused)[rows[0][0]] == (
        "imported before as desk/unpatched/pose_01.jpg, and pairs.csv lists it no longer: delete that file, or list it "
        "again"
    )
    # another table is of other photographs
    assert not import_table(space, photos, tmp_path, rows[1:], "more.csv").refused


def test_a_place_that_is_taken_stays_taken(space, photos, tmp_path):
    rows = rows_of()
    import_table(space, photos, tmp_path, rows)
    before = list_places(space)
    (photos / rows[1][0]).unlink()
    moved = [(rows[0][0], *rows[1][1:])]
    result = import_table(space, photos, tmp_path, moved, "other.csv")
    assert "has desk/unpatched/pose_02.jpg" in dict(result.refused)[rows[0][0]] and list_places(space) == before


def test_poses_keep_their_numbers_in_another_table(space, photos, tmp_path):
    """`4in_side` is pose 2 wherever it stands in a table, as a number is what pairs."""
    rows = rows_of()
    import_table(space, photos, tmp_path, rows[:3])
    import_table(space, photos, tmp_path, [rows[5], rows[4], rows[3]], "more.csv")
    assert {name: pose for name, (_, pose) in list_places(space).items()} == {
        row[0]: VIEWS.index(row[3]) + 1 for row in rows[:6]
    }
    numbered = [(rows[6][0], "desk", "bearcontrol", "2", "")]
    with pytest.raises(
        ToolkitError, match=r"pose '2' of 'desk' would be number 2, which an earlier table gave to '4in"
    ):
        import_table(space, photos, tmp_path, numbered, "numbers.csv")


def test_a_class_is_said_once(space, photos, tmp_path):
    """By the spec, an earlier table and this one: a contradiction is a line, and an empty column takes the earlier."""
    rows = rows_of()
    (space.objects_dir / "mug.toml").write_text(
        'name = "mug"\nclass = "coffee mug"\nmesh = "mug.obj"\nlength_mm = 90\n'
    )
    with pytest.raises(
        ToolkitError, match=r"'mug' has the class 'cup' in the table of pairs, and 'coffee mug' in .*mug"
    ):
        import_table(space, photos, tmp_path, [(rows[0][0], "mug", "unpatched", "1", "cup")])
    assert import_table(space, photos, tmp_path, [(rows[8][0], "mug", "unpatched", "1", "Coffee_mug")]).imported
    import_table(space, photos, tmp_path, rows[:3])
    with pytest.raises(
        ToolkitError, match=r"'desk' has the class 'mouse' .* and 'computer keyboard' in an earlier table"
    ):
        import_table(space, photos, tmp_path, [(*row[:4], "mouse") for row in rows[3:6]], "more.csv")
    result = import_table(space, photos, tmp_path, [(*row[:4], "") for row in rows[3:6]], "more.csv")
    assert {record.made["class"] for record in result.imported} == {"computer keyboard"}


def test_a_folder_that_contradicts_its_row_is_refused(space, photos, tmp_path):
    (photos / "unpatched").mkdir()
    rows = rows_of()
    (photos / rows[3][0]).rename(photos / "unpatched" / rows[3][0])
    result = import_table(space, photos, tmp_path, rows)
    assert dict(result.refused) == {
        f"unpatched/{rows[3][0]}": "its folder names the variant 'unpatched', line 5 of the table 'bear1'"
    }


@pytest.mark.parametrize("forms", [("NFD", "NFC"), ("NFC", "NFD")])
def test_accents_are_the_same_however_they_are_stored(space, tmp_path, forms):
    """A Mac keeps accents apart from their letters in file names, and tables are typed."""
    on_disk, in_table = (unicodedata.normalize(form, "caf\u00e9") for form in forms)
    for number in (1, 2):
        take(tmp_path / "phone" / on_disk / f"{on_disk}_{number}.jpg", number)
    files = f"{in_table}_1.jpg", f"{in_table}/{in_table}_2.jpg"
    rows = [(file, "desk", variant, "1", "mug") for file, variant in zip(files, ("unpatched", "b"), strict=True)]
    result = import_table(space, tmp_path / "phone", tmp_path, rows)
    assert len(result.imported) == 2 and not result.refused


def test_the_table_may_list_either_of_two_copies(space, photos, tmp_path):
    rows = rows_of()
    name = rows[0][0].replace(".jpg", ".png")
    cv2.imwrite(str(photos / name), cv2.imread(str(photos / rows[0][0])))
    result = import_table(space, photos, tmp_path, [(name, *rows[0][1:]), *rows[1:]])
    assert len(result.imported) == 9 and not result.refused and [label for label, _ in result.duplicates] == [name]


@pytest.mark.parametrize(("code", "mark"), [("utf-16", "\t"), ("utf-8-sig", ";"), ("utf-8", "\t"), ("utf-8", ", ")])
def test_a_table_of_pairs_is_read_as_any_program_writes_it(tmp_path, code, mark):
    rows = [("File", "Object", "Variant", "Pose"), ("Straße 1.jpg", "desk", "bear1", "left"), ("", "", "", "")]
    file = tmp_path / "pairs.csv"
    file.write_bytes("\r\n".join(mark.join(row) for row in rows).encode(code))
    (row,) = read_pairs(file)
    assert (row.file, row.object, row.variant, row.pose) == ("Straße 1.jpg", "desk", "bear1", "left")
