"""A user's own world: a mesh or a kit, and each thing that can be wrong with it."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.objects import limits
from toolkit.rooms.worlds.own import load_world, share_materials
from toolkit.rooms.worlds.world import SceneClass, World

T_gltf_world = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], float)
KIT = Path(__file__).resolve().parents[4] / "shared" / "worlds" / "kaykit-city"


def painted(mesh: trimesh.Trimesh, colour: tuple[int, int, int] = (120, 140, 90)) -> trimesh.Trimesh:
    image = Image.new("RGB", (8, 8), colour)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image)
    mesh.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(mesh.vertices), 2)), material=material)
    return mesh


def block(extents: tuple[float, float, float], x: float = 0, y: float = 0, z: float = 0) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(extents)
    mesh.apply_translation([x, y, z + extents[2] / 2])
    return mesh


def write(path: Path, parts: list[trimesh.Trimesh], scale: float = 1.0) -> Path:
    scene = trimesh.Scene()
    for k, part in enumerate(parts):
        part.apply_scale(scale)
        part.apply_transform(T_gltf_world)
        scene.add_geometry(part, node_name=f"part-{k}", geom_name=f"part-{k}")
    scene.export(path)
    return path


def yard(scale: float = 1.0) -> list[trimesh.Trimesh]:
    """A slab 60 m by 40 m whose top lies 5 m up, with a house 10 m high on it."""
    slab = painted(block((60, 40, 1), 100, 50, 4))
    return [slab, painted(block((12, 8, 10), 110, 50, 5), (200, 60, 40))]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return load_world(write(tmp_path_factory.mktemp("own") / "yard.glb", yard()))


def test_its_middle_is_the_origin_and_its_ground_zero(world: World) -> None:
    assert world.name == "yard"
    assert world.core == pytest.approx(np.array([[-30, -20], [30, 20]]), abs=1e-3)
    assert world.ground_height(np.array([[-20.0, 0.0], [25.0, -15.0]])) == pytest.approx(0, abs=1e-3)


def test_the_house_is_no_ground(world: World) -> None:
    mesh = world.mesh
    height = mesh.vertices[mesh.faces][:, :, 2].mean(axis=1)
    assert (world.face_class[height > 9.9] == SceneClass.ROOF).all()
    assert (world.face_class[np.abs(height) < 1e-3] == SceneClass.GROUND).any()


def test_inside_is_known_from_rays_alone(world: World) -> None:
    points = np.array([(10.0, 0.0, 5.0), (10.0, 0.0, 12.0), (-20.0, 0.0, 2.0), (14.0, 3.0, 0.5)])
    assert world.inside_building(points).tolist() == [True, False, False, True]


def test_spots_keep_clear_of_posts_too_thin_for_a_fan_of_rays(tmp_path: Path) -> None:
    at = np.random.default_rng(1).uniform((-28, -18), (28, 18), (30, 2))
    posts = [painted(block((0.06, 0.06, 4), 100 + x, 50 + y, 5), (30, 30, 30)) for x, y in at]
    spots = load_world(write(tmp_path / "posts.glb", [*yard(), *posts])).spots
    assert spots
    for spot in spots:
        assert np.hypot(*(at - spot.position[:2]).T).min() >= spot.free_radius_m - 0.1


def test_spots_keep_clear_of_the_house_and_the_edge(world: World) -> None:
    assert world.spots
    for spot in world.spots:
        x, y, z = spot.position
        beside = np.hypot(max(abs(x - 10) - 6, 0), max(abs(y) - 4, 0))
        assert z == pytest.approx(0, abs=1e-3)
        assert spot.free_radius_m <= beside + 0.6  # rays are some degrees apart
        assert spot.free_radius_m <= min(30 - abs(x), 20 - abs(y)) + 1e-6


def test_parts_that_look_alike_share_a_material(tmp_path: Path) -> None:
    parts = [painted(block((60, 40, 1)))] + [painted(block((1, 1, 1), x=k - 5, z=1)) for k in range(9)]
    world = load_world(write(tmp_path / "many.glb", parts))
    assert len(world.mesh.materials) == 1
    assert share_materials(world.mesh).face_material.max() == 0


def test_centimetres_are_named(tmp_path: Path) -> None:
    path = write(tmp_path / "big.glb", yard(), scale=200)
    with pytest.raises(ToolkitError, match=r"12,000 m across.*centimetres.*0\.01"):
        load_world(path)
    assert load_world(path, scale=0.005).core == pytest.approx(np.array([[-30, -20], [30, 20]]), abs=1e-2)


def test_a_model_is_too_small(tmp_path: Path) -> None:
    with pytest.raises(ToolkitError, match="m across, expected 15"):
        load_world(write(tmp_path / "small.glb", yard(), scale=0.01))


def test_no_ground(tmp_path: Path) -> None:
    houses = [painted(block((6, 6, 9), x, y)) for x in (-25, 0, 25) for y in (-20, 20)]
    with pytest.raises(ToolkitError, match=r"no ground: only .*%"):
        load_world(write(tmp_path / "houses.glb", houses))


def test_no_texture(tmp_path: Path) -> None:
    (tmp_path / "grey.stl").write_bytes(
        trimesh.util.concatenate([block((60, 40, 1)), block((8, 8, 9))]).export(file_type="stl")
    )
    with pytest.raises(ToolkitError, match="textures or colours"):
        load_world(tmp_path / "grey.stl")


def test_a_million_tiny_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MAX_PARTS", 5)
    parts = [painted(block((60, 40, 1)))] + [painted(block((1, 1, 1), x=k, z=1)) for k in range(6)]
    file = write(tmp_path / "crumbs.glb", parts)
    content = file.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    nodes = len(json.loads(content[20 : 20 + length])["nodes"])  # trimesh before 5 writes one around the seven
    with pytest.raises(ToolkitError, match=f"{nodes} parts, more than 5: join them"):
        load_world(file)
    assert nodes in (7, 8)


def test_no_free_spot(tmp_path: Path) -> None:
    posts = [painted(block((0.3, 0.3, 4), x, y, 0.5)) for x in range(-9, 10, 2) for y in range(-9, 10, 2)]
    with pytest.raises(ToolkitError, match="no place on its ground is free"):
        load_world(write(tmp_path / "posts.glb", [painted(block((20, 20, 0.5))), *posts]))


KIT_TOML = """
pieces = "kit"
scale = 5.0
tile = 2.0
rows = ["RR", "HR"]
place = [{ piece = "car_taxi", at = [5.0, 5.0, 0.5], yaw = 90 }]
[legend]
R = [{ piece = "road" }]
H = [{ piece = "road" }, { piece = "tower", class = "building", at = [0.0, 0.0, 0.1] }]
"""


@pytest.fixture
def kit(tmp_path: Path) -> Path:
    (tmp_path / "kit").mkdir()
    write(tmp_path / "kit" / "road.glb", [painted(block((2, 2, 0.1)), (90, 90, 90))])
    write(tmp_path / "kit" / "tower.glb", [painted(block((1, 1, 3)), (200, 60, 40))])
    write(tmp_path / "kit" / "car_taxi.glb", [painted(block((0.8, 0.4, 0.3)), (250, 200, 0))])
    (tmp_path / "town.toml").write_text(KIT_TOML)
    return tmp_path / "town.toml"


def test_a_kit_is_laid_from_north_to_south_in_metres(kit: Path) -> None:
    town = load_world(kit)
    assert town.core == pytest.approx(np.array([[-10, -10], [10, 10]]), abs=1e-3)
    tower = town.mesh.vertices[town.mesh.faces[town.face_class == SceneClass.BUILDING]].reshape(-1, 3)
    assert tower[:, 0].mean() == pytest.approx(-5, abs=0.1)  # the second row, first column: south west
    assert tower[:, 1].mean() == pytest.approx(-5, abs=0.1)
    assert tower[:, 2].max() == pytest.approx(15, abs=0.01)
    car = town.mesh.vertices[town.mesh.faces[town.face_class == SceneClass.VEHICLE]].reshape(-1, 3)
    assert np.ptp(car, axis=0) == pytest.approx([2.0, 4.0, 1.5], abs=0.01)  # turned by a quarter
    assert car[:, :2].mean(axis=0) == pytest.approx([5, 5], abs=0.1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('piece = "tower"', 'piece = "towr"', "piece.*towr.*tower"),
        ('rows = ["RR", "HR"]', 'rows = ["RR", "HX"]', "row 2 has 'X'"),
        ("scale = 5.0", "scale = 0", "field 'scale'"),
        ("scale = 5.0", "scale = 0.1", "m across"),
        ('pieces = "kit"', 'pieces = "../kit"', "leaves its folder"),
        ('pieces = "kit"', 'pieces = "kits"', "no folder"),
        ("tile = 2.0", "tile = 2.0\nsize = 3", "field 'size'"),
    ],
)
def test_a_wrong_layout_is_one_clear_line(kit: Path, old: str, new: str, message: str) -> None:
    kit.write_text(KIT_TOML.replace(old, new))
    with pytest.raises(ToolkitError, match=message) as caught:
        load_world(kit)
    assert "\n" not in str(caught.value)


def test_a_layout_of_very_many_pieces_is_refused_before_they_are_laid(kit: Path) -> None:
    rows, piece = '["' + "R" * 100_000 + '"]', '{ piece = "road" }, '
    text = KIT_TOML.replace('["RR", "HR"]', rows).replace("R = [{ piece", f"R = [{piece * 10_000}{{ piece")
    kit.write_text(text)  # a thousand million of them
    with pytest.raises(ToolkitError, match="more than 20,000 pieces: make the grid smaller"):
        load_world(kit)


@pytest.mark.parametrize("rows", ['[""]', '["  ", " "]'])
def test_a_layout_without_a_piece_is_one_clear_line(kit: Path, rows: str) -> None:
    place = next(line for line in KIT_TOML.splitlines() if line.startswith("place"))
    kit.write_text(KIT_TOML.replace('["RR", "HR"]', rows).replace(place, ""))
    with pytest.raises(ToolkitError, match="field 'rows': every cell is empty"):
        load_world(kit)


def test_a_kit_states_its_own_scale(kit: Path) -> None:
    with pytest.raises(ToolkitError, match="scale"):
        load_world(kit, scale=2.0)


@pytest.mark.skipif(not KIT.is_dir(), reason="the CC0 kit lies beside the checkout")
def test_a_published_kit(tmp_path: Path) -> None:
    (tmp_path / "kit").symlink_to(KIT)
    rows = '["ARB", "XJX", "CRD"]'
    legend = "\n".join(f'{letter} = [{{ piece = "building_{letter}" }}]' for letter in "ABCD")
    roads = (
        'R = [{ piece = "road_straight" }]\nX = [{ piece = "road_straight", yaw = 90 }]\n'
        'J = [{ piece = "road_junction" }]'
    )
    layout = f'pieces = "kit"\nscale = 4.5\ntile = 2.0\nrows = {rows}\n[legend]\n{legend}\n{roads}\n'
    (tmp_path / "town.toml").write_text(layout)
    with pytest.raises(ToolkitError, match="leaves its folder"):  # a link out of the folder is no way in
        load_world(tmp_path / "town.toml")
    (tmp_path / "kit").unlink()
    (tmp_path / "kit").mkdir()
    for file in KIT.iterdir():
        (tmp_path / "kit" / file.name).write_bytes(file.read_bytes())
    town = load_world(tmp_path / "town.toml")
    assert town.core == pytest.approx(np.array([[-13.5, -13.5], [13.5, 13.5]]), abs=0.1)
    assert {SceneClass.ROAD, SceneClass.BUILDING} <= {SceneClass(k) for k in np.unique(town.face_class)}
    assert town.spots[0].free_radius_m > 2
