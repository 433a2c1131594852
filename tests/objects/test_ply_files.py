"""Stanford PLY as other programs write it: pictures, texture coordinates of corners, colours, elements."""

import struct

import numpy as np
import pytest
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.objects.add import find_named_files
from toolkit.objects.load import read_mesh
from toolkit.objects.paint import PLAIN_COLOUR

RED, BLUE = (200, 30, 20), (10, 20, 220)
UV = "0 0 1 0 1 1 0 1"


@pytest.fixture
def folder(tmp_path):
    Image.new("RGB", (4, 4), RED).save(tmp_path / "red.png")
    Image.new("RGB", (4, 4), BLUE).save(tmp_path / "blue two.png")
    return tmp_path


def write(folder, faces, face="", vertex="", comments=(), columns=("",) * 4, elements=""):
    places = ("0 0 0", "1 0 0", "1 1 0", "0 1 0")
    lines = ["ply", "format ascii 1.0", *(f"comment {comment}" for comment in comments), "element vertex 4"]
    lines += [f"property float {axis}" for axis in "xyz"] + [line for line in vertex.split("\n") if line]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    lines += [line for line in (face + elements).split("\n") if line] + ["end_header"]
    lines += [f"{place} {column}".strip() for place, column in zip(places, columns, strict=True)] + list(faces)
    (folder / "card.ply").write_text("\n".join(lines) + "\n")
    return folder / "card.ply"


def face_colours(mesh):
    """The colour of the material of each face, in order."""
    return [tuple(mesh.materials[index].texture[0, 0].tolist()) for index in mesh.face_material]


WEDGES = "property list uchar float texcoord\n"
NUMBERED = f"{WEDGES}property int texnumber\n"
BOTH = ("TextureFile red.png", "TextureFile blue two.png")


def test_each_face_has_the_picture_of_its_number(folder):
    faces = ("3 0 1 2 6 0 0 1 0 1 1 1", "3 0 2 3 6 0 0 1 1 0 1 0", "3 0 1 3 6 0 0 1 0 0 1 7")
    ply = write(folder, faces, NUMBERED, comments=BOTH)
    mesh = read_mesh(ply)
    assert sorted(face_colours(mesh)) == sorted([BLUE, RED, PLAIN_COLOUR])
    assert [file.name for file in find_named_files(ply)] == ["red.png", "blue two.png"]
    for face, uv in zip(mesh.vertices[mesh.faces], mesh.uv[mesh.faces], strict=True):
        np.testing.assert_allclose(uv, face[:, :2], atol=1e-6)  # in this file, uv are x and y


def test_faces_of_any_number_of_corners_keep_texture_coordinates_and_pictures(folder):
    mesh = read_mesh(write(folder, (f"4 0 1 2 3 8 {UV} 1", "3 0 1 2 6 0 0 1 0 1 1 0"), NUMBERED, comments=BOTH))
    assert sorted(face_colours(mesh)) == sorted([BLUE, BLUE, RED])
    for face, uv in zip(mesh.vertices[mesh.faces], mesh.uv[mesh.faces], strict=True):
        np.testing.assert_allclose(uv, face[:, :2], atol=1e-6)


def test_binary_files_keep_them_too(folder):
    row = np.dtype([("n", "u1"), ("v", "<i4", 3), ("m", "u1"), ("uv", "<f4", 6), ("t", "<i4")])
    rows = np.array([(3, (0, 1, 2), 6, (0, 0, 1, 0, 1, 1), 1), (3, (0, 2, 3), 6, (0, 0, 1, 1, 0, 1), 0)], row)
    places = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
    text = (
        write(folder, ("3 0 1 2", "3 0 2 3"), NUMBERED, comments=BOTH)
        .read_text()
        .replace("ascii", "binary_little_endian")
    )
    header = text.partition("end_header")[0]
    (folder / "card.ply").write_bytes(header.encode() + b"end_header\n" + places.tobytes() + rows.tobytes())
    mesh = read_mesh(folder / "card.ply")
    assert sorted(face_colours(mesh)) == sorted([BLUE, RED])


@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t")])
@pytest.mark.parametrize("picture", [True, False])
def test_texture_coordinates_of_vertices(folder, names, picture):
    vertex = "".join(f"property float {name}\n" for name in names)
    ply = write(folder, ("4 0 1 2 3",), vertex=vertex, columns=("0 0", "1 0", "1 1", "0 1"),
                comments=BOTH[:1] if picture else ())  # fmt: skip
    mesh = read_mesh(ply)
    assert face_colours(mesh) == [RED if picture else PLAIN_COLOUR] * 2
    np.testing.assert_allclose(mesh.uv, mesh.vertices[:, :2], atol=1e-6)


@pytest.mark.parametrize("names", [("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue")])
def test_colours_are_read_by_the_names_that_programs_give_them(folder, names):
    """Also beside texture coordinates that no picture fills."""
    vertex = "".join(f"property uchar {name}\n" for name in names) + "property float s\nproperty float t\n"
    mesh = read_mesh(write(folder, ("4 0 1 2 3",), vertex=vertex, columns=("9 99 200 0 0",) * 4))
    assert (mesh.materials[0].texture[0, 0] == (9, 99, 200)).all()


