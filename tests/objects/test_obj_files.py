"""Wavefront OBJ as other programs write it: encodings, names of files, options of pictures, odd faces."""

import codecs

import numpy as np
import pytest
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.objects.add import ObjectRequest, add_object, find_named_files
from toolkit.objects.load import read_mesh
from toolkit.objects.paint import PLAIN_COLOUR

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl skin\nf 1/1 2/2 3/3 4/4\n"
RED = (200, 30, 20)


@pytest.fixture
def folder(tmp_path):
    Image.new("RGB", (4, 4), RED).save(tmp_path / "tex.png")
    return tmp_path


def write(folder, mtl, obj=SQUARE, encoding="utf-8", mark=b"", mtllib="mtllib skin.mtl"):
    (folder / "skin.mtl").write_bytes(mark + f"newmtl skin\n{mtl}\n".encode(encoding))
    (folder / "card.obj").write_bytes(mark + f"{mtllib}\n{obj}".encode(encoding))
    return folder / "card.obj"


def colour(mesh):
    return tuple(mesh.materials[0].texture.reshape(-1, 3).mean(axis=0).round().tolist())


@pytest.mark.parametrize(
    ("encoding", "mark"),
    [
        ("utf-8", codecs.BOM_UTF8), ("utf-16-le", codecs.BOM_UTF16_LE), ("utf-16-be", codecs.BOM_UTF16_BE),
        ("utf-16-le", b""), ("utf-16-be", b""), ("utf-32-le", codecs.BOM_UTF32_LE), ("cp1252", b""),
    ],
)  # fmt: skip
def test_any_usual_encoding_is_read(folder, encoding, mark):
    Image.new("RGB", (4, 4), RED).save(folder / "têx.png")
    obj = write(folder, "# grün\nmap_Kd têx.png", encoding=encoding, mark=mark)
    assert colour(read_mesh(obj)) == RED
    assert [file.name for file in find_named_files(obj)] == ["skin.mtl", "têx.png"]


