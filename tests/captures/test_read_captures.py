"""Capture folders, shot by the rig or sorted by hand."""

import json

import numpy as np
import pytest

from toolkit.captures.read import Selection, read_captures, read_pose_id
from toolkit.core.errors import ToolkitError
from toolkit.imaging.read import UnreadableImage, read_image


def put(root, *paths):
    for path in paths:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_bytes(path.encode())  # no two photographs are equal: equal ones count once


@pytest.fixture
def folder(tmp_path):
    root = tmp_path / "captures"
    for variant in ("unpatched", "patched"):
        put(root, *(f"sim/racer/{variant}/pose_{pose:02d}.png" for pose in (1, 2)))
        put(root, f"real/mug/{variant}/IMG_0001.JPG")
    return root


def keys(found):
    return [(one.source, one.object, one.variant, one.pose_id) for one in found.captures]


def test_sorted_by_hand(folder):
    found = read_captures(folder)
    assert keys(found) == [
        ("real", "mug", "patched", 1),
        ("real", "mug", "unpatched", 1),
        ("sim", "racer", "patched", 1),
        ("sim", "racer", "patched", 2),
        ("sim", "racer", "unpatched", 1),
        ("sim", "racer", "unpatched", 2),
    ]
    assert found.objects == ["mug", "racer"]
    assert found.captures[0].path == "real/mug/patched/IMG_0001.JPG"
    assert found.captures[0].file.is_file()
    assert found.notes == () and found.refused_folders == ()


def test_a_part_of_the_folder_keeps_its_names(folder, monkeypatch):
    whole = [one for one in read_captures(folder).captures if one.source == "sim"]
    assert [one.path for one in read_captures(folder / "sim").captures] == [one.path for one in whole]
    assert [one.path for one in read_captures(folder / "sim" / "racer").captures] == [one.path for one in whole]
    assert {one.source_dir for one in whole} == {folder / "sim"}
    for inside in ("sim", "sim/racer"):
        monkeypatch.chdir(folder / inside)
        found = read_captures(".").captures
        assert [one.path for one in found] == [one.path for one in whole]
        assert {one.source_dir for one in found} == {folder / "sim"}, "of a path that has fewer folders"


def test_image_folder_of_wordnet_ids(tmp_path):
    put(tmp_path / "photos", "n04552348/a.jpg", "n04037443/b.jpg")
    assert keys(read_captures(tmp_path / "photos")) == [
        ("photos", "n04037443", "unpatched", None),
        ("photos", "n04552348", "unpatched", None),
    ]


def test_manifest_gives_pose_and_camera(folder):
    T_world_camera = np.eye(4).tolist()
    record = {"path": "racer/patched/pose_02.png", "object": "racer", "variant": "patched", "pose_id": 17}
    (folder / "sim" / "manifest.jsonl").write_text(json.dumps({**record, "T_world_camera": T_world_camera}) + "\n")
    for root in (folder, folder / "sim", folder / "sim" / "racer"):
        one = next(one for one in read_captures(root).captures if one.path.endswith("sim/racer/patched/pose_02.png"))
        assert one.pose_id == 17
        assert one.T_world_camera == tuple(map(tuple, T_world_camera))
    assert read_captures(folder / "sim").notes == ()


def test_manifest_may_not_leave_its_folder(folder):
    record = {"path": "../../secret.png", "object": "racer", "variant": "patched"}
    (folder / "sim" / "manifest.jsonl").write_text(json.dumps(record) + "\n")
    with pytest.raises(ToolkitError, match="leaves its folder"):
        read_captures(folder)


@pytest.mark.parametrize(
    ("name", "pose_id"),
    [
        ("pose_03.jpg", 3),
        ("3.jpg", 3),
        ("IMG_0003.jpg", 3),
        ("DSC01234.JPG", 1234),
        ("IMG_0003 (1).jpg", 3),
        ("pose7_v2.png", 7),
        ("racer-012-final.png", 12),
        ("bear1_2in_over.jpg", None),
        ("keyboard_bear1.jpg", None),
        ("IMG_20240512_101530.jpg", None),
        ("38bdd950c1d08be6.jpg", None),
        ("photo.jpg", None),
    ],
)
def test_pose_number_in_a_name(name, pose_id):
    assert read_pose_id(name) == pose_id


def test_equal_names_pair(tmp_path):
    same = ("unpatched/desk_over.jpg", "bear1/DESK_OVER.jpg", "bear2/Desk_Over.JPG")
    put(tmp_path, *(f"real/mug/{name}" for name in same))
    put(tmp_path, "real/mug/bear1/4in_side.jpg", "real/mug/unpatched/7.jpg", "real/cup/bear1/desk_over.jpg")
    poses = {one.path.removeprefix("real/"): one.pose_id for one in read_captures(tmp_path).captures}
    assert {poses[f"mug/{name}"] for name in same} == {8}
    assert poses["mug/bear1/4in_side.jpg"] is poses["cup/bear1/desk_over.jpg"] is None, "nothing to pair with"


