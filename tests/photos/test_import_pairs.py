"""Photographs that a table pairs: no plan, no board, any names; copies count once; the evaluation compares variants."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from toolkit.captures.like import read_measured
from toolkit.captures.read import read_captures
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.evaluation.metrics import compare_unpatched, index_poses
from toolkit.evaluation.predict import Prediction
from toolkit.photos import ImportSettings
from toolkit.photos.gates.check_captures import check_captures
from toolkit.photos.importing.import_photos import import_photos
from toolkit.photos.importing.resolve import read_pairs
from toolkit.photos.posed_camera import PosedCamera
from toolkit.rig.camera import Camera, orbit_pose

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
    rows = {row.second: row for row in compare_unpatched(index_poses(answers)) if row.object == "desk"}
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
    ],
)
def test_a_wrong_table_is_one_clear_line(space, photos, tmp_path, rows, heading, words):
    table = write_table(tmp_path / "pairs.csv", rows, heading)
    with pytest.raises(ToolkitError) as caught:
        import_photos(space, [photos], ImportSettings(pairs=table))
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(("code", "mark"), [("utf-16", "\t"), ("utf-8-sig", ";"), ("utf-8", "\t"), ("utf-8", ", ")])
def test_a_table_of_pairs_is_read_as_any_program_writes_it(tmp_path, code, mark):
    rows = [("File", "Object", "Variant", "Pose"), ("Straße 1.jpg", "desk", "bear1", "left"), ("", "", "", "")]
    file = tmp_path / "pairs.csv"
    file.write_bytes("\r\n".join(mark.join(row) for row in rows).encode(code))
    (row,) = read_pairs(file)
    assert (row.file, row.object, row.variant, row.pose) == ("Straße 1.jpg", "desk", "bear1", "left")