@pytest.mark.parametrize("end", ["\r", "\r\n", "\n\n"])
def test_any_end_of_line_is_read(folder, end):
    obj = write(folder, f"Kd 1 1 1{end}map_Kd tex.png{end}".replace("\n", end), SQUARE.replace("\n", end))
    for file in (obj, folder / "skin.mtl"):
        file.write_bytes(file.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", end.encode()))
    assert colour(read_mesh(obj)) == RED


def test_continued_lines_are_joined_and_comments_are_not(folder):
    obj = write(
        folder, "# C:\\models\\\nmap_Kd \\\ntex.png", SQUARE.replace("f 1/1 2/2", "# was C:\\\nf 1/1 \\\n  2/2")
    )
    mesh = read_mesh(obj)
    assert colour(mesh) == RED and len(mesh.faces) == 2


@pytest.mark.parametrize(
    "name",
    [
        "tex.png", ".\\tex.png", "C:\\Users\\me\\Desktop\\tex.png", "/home/me/models/tex.png", "TEX.PNG",
        "..\\textures\\Tex.png", "\\\\server\\share\\tex.png", '"tex.png"', "maps/tex.png",
    ],
)  # fmt: skip
def test_paths_of_other_machines_are_found_by_their_last_part(folder, name):
    obj = write(folder, f"map_Kd {name}")
    assert colour(read_mesh(obj)) == RED
    assert [file.name for file in find_named_files(obj)] == ["skin.mtl", "tex.png"]


def test_letter_case_is_ignored_only_where_one_file_matches(folder):
    Image.new("RGB", (4, 4)).save(folder / "Tex.png")
    with pytest.raises(ToolkitError, match=r"names files that are not there: TEX\.png: put them into"):
        find_named_files(write(folder, "map_Kd TEX.png"))
    assert colour(read_mesh(write(folder, "map_Kd tex.png"))) == RED


def test_a_path_does_not_reach_out_of_the_folder(folder):
    inner = folder / "inner"
    inner.mkdir()
    for name in ("../tex.png", str(folder / "tex.png")):
        with pytest.raises(ToolkitError, match="leaves its folder"):
            read_mesh(write(inner, f"map_Kd {name}"))
    (inner / "linked.png").symlink_to(folder / "tex.png")
    with pytest.raises(ToolkitError, match="leaves its folder"):
        read_mesh(write(inner, "map_Kd linked.png"))


def test_pictures_are_named_from_their_librarys_folder(folder):
    (folder / "lib").mkdir()
    Image.new("RGB", (4, 4), (1, 2, 3)).save(folder / "lib" / "tex.png")
    obj = write(folder, "", mtllib="mtllib lib/my skin.mtl")
    (folder / "lib" / "my skin.mtl").write_text("newmtl skin\nmap_Kd tex.png\n")
    assert colour(read_mesh(obj)) == (1, 2, 3)


@pytest.mark.parametrize("mtllib", ["mtllib skin.mtl other.mtl", "mtllib other.mtl\nmtllib skin.mtl"])
def test_several_libraries_are_read(folder, mtllib):
    (folder / "other.mtl").write_text("newmtl base\nKd 0 0 1\n")
    obj = write(folder, "map_Kd tex.png", f"{SQUARE}usemtl base\nf 1 2 4\n", mtllib=mtllib)
    found = {tuple(material.texture[0, 0].tolist()) for material in read_mesh(obj).materials}
    assert found == {RED, (0, 0, 255)}


@pytest.mark.parametrize(
    ("options", "low", "high"),
    [
        ("-s 2 3 1", (0, 0), (2, 3)), ("-s 2 2 1 -o 0.5 0 0", (0.5, 0), (2.5, 2)),
        ("-o 0.25 0.5", (0.25, 0.5), (1.25, 1.5)),
        ("-blendu on -bm 1.0 -s 2 2 2", (0, 0), (2, 2)), ("-clamp on -mm 0 1 -texres 512", (0, 0), (1, 1)),
    ],
)  # fmt: skip
def test_options_before_a_pictures_name_place_it(folder, options, low, high):
    mesh = read_mesh(write(folder, f"map_Kd {options} tex.png"))
    assert colour(mesh) == RED
    np.testing.assert_allclose([mesh.uv.min(axis=0), mesh.uv.max(axis=0)], [low, high], atol=1e-6)


def test_a_clamped_picture_goes_on_with_its_edge(folder):
    """uv 0 to 2: a quarter shows the picture, and the rest its right and upper texels."""
    Image.fromarray(np.array([[[0] * 3, [100] * 3], [[200] * 3, [250] * 3]], np.uint8)).save(folder / "two.png")
    mesh = read_mesh(write(folder, "map_Kd -clamp on -s 2 2 1 two.png"))
    texture = mesh.materials[0].texture[..., 0]
    height, width = texture.shape

    def look(u, v):
        """The texel at a point of the square, 0 to 1 on its sides."""
        low, high = mesh.uv.min(axis=0), mesh.uv.max(axis=0)
        x, y = low + (high - low) * [u, v]
        return int(texture[int((1 - y) * height), int(x * width)])

    assert [look(0.1, 0.1), look(0.4, 0.1), look(0.9, 0.1)] == [200, 250, 250]
    assert [look(0.1, 0.4), look(0.1, 0.9), look(0.9, 0.9)] == [0, 0, 100]


def test_what_is_left_out_is_noted_in_one_line(folder, capsys):
    read_mesh(write(folder, "d 0.5\nmap_Bump -bm 0.2 bumps.png\nmap_Kd -imfchan r -type sphere tex.png"))
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("note: ") and "card.obj: left out: " in line
    for feature in ("transparency (d 0.5)", "map_bump (bumps.png)", "map_Kd -imfchan", "map_Kd -type"):
        assert feature in line
    read_mesh(write(folder, "Kd 1 1 1\nd 1\nTr 0\nillum 2\nNs 10\nmap_Kd tex.png"))
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        ("Kd 0.5 0.5 0.5", (128, 128, 128)), ("Kd 0.4 0.4 0.4", (102, 102, 102)), ("Kd 0.5", (128, 128, 128)),
        ("Kd 200 100 50", (200, 100, 50)), ("Ka 1 1 1", PLAIN_COLOUR), ("Kd spectral x.rfl", PLAIN_COLOUR),
    ],
)  # fmt: skip
def test_a_colour_without_a_picture(folder, statement, expected):
    assert colour(read_mesh(write(folder, statement))) == expected


