"""The user's own meshes: what is read, how it stands, and what is said of those that cannot be used."""

import numpy as np
import pytest
import trimesh

from toolkit.core.errors import ToolkitError
from toolkit.objects.load import load_object, read_mesh, turn_upright
from toolkit.objects.paint import PLAIN_COLOUR

PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
{faces}end_header
0 0 0
{x} 0 0
0 1 0
{row}"""
FACES = "element face 1\nproperty list uchar int vertex_indices\n"


def write_spec(folder, mesh, name="thing", **fields):
    lines = [f'name = "{name}"', 'class = "thing"', f'mesh = "{mesh}"', "length_mm = 120"]
    lines += [f'{key} = "{value}"' for key, value in fields.items()]
    file = folder / f"{name}.toml"
    file.write_text("\n".join(lines))
    return file


def a_brick(folder, name, colours=None):
    """10 × 20 × 30 along x, y, z."""
    brick = trimesh.creation.box((10, 20, 30))
    if colours is not None:
        brick.visual.face_colors = colours
    brick.export(folder / name)
    return folder / name


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "glb", "gltf"])
def test_every_format_gives_the_same_brick(tmp_path, suffix):
    if suffix == "gltf":
        for name, content in trimesh.Scene(trimesh.creation.box((10, 20, 30))).export(file_type="gltf").items():
            (tmp_path / name).write_bytes(content)
        file = tmp_path / "model.gltf"
    else:
        file = a_brick(tmp_path, f"brick.{suffix}")
    mesh = read_mesh(file)
    np.testing.assert_allclose(sorted(mesh.size_mm), [10, 20, 30], rtol=1e-5)
    corners = mesh.vertices[mesh.faces].astype(float)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert len(mesh.faces) == 12 and volume == pytest.approx(6000, rel=1e-4)
    np.testing.assert_allclose(np.abs(mesh.normals).max(axis=1), 1, atol=1e-5)  # a brick's edges stay sharp


def test_without_texture_or_colour_it_is_plain_grey(tmp_path):
    mesh = read_mesh(a_brick(tmp_path, "brick.stl"))
    assert len(mesh.materials) == 1
    assert {tuple(texel) for texel in mesh.materials[0].texture.reshape(-1, 3)} == {PLAIN_COLOUR}


def test_face_colours_become_a_texture(tmp_path):
    colours = np.zeros((12, 4), np.uint8)
    colours[:, 3], colours[:6, 0], colours[6:, 2] = 255, 200, 90
    mesh = read_mesh(a_brick(tmp_path, "brick.ply", colours))
    texture = mesh.materials[0].texture
    uv = mesh.uv[mesh.faces].mean(axis=1)
    seen = texture[((1 - uv[:, 1]) * texture.shape[0]).astype(int), (uv[:, 0] * texture.shape[1]).astype(int)]
    found = {tuple(colour) for colour in seen.tolist()}
    assert found == {(200, 0, 0), (0, 0, 90)}


def test_an_obj_brings_its_picture(tmp_path):
    from PIL import Image

    picture = np.random.default_rng(0).integers(0, 256, (8, 8, 3), dtype=np.uint8)
    Image.fromarray(picture).save(tmp_path / "skin.png")
    (tmp_path / "skin.mtl").write_text("newmtl skin\nKd 1 1 1\nmap_Kd skin.png\n")
    (tmp_path / "card.obj").write_text(
        "mtllib skin.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl skin\n"
        "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    )
    mesh = read_mesh(tmp_path / "card.obj")
    np.testing.assert_array_equal(mesh.materials[0].texture, picture)
    np.testing.assert_allclose(mesh.uv, mesh.vertices[:, :2], atol=1e-6)


def test_up_and_front_turn_it_upright(tmp_path):
    """glTF's usual axes: y up, z to the front: 30 long, 10 wide, 20 high becomes so on the table."""
    a_brick(tmp_path, "brick.stl")
    item = load_object(write_spec(tmp_path, "brick.stl", up="y", front="z"))
    np.testing.assert_allclose(item.mesh.size_mm, [120, 40, 80], rtol=1e-5)
    np.testing.assert_allclose(item.mesh.bounds[0], [-60, -20, 0], atol=1e-3)
    assert item.name == "thing"


