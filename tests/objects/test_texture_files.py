"""A texture, its record and what its objects need: files that must be of each other."""

import io
import json
import os
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import PACKAGE_DATA, make_workspace
from toolkit.objects.records import glb_name, read_texture, write_texture

RANDOM = np.random.default_rng(0)
PIXELS = RANDOM.integers(0, 256, (8, 8, 3), dtype=np.uint8)
UV = RANDOM.random((5, 3, 2), dtype=np.float32)
KEEP = RANDOM.random((6, 4)) > 0.5
SIDE_FILES = ("jet-plane.uv.npz", "jet-jet.keep.png")


def fields(**changes):
    objects = [{"name": name, "mesh_sha256": sha256_bytes(name.encode()), "keep": []} for name in ("jet", "plane")]
    return {
        "name": "jet", "class_name": "warplane", "class_index": 895, "networks": [], "data": {}, "seed": 0,
        "settings": {}, "final": {}, "toolkit_version": "0", "objects": objects,
    } | changes  # fmt: skip


@pytest.fixture
def png(tmp_path):
    write_texture(tmp_path, PIXELS, fields(), {"plane": UV}, {"jet": KEEP}, {"jet": b"glTF", "plane": b"glTF2"})
    return tmp_path / "jet.png"


def change_record(png, change):
    file = png.with_suffix(".json")
    record = json.loads(file.read_text())
    change(record)
    file.write_text(json.dumps(record))


def forge(png, name, content):
    """Other bytes in a file, and a record that says they are right."""
    (png.parent / name).write_bytes(content)
    index, key = {"jet-plane.uv.npz": (1, "uv_sha256"), "jet-jet.keep.png": (0, "keep_image_sha256")}[name]
    change_record(png, lambda record: record["objects"][index].update({key: sha256_bytes(content)}))


def pack(member="corner_uv.npy", **arrays):
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **{member.removesuffix(".npy"): arrays["array"]})
    return buffer.getvalue()


def test_what_is_written_is_read_back(png):
    texture = read_texture(png)
    np.testing.assert_array_equal(texture.pixels, PIXELS)
    np.testing.assert_array_equal(texture.corner_uv["plane"], UV)
    np.testing.assert_array_equal(texture.keep_images["jet"], KEEP)
    assert set(texture.corner_uv) == {"plane"} and set(texture.keep_images) == {"jet"}
    jet, plane = texture.record.objects
    assert (jet.unwrapped, plane.unwrapped) == (False, True)
    assert jet.glb_sha256 == sha256_bytes((png.parent / "jet.glb").read_bytes())
    assert plane.glb_sha256 == sha256_bytes((png.parent / "jet-plane.glb").read_bytes())
    assert texture.record.entry("plane") is plane and texture.record.entry("pla") is None
    assert (glb_name("jet", "jet"), glb_name("jet", "plane")) == ("jet.glb", "jet-plane.glb")


def test_numpy_reads_the_coordinates_and_pillow_the_mask(png):
    """The files are what their names say, to other programs too."""
    with np.load(png.parent / "jet-plane.uv.npz", allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["corner_uv"], UV)
    np.testing.assert_array_equal(np.asarray(Image.open(png.parent / "jet-jet.keep.png")) > 127, KEEP)


def test_the_same_texture_is_the_same_bytes(png, tmp_path, monkeypatch):
    """Whenever it is written: no file holds the time of day."""
    monkeypatch.setattr("time.time", lambda: 2e9)
    again = tmp_path / "again"
    write_texture(again, PIXELS, fields(), {"plane": UV}, {"jet": KEEP}, {"jet": b"glTF", "plane": b"glTF2"})
    for file in again.iterdir():
        assert file.read_bytes() == (tmp_path / file.name).read_bytes(), file.name
    assert len(list(again.iterdir())) == 6


@pytest.mark.parametrize("name", ["jet.png", *SIDE_FILES])
@pytest.mark.parametrize("damage", ["deleted", "cut short", "one bit"])
def test_damage_is_one_line_that_names_the_file(png, name, damage):
    file = png.parent / name
    content = file.read_bytes()
    if damage == "deleted":
        file.unlink()
    else:
        middle = len(content) // 2
        flipped = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
        file.write_bytes(content[:middle] if damage == "cut short" else flipped)
    words = "cannot read" if damage == "deleted" else r"its hash \w{12} does not match the record's \w{12}"
    with pytest.raises(ToolkitError, match=words) as caught:
        read_texture(png)
    assert name in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", SIDE_FILES)
@pytest.mark.parametrize("keep", [0, 0.3, 0.7])
def test_a_cut_file_with_a_record_to_match_is_refused_too(png, name, keep):
    content = (png.parent / name).read_bytes()
    forge(png, name, content[: int(keep * len(content))])
    with pytest.raises(ToolkitError, match=r"no readable table|not a readable PNG") as caught:
        read_texture(png)
    assert name in str(caught.value) and "\n" not in str(caught.value)


class Bomb:
    def __reduce__(self):
        return os._exit, (3,)


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.array([Bomb()], object), "no readable table"),  # a pickle: it must not run
        (UV[:, :2], r"expected floats \(triangles, 3, 2\), found float32 \(5, 2, 2\)"),
        (UV.astype(np.int32), r"found int32 \(5, 3, 2\)"),
        (UV * np.nan, "expected finite texture coordinates"),
    ],
)
def test_what_is_no_table_of_coordinates_is_refused(png, array, words):
    forge(png, "jet-plane.uv.npz", pack(array=array))
    with pytest.raises(ToolkitError, match=words) as caught:
        read_texture(png)
    assert "jet-plane.uv.npz" in str(caught.value)