def test_a_picture_is_multiplied_by_the_colour_unless_that_was_never_set(folder):
    Image.new("RGB", (4, 4), (188, 188, 188)).save(folder / "tex.png")
    # sRGB 188 is half of the light, 0.735 of full is half again: a quarter is code 137
    half = colour(read_mesh(write(folder, "Kd 0.7354 0.7354 1\nmap_Kd tex.png")))
    np.testing.assert_allclose(half, (137, 137, 188), atol=1)
    assert colour(read_mesh(write(folder, "Kd 0 0 0\nmap_Kd tex.png"))) == (188, 188, 188)


def test_texture_coordinates_without_a_library_are_plain_grey(folder):
    mesh = read_mesh(write(folder, "", mtllib=""))
    assert colour(mesh) == PLAIN_COLOUR and mesh.uv.max() == 1


@pytest.mark.parametrize(
    ("content", "words"), [(b"", "a texture that is empty"), (b"GIF89a?", "not an image|damaged|truncated")]
)
def test_an_empty_or_broken_picture_is_one_line_with_its_file(folder, content, words):
    obj = write(folder, "map_Kd tex.png")
    (folder / "tex.png").write_bytes(content)
    with pytest.raises(ToolkitError, match=words) as caught:
        read_mesh(obj)
    assert str(folder / "tex.png") in str(caught.value) and "\n" not in str(caught.value)


def test_the_pictures_that_are_announced_are_in_the_material(folder, tmp_path):
    obj = write(folder, "map_Kd -s 1 1 1 C:\\art\\TEX.png")
    made = add_object(make_workspace(tmp_path / "space"), obj, ObjectRequest(class_name="crate", length_mm=100))
    assert "with skin.mtl, tex.png" in " ".join(made.lines())
    assert (made.item.mesh.materials[0].texture == RED).all()
    assert (read_mesh(made.mesh_files[0]).materials[0].texture == RED).all()


def test_a_missing_picture_is_noted_where_the_mesh_was_not_added(folder, capsys):
    assert colour(read_mesh(write(folder, "map_Kd gone.png"))) == PLAIN_COLOUR
    assert "gone.png (not there)" in capsys.readouterr().err


def test_corners_counted_backwards_mean_what_was_read_so_far(folder):
    first = "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\n"
    mesh = read_mesh(write(folder, "", first + "v 0 0 5\nv 1 0 5\nv 1 1 5\nf -3 -2 -1\n"))
    heights = mesh.vertices[mesh.faces][..., 2]
    assert sorted(heights.mean(axis=1).tolist()) == [0, 5] and (np.ptp(heights, axis=1) == 0).all()


def test_one_face_without_texture_coordinates_leaves_the_others_theirs(folder):
    mesh = read_mesh(write(folder, "map_Kd tex.png", f"{SQUARE}v 0 0 1\nf 1 2 5\n"))
    assert len(mesh.faces) == 3 and colour(mesh) == RED
    uv = mesh.uv[mesh.faces]
    assert (np.ptp(uv[:2], axis=1) == 1).all() and (uv[2] == 0).all()


def test_colours_of_vertices_are_kept_beside_a_material_without_picture(folder):
    coloured = "".join(f"v {x} {y} 0 0.5 0 1\n" for x, y in ((0, 0), (1, 0), (1, 1)))
    mesh = read_mesh(write(folder, "Ns 10", f"{coloured}usemtl skin\nf 1 2 3\n"))
    np.testing.assert_allclose(mesh.materials[0].texture[0, 0], (128, 0, 255), atol=1)