def test_names_are_found_as_in_an_obj(folder):
    ply = write(folder, (f"4 0 1 2 3 8 {UV}",), WEDGES, comments=("TextureFile C:\\scans\\RED.png",))
    assert face_colours(read_mesh(ply)) == [RED] * 2
    assert [file.name for file in find_named_files(ply)] == ["red.png"]


@pytest.mark.parametrize(("content", "words"), [(b"", "a texture that is empty"), (b"hello", "not an image")])
def test_an_empty_or_broken_picture_is_one_line_with_its_file(folder, content, words):
    ply = write(folder, (f"4 0 1 2 3 8 {UV}",), WEDGES, comments=BOTH[:1])
    (folder / "red.png").write_bytes(content)
    with pytest.raises(ToolkitError, match=words) as caught:
        read_mesh(ply)
    assert "red.png" in str(caught.value) and "\n" not in str(caught.value)


def test_what_is_left_out_is_noted(folder, capsys):
    ply = write(folder, ("4 0 1 2 3", "4"), comments=BOTH[:1], elements="element material 1\nproperty int id\n")
    ply.write_text(ply.read_text().replace("element face 2", "element face 1"))
    assert len(read_mesh(ply).faces) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2 and "element material" in lines[0] and "red.png (the file has no texture" in lines[1]


def test_the_reports_inputs(shared):
    reports = shared / "reports" / "ply"
    if not reports.is_dir():
        pytest.skip("needs ../shared/reports/ply")
    means = [
        m.texture.reshape(-1, 3).mean(axis=0).round().tolist() for m in read_mesh(reports / "wedge2.ply").materials
    ]
    assert means == [[128, 128, 64], [255, 255, 255]]
    assert face_colours(read_mesh(reports / "none.ply"))[0] == PLAIN_COLOUR


def test_a_missing_picture_is_noted_as_in_an_obj(folder, capsys):
    ply = write(folder, (f"4 0 1 2 3 8 {UV}",), WEDGES, comments=BOTH[:1])
    (folder / "red.png").unlink()
    assert face_colours(read_mesh(ply)) == [PLAIN_COLOUR] * 2
    assert capsys.readouterr().err.endswith("left out: red.png (not there)\n")
    with pytest.raises(ToolkitError, match=r"names files that are not there: red\.png"):
        find_named_files(ply)


TRIANGLE = "0 0 0{0}\n1 0 0{0}\n1 1 0{0}\n3 0 1 2\n"


@pytest.mark.parametrize(
    ("kind", "written"),
    [
        ("uchar", RED),
        ("int", RED),
        ("float", RED),
        ("double", [c / 255 for c in RED]),
        ("ushort", [257 * c for c in RED]),
    ],
)
def test_colours_are_read_however_they_are_counted(tmp_path, kind, written):
    colour = "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    head = "".join(f"property float {axis}\n" for axis in "xyz") + colour
    (tmp_path / "a.ply").write_text(
        f"ply\nformat ascii 1.0\nelement vertex 3\n{head}element face 1\nproperty list uchar int vertex_indices\n"
        f"end_header\n{TRIANGLE.format(''.join(f' {number}' for number in written))}"
    )
    assert face_colours(read_mesh(tmp_path / "a.ply")) == [RED]


def test_colours_below_a_picture_are_noted(folder, capsys):
    rows = "".join(f"{place} 1 2 3 0.5 0.5\n" for place in ("0 0 0", "1 0 0", "1 1 0"))
    names = ("float x", "float y", "float z", "uchar red", "uchar green", "uchar blue", "float s", "float t")
    head = "".join(f"property {name}\n" for name in names)
    (folder / "a.ply").write_text(
        f"ply\nformat ascii 1.0\ncomment TextureFile red.png\nelement vertex 3\n{head}element face 1\n"
        f"property list uchar int vertex_indices\nend_header\n{rows}3 0 1 2\n"
    )
    assert face_colours(read_mesh(folder / "a.ply")) == [RED]
    assert "left out: colours below a picture" in capsys.readouterr().err


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_binary_file_is_read_with_any_ends_of_lines(tmp_path, end):
    names = "".join(f"property float {axis}\n" for axis in "xyz")
    head = (
        f"ply\nformat binary_big_endian 1.0\nelement vertex 3\n{names}element face 1\n"
        "property list uchar uint vertex_index\nend_header\n"
    )
    body = struct.pack(">9fB3I", 0, 0, 0, 1, 0, 0, 1, 1, 0, 3, 0, 1, 2)
    (tmp_path / "a.ply").write_bytes(head.replace("\n", end).encode() + body)
    np.testing.assert_allclose(read_mesh(tmp_path / "a.ply").size_mm, [1, 1, 0])
