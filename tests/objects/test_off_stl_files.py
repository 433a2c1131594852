"""OFF and STL as other programs write them: headers, colours, rubbish behind the end."""

import struct

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.objects.load import read_mesh
from toolkit.objects.paint import PLAIN_COLOUR

SQUARE = "0 0 0{0}\n1 0 0{0}\n1 1 0{0}\n0 1 0{0}\n"
RED = (200, 30, 20)
FACET = struct.pack("<12f", 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 1, 0)
TEXT = (
    "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0\nendloop\nendfacet\nendsolid x\n"
)


def write(folder, name, content):
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder / name


def colours(mesh):
    return {tuple(texel) for texel in mesh.materials[0].texture.reshape(-1, 3).tolist()}


@pytest.mark.parametrize(
    "head",
    [
        "OFF\n4 1 0\n",
        "OFF 4 1 0\n",
        "OFF # made\n# by hand\n\n4 1 0 # counts\n",
        "4 1 0\n",
        "NOFF\n4 1 0\n",
        "STOFF\n4 1 0\n",
    ],
)
def test_any_head_of_an_off_is_read(tmp_path, head):
    more = {"N": " 0 0 1", "S": " 0.5 0.5"}.get(head[0], "")
    mesh = read_mesh(write(tmp_path, "a.off", head + SQUARE.format(more) + "4 0 1 2 3\n"))
    assert len(mesh.faces) == 2 and colours(mesh) == {PLAIN_COLOUR}


@pytest.mark.parametrize("colour", ["200 30 20", "200 30 20 255", "0.784 0.118 0.078", "0.784 0.118 0.078 1"])
@pytest.mark.parametrize("of_faces", [True, False])
def test_colours_of_an_off_are_read(tmp_path, colour, of_faces):
    head, rows, face = ("OFF", "", f" {colour}") if of_faces else ("COFF", f" {colour}", "")
    mesh = read_mesh(write(tmp_path, "a.off", f"{head}\n4 1 0\n{SQUARE.format(rows)}4 0 1 2 3{face}\n"))
    assert colours(mesh) == {RED}


@pytest.mark.parametrize("head", [b"OFF BINARY\n\0\0\0\4", b"4OFF\n4 1 0\n"])
def test_other_offs_are_one_line(tmp_path, head):
    with pytest.raises(ToolkitError, match=r"a\.off: .*OFF.* is not read: save it as"):
        read_mesh(write(tmp_path, "a.off", head))


def binary(attribute=0, head=b"", count=1, tail=b""):
    return head.ljust(80) + struct.pack("<I", count) + FACET + struct.pack("<H", attribute) + tail


@pytest.mark.parametrize(
    "content",
    [TEXT, TEXT.upper(), TEXT.replace("\n", "\r\n"), "\ufeff" + TEXT, binary(),
     binary(head=b"solid of facets"), binary(tail=b"more")],
)  # fmt: skip
def test_any_stl_is_read(tmp_path, content):
    mesh = read_mesh(write(tmp_path, "a.stl", content))
    np.testing.assert_allclose(mesh.size_mm, [1, 1, 0])
    assert len(mesh.faces) == 1 and colours(mesh) == {PLAIN_COLOUR}


GREEN_5_BITS = 31 << 5


@pytest.mark.parametrize(
    ("attribute", "head", "colour"),
    [
        (0x8000 | 31 << 10, b"", (255, 0, 0)), (31 << 10, b"", PLAIN_COLOUR),  # VisCAM: blue is lowest
        (31, b"COLOR=\xc8\x1e\x14\xff", (255, 0, 0)), (GREEN_5_BITS, b"COLOR=\xc8\x1e\x14\xff", (0, 255, 0)),
        (0x8000 | 31, b"COLOR=\xc8\x1e\x14\xff", RED), (0, b"COLOR=\xc8\x1e\x14\xff,MATERIAL=", RED),
    ],
)  # fmt: skip
def test_colours_of_an_stl_are_read(tmp_path, attribute, head, colour):
    assert colours(read_mesh(write(tmp_path, "a.stl", binary(attribute, head)))) == {colour}


def test_a_cut_stl_says_so(tmp_path):
    with pytest.raises(ToolkitError, match=r"a\.stl: ends too early: it announces 3 triangles and holds 1"):
        read_mesh(write(tmp_path, "a.stl", binary(count=3)))


@pytest.mark.parametrize("name", ["a.obj", "a.glb", "a.stl", "a.ply", "a.off"])
def test_a_stand_in_of_git_lfs_is_named(tmp_path, name):
    content = "version https://git-lfs.github.com/spec/v1\noid sha256:12\nsize 34\n"
    with pytest.raises(ToolkitError, match=r"a\.\w+: it is a Git LFS pointer, not the file: run 'git lfs pull'"):
        read_mesh(write(tmp_path, name, content))