def test_hostile_archives_are_refused(png, monkeypatch):
    name = "jet-plane.uv.npz"
    bombs = [pack("other.npy", array=UV), b"PK\x05\x06" + b"\0" * 18, b"not a zip"]
    huge = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        huge, {"descr": "<f4", "fortran_order": False, "shape": (10**14, 3, 2)}
    )  # and no data behind it
    for content in (huge.getvalue(), b"\x93NUMPY", pack(array=UV)):
        for how in (zipfile.ZIP_STORED, zipfile.ZIP_BZIP2):
            packed = io.BytesIO()
            with zipfile.ZipFile(packed, "w") as archive:
                archive.writestr("corner_uv.npy", content, how)
            bombs.append(packed.getvalue())
    for content in bombs:
        forge(png, name, content)
        with pytest.raises(ToolkitError, match=r"no readable table|expected floats"):
            read_texture(png)
    forge(png, name, pack(array=UV))
    monkeypatch.setattr("toolkit.objects.records.MAX_ARRAY_BYTES", 100)
    with pytest.raises(ToolkitError, match="unpacks to"):
        read_texture(png)


def test_no_path_leaves_the_folder(png, tmp_path):
    for name in ("../plane", "/etc/plane", "pl/ane", "", ".plane"):
        change_record(png, lambda record, name=name: record["objects"][1].update(name=name))
        with pytest.raises(ToolkitError, match=r"jet\.json: field 'objects\.1\.name'"):
            read_texture(png)
    for name in ("../jet", "", "a/b"):
        with pytest.raises(ValueError, match="name"):
            write_texture(tmp_path / "below", PIXELS, fields(name=name))
    assert not (tmp_path / "below").exists()


def test_a_link_out_of_the_folder_is_not_followed(tmp_path):
    folder = tmp_path / "textures"
    write_texture(folder, PIXELS, fields(), {"plane": UV})
    (folder / "jet-plane.uv.npz").rename(tmp_path / "elsewhere.npz")
    (folder / "jet-plane.uv.npz").symlink_to(tmp_path / "elsewhere.npz")
    with pytest.raises(ToolkitError, match="leaves its folder"):
        read_texture(folder / "jet.png")


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda record: record.update(n_px=0), "n_px"),
        (lambda record: record.update(size_mm=3), "size_mm"),
        (lambda record: record.update(objects=[]), "objects"),
        (lambda record: record.update(objects=record["objects"] * 2), "objects"),
        (lambda record: record["objects"][0].update(mesh_sha256="12"), r"objects\.0\.mesh_sha256"),
        (lambda record: record["objects"][1].update(uv_sha256=None), r"objects\.1"),
        (lambda record: record["objects"][0].update(keep="glass"), r"objects\.0\.keep"),
    ],
)
def test_a_wrong_field_of_the_record_is_named(png, change, field):
    change_record(png, change)
    with pytest.raises(ToolkitError, match=rf"jet\.json: (there is no )?field '{field}'"):
        read_texture(png)


def test_a_record_of_another_size_or_none_is_refused(png):
    change_record(png, lambda record: record.update(n_px=9))
    with pytest.raises(ToolkitError, match="expected 9×9 px as recorded, found 8×8"):
        read_texture(png)
    png.with_suffix(".json").unlink()
    with pytest.raises(ToolkitError, match=r"has no record jet\.json beside it: train it with 'toolkit train-texture'"):
        read_texture(png)


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[3])
import toolkit.objects.records as textures
from test_texture_files import KEEP, PIXELS, UV, fields

real, calls = textures.write_bytes, 0

def killed(file, content):
    global calls
    calls += 1
    if calls == int(sys.argv[2]):
        os.kill(os.getpid(), signal.SIGKILL)
    real(file, content)

textures.write_bytes = killed
textures.write_json = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
textures.write_texture(Path(sys.argv[1]), 255 - PIXELS, fields(), {"plane": 1 - UV}, {"jet": ~KEEP})
"""


@pytest.mark.slow
@pytest.mark.parametrize("call", [1, 2, 3, 4])
def test_a_kill_leaves_the_old_texture_or_says_what_does_not_match(png, call):
    """Before its first file, between its files, and before its record."""
    here = str(Path(__file__).parent)
    done = subprocess.run([sys.executable, "-c", KILLED, str(png.parent), str(call), here], check=False)
    assert done.returncode == -signal.SIGKILL
    if call == 1:
        np.testing.assert_array_equal(read_texture(png).pixels, PIXELS)
    else:
        with pytest.raises(ToolkitError, match=r"does not match the record's .*: the (picture|table) was changed"):
            read_texture(png)
    write_texture(png.parent, 255 - PIXELS, fields(), {"plane": 1 - UV}, {"jet": ~KEEP})
    np.testing.assert_array_equal(read_texture(png).pixels, 255 - PIXELS)


def test_the_workspace_lists_textures_and_not_their_masks(tmp_path):
    space = make_workspace(tmp_path)
    assert space.textures_dir == tmp_path / "rig" / "textures" and space.textures_dir.is_dir()
    write_texture(space.textures_dir, PIXELS, fields(), {"plane": UV}, {"jet": KEEP})
    shipped = {name: file for name, file in space.textures().items() if file.is_relative_to(PACKAGE_DATA)}
    assert space.textures() == shipped | {"jet": space.textures_dir / "jet.png"}
    assert space.texture("jet") == space.textures_dir / "jet.png"
    with pytest.raises(ToolkitError, match="no texture called 'jett': did you mean jet"):
        space.texture("jett")