@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
@pytest.mark.parametrize("front", ["x", "-y", "z"])
def test_turning_is_a_rotation_that_brings_the_named_axes_home(make_box, up, front):
    mesh = make_box((10, 20, 30))
    if up[-1] == front[-1]:
        with pytest.raises(ToolkitError, match=rf"'up' \({up}\) and 'front' \({front}\) must be different"):
            turn_upright(mesh, up, front)
        return

    def axis(name):
        return np.eye(3)["xyz".index(name[-1])] * (-1 if "-" in name else 1)

    turned = turn_upright(mesh, up, front)
    before, after = mesh.vertices.astype(float), turned.vertices.astype(float)
    np.testing.assert_allclose(after[:, 2], before @ axis(up), atol=1e-5)
    np.testing.assert_allclose(after[:, 0], before @ axis(front), atol=1e-5)
    np.testing.assert_allclose(after[:, 1], before @ np.cross(axis(up), axis(front)), atol=1e-5)
    np.testing.assert_allclose(turned.normals[:, 2], mesh.normals @ axis(up), atol=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.ply", PLY.format(faces="", x=1, row=""), "no faces .a point cloud"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces"),
        ("a.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "1 of 3 vertices are NaN or infinite"),
        ("a.ply", PLY.format(faces=FACES, x="inf", row="3 0 1 2\n"), "1 of 3 vertices are NaN or infinite"),
        ("a.ply", PLY.format(faces=FACES, x=1, row="3 0 1 99999999\n"), "names vertex 99999999, the mesh has 3"),
        ("a.ply", PLY.format(faces=FACES, x=1, row="3 0 1 3\n"), "names vertex 3, the mesh has 3"),
        ("a.ply", PLY.format(faces=FACES, x=1, row="3 0 1 -7\n"), "names vertex -7, the mesh has 3"),
        ("a.obj", "v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "vertices of 2 numbers, expected 3"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999\n", "not a readable .obj mesh"),
        ("a.obj", "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "zero area|no extent|one point"),
        ("a.ply", "hello", "not a readable .ply mesh"),
        ("a.glb", "glTF", "not a readable .glb mesh"),
        ("a.gltf", "{", "not a readable .gltf mesh"),
        ("a.off", "", "not a readable .off mesh"),
        ("a.stl", "", "no faces|not a readable"),
        ("a.fbx", "x", r"cannot read a mesh from '.fbx' files, expected \.glb"),
        ("a", "x", "cannot read a mesh from '' files"),
    ],
)
def test_a_mesh_that_cannot_be_used_is_one_clear_line(tmp_path, name, content, words):
    (tmp_path / name).write_text(content)
    with pytest.raises(ToolkitError, match=words) as caught:
        load_object(write_spec(tmp_path, name))
    assert str(tmp_path / name) in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_mesh_and_one_outside_the_folder_are_refused(tmp_path):
    (tmp_path / "rig").mkdir()
    a_brick(tmp_path, "brick.stl")
    with pytest.raises(ToolkitError, match=r"gone\.stl: no such mesh file: put it beside its spec"):
        load_object(write_spec(tmp_path / "rig", "gone.stl"))
    for outside in ("../brick.stl", str(tmp_path / "brick.stl")):
        with pytest.raises(ToolkitError, match="leaves its folder"):
            load_object(write_spec(tmp_path / "rig", outside))


def test_an_unknown_built_in_is_named_with_its_neighbour(tmp_path):
    with pytest.raises(ToolkitError, match=r"no built-in mesh called 'racr': did you mean racer\?"):
        load_object(write_spec(tmp_path, "builtin:racr"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "axes", "longest", "textured"),
    [
        ("carton_lowpoly/carton_kenney.obj", {"up": "y", "front": "z"}, 2, True),
        ("racer_lowpoly/racer_kenney.obj", {"up": "y", "front": "z"}, 0, True),
        ("warplane_highpoly.ply", {}, None, False),
    ],
)
def test_meshes_from_elsewhere_stand_upright(shared, tmp_path, file, axes, longest, textured):
    """A carton is tallest, a racer longest from front to back, a plane flattest, whatever their files call up."""
    source = shared / "meshes" / file
    if not source.is_file():
        pytest.skip(f"needs {source.name} from ../shared/meshes")
    for beside in source.parent.glob(f"{source.stem}.*"):
        (tmp_path / beside.name).write_bytes(beside.read_bytes())
    item = load_object(write_spec(tmp_path, source.name, **axes))
    size = item.mesh.size_mm
    assert size.max() == pytest.approx(120, rel=1e-4)
    assert size.min() > 15
    if longest is None:
        assert size.argmin() == 2
    else:
        assert size.argmax() == longest
    assert item.mesh.bounds[0, 2] == pytest.approx(0, abs=1e-3)
    assert (len(np.unique(item.mesh.materials[0].texture.reshape(-1, 3), axis=0)) > 1) == textured