def test_one_photograph_under_several_names_counts_once(tmp_path):
    photograph = np.random.default_rng(0).bytes(30_000)
    for pose in range(1, 9):
        put(tmp_path, f"real/mug/unpatched/{pose}.jpg", f"real/mug/patched/{pose}.jpg")
        (tmp_path / f"real/mug/unpatched/{pose}.jpg").write_bytes(photograph)
    found = read_captures(tmp_path)
    assert [one.pose_id for one in found.captures if one.variant == "unpatched"] == [1]
    assert sum(one.variant == "patched" for one in found.captures) == 8
    assert "a copy of a photograph that counts once: real/mug/unpatched/1.jpg" in found.notes[0]


def test_what_is_passed_over_and_what_is_told(folder):
    put(folder, "sim/racer/patched/.hidden.png", "sim/racer/patched/.x.png.1.partial", ".git/a/b/c.png")
    put(folder, "sim/transforms.json", "sim/racer/notes.txt", "sim/contact_sheet.png")
    found = read_captures(folder)
    assert len(found.captures) == 6
    assert any("sim/racer/notes.txt" in note for note in found.notes)
    assert any("sim/contact_sheet.png" in note for note in found.notes)
    assert not any("transforms" in note or "hidden" in note for note in found.notes)


def test_two_images_of_one_pose_are_told(folder):
    put(folder, "sim/racer/patched/1.jpg")
    (note,) = read_captures(folder).notes
    assert "pose 1 in sim/racer/patched" in note
    assert "sim/racer/patched/1.jpg, sim/racer/patched/pose_01.png" in note
    put(folder, "real/cup/patched/1.jpg", "real/cup/patched/pose_01.jpg")  # in one variant: nothing is paired
    assert len(read_captures(folder).notes) == 1


def test_links_that_leave_are_refused(folder, tmp_path):
    put(tmp_path, "elsewhere/secret.jpg", "elsewhere/racer/patched/1.jpg")
    (folder / "sim/racer/patched/pose_09.jpg").symlink_to(tmp_path / "elsewhere/secret.jpg")
    (folder / "sim/racer/patched/pose_10.png").symlink_to(folder / "sim/racer/patched/pose_01.png")
    (folder / "borrowed").symlink_to(tmp_path / "elsewhere")
    found = read_captures(folder)
    refused = {one.path: one.refused for one in found.captures if one.refused}
    assert list(refused) == ["sim/racer/patched/pose_09.jpg"]
    assert "leaves the folder" in refused["sim/racer/patched/pose_09.jpg"]
    assert [path for path, _ in found.refused_folders] == ["borrowed"]
    assert all("elsewhere" not in str(one.file.resolve()) for one in found.captures if not one.refused)


@pytest.mark.parametrize("target", ["pose_12.png", "gone.png"])
def test_a_link_that_leads_nowhere_is_one_bad_file(folder, target):
    (folder / "sim/racer/patched/pose_12.png").symlink_to(target)
    whole = len(read_captures(folder).captures)
    (bad,) = [one for one in read_captures(folder).captures if one.path.endswith("pose_12.png")]
    assert whole == 7
    with pytest.raises(UnreadableImage):
        read_image(bad.file, 224)


def test_selection(folder):
    assert keys(read_captures(folder, Selection(objects=("mug",), variants=("patched",)))) == [
        ("real", "mug", "patched", 1)
    ]
    for selection, known in (
        (Selection(objects=("muq",)), "mug"),
        (Selection(sources=("simm",)), "sim"),
        (Selection(variants=("patchd",)), "patched"),
    ):
        with pytest.raises(ToolkitError, match=f"did you mean .*{known}"):
            read_captures(folder, selection)


def test_bad_folders(tmp_path):
    put(
        tmp_path, "loose/a.jpg", "empty/readme.txt", "file.jpg", "named/sim/all/patched/1.jpg", "worn/sim/mug/all/1.jpg"
    )
    for name, expected in (
        ("gone", "does not exist"),
        ("file.jpg", "is a file"),
        ("empty", "holds no images"),
        ("loose", "not sorted into folders"),
        ("named", "object 'all': .* may not be called"),
        ("worn", "variant 'all': .* may not be called"),
    ):
        with pytest.raises(ToolkitError, match=expected):
            read_captures(tmp_path / name)


def test_a_name_that_is_no_text(folder):
    name = b"bad\xff_4.jpg"
    try:
        (folder / "sim/racer/patched" / name.decode("utf-8", "surrogateescape")).write_bytes(b"x")
    except OSError:
        pytest.skip("this file system takes only UTF-8 names")
    (one,) = [one for one in read_captures(folder).captures if one.pose_id == 4]
    one.path.encode("utf-8")
    assert one.file.is_file()