def test_the_reports_inputs_show_their_picture(shared):
    """Mean of red, green, blue and yellow quarters."""
    reports = shared / "reports" / "obj"
    if not reports.is_dir():
        pytest.skip("needs ../shared/reports/obj")
    for name in ("opts", "optsclamp", "winpath", "bom", "case", "latin", "mtl space", "tabs", "upper"):
        assert colour(read_mesh(reports / f"{name}.obj")) == (128, 128, 64), name
    assert colour(read_mesh(reports / "utf16.obj")) == (255, 0, 0)


def test_a_spider_with_windows_paths_wears_its_pictures(shared):
    file = shared / "meshes" / "obj" / "spider.obj"
    if not file.is_file():
        pytest.skip("needs ../shared/meshes/obj")
    assert len(find_named_files(file)) == 6
    for material in read_mesh(file).materials:
        assert material.texture.shape[0] > 100


@pytest.mark.parametrize("usemtl", ["", "usemtl SKIN\n"])
def test_the_only_material_is_taken_without_its_name_or_in_another_case(folder, usemtl):
    obj = write(folder, "map_Kd tex.png", SQUARE.replace("usemtl skin\n", usemtl))
    assert colour(read_mesh(obj)) == RED


@pytest.mark.parametrize("mtllib", ["mtllib skin.mtl", ""])
def test_a_material_that_is_not_there_is_noted(folder, capsys, mtllib):
    obj = write(folder, "map_Kd tex.png", SQUARE.replace("usemtl skin", "usemtl other"), mtllib=mtllib)
    assert colour(read_mesh(obj)) == PLAIN_COLOUR
    assert "left out: usemtl other (no such material)" in capsys.readouterr().err


def test_a_note_comes_once_in_a_process(folder, capsys):
    obj = write(folder, "map_Kd tex.png", SQUARE.replace("usemtl skin", "usemtl other"))
    for _ in range(3):
        read_mesh(obj)
    assert capsys.readouterr().err.count("note:") == 1


def test_comments_behind_statements_are_no_part_of_names(folder):
    Image.new("RGB", (4, 4), RED).save(folder / "t#1.png")
    obj = write(
        folder, "Kd 1 1 1 # white\nmap_Kd t#1.png # the picture", SQUARE.replace("skin", "skin # mine"),
        mtllib="mtllib skin.mtl # colours",
    )  # fmt: skip
    assert colour(read_mesh(obj)) == RED
    assert [file.name for file in find_named_files(obj)] == ["skin.mtl", "t#1.png"]


def test_a_foreign_path_is_followed_as_far_as_its_folders_lie_here(folder):
    (folder / "textures").mkdir()
    (folder / "tex.png").rename(folder / "textures" / "tex.png")
    obj = write(folder, "map_Kd C:\\art\\mug\\textures\\tex.png")
    assert colour(read_mesh(obj)) == RED


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("l 1 2\n", "points and lines"), ("#MRGB ffc81e14ffc81e14\n", "ZBrush's colours"),
        ("vt nan 0\nf 1/5 2/2 3/3\n", "tex.png (a part has no texture coordinates)"),
    ],
)  # fmt: skip
def test_what_else_is_left_out_is_noted(folder, capsys, more, words):
    read_mesh(write(folder, "map_Kd tex.png", SQUARE + more))
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("written", ["0.5 0.2 0.1", "128 51 26"])
def test_colours_of_vertices_are_of_one_or_of_255(tmp_path, written):
    corners = ("0 0 0", "1 0 0", "0 1 0", "0 0 1")
    faces = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "a.obj").write_text("".join(f"v {corner} {written}\n" for corner in corners) + faces)
    (material,) = read_mesh(tmp_path / "a.obj").materials
    assert (material.texture == (128, 51, 26)).all()


def test_a_fraction_a_little_above_one_is_white(tmp_path):
    (tmp_path / "a.obj").write_text(
        "".join(f"v {x} 1.001 1.001 1.001\n" for x in ("0 0 0", "1 0 0", "0 1 0")) + "f 1 2 3\n"
    )
    assert (read_mesh(tmp_path / "a.obj").materials[0].texture == 255).all()
