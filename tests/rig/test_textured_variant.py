"""The variant `textured` and its controls: which texture, on which faces, and when it is shot again."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from toolkit.captures.manifest import read_manifest
from toolkit.captures.shoot import ShootSettings, shoot_plan
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.objects.export_mesh import to_glb
from toolkit.objects.load import load_object
from toolkit.objects.mesh import Material, hash_mesh, hash_shape
from toolkit.objects.painted import fit_texture
from toolkit.objects.records import encode_png, write_texture
from toolkit.rig import Pattern
from toolkit.rig.applied.texture import find_texture
from toolkit.rig.camera import Camera, project
from toolkit.rig.plan import make_plan, read_plan, write_plan
from toolkit.rig.variants import CONTROLS_OF, apply_booster, find_booster
from toolkit.rooms.worlds.content.modelling import assemble, box

SETTINGS = ShootSettings(backdrop="white", image_format="png")
PAINTED = ("textured", *CONTROLS_OF["textured"])
N = 16
RED = np.full((N, N, 3), (220, 20, 20), np.uint8)
SPEC = 'name = "{name}"\nclass = "crate"\nmesh = "block.glb"\nlength_mm = {mm}\nup = "y"\nfront = "z"\n'
ROOF, SLAB = np.array([0.0, 0.0, 60.0]), np.array([40.0, 20.0, 40.0])
"""Points on the upper part's and on the lower part's top, world mm."""


@pytest.fixture
def space(tmp_path):
    """Two objects `block` and `brick` of one mesh: a painted slab and a block of glass on it; a plan; no texture."""
    space = make_workspace(tmp_path / "space")
    parts = box((100, 60, 40), paint=(150, 150, 150))
    parts += [part.moved(z=30).painted((90, 90, 200), "glass") for part in box((40, 40, 20))]
    slab = assemble(parts, {"paint": (0.8, 0.0), "glass": (0.8, 0.0)}, 64)
    (space.objects_dir / "block.glb").write_bytes(to_glb(slab, "block"))
    for name in ("block", "brick"):
        (space.objects_dir / f"{name}.toml").write_text(SPEC.format(name=name, mm=100))
    items = [load_object(space.object_spec(name)) for name in ("block", "brick")]
    pattern = Pattern(name="ring", count=1, elevation_deg=(60, 60))
    write_plan(space.plan_file, make_plan(items, Camera.from_fov(128, 96), pattern))
    return space


@pytest.fixture
def block(space):
    return load_object(space.object_spec("block"))


@pytest.fixture
def blank(monkeypatch):
    """Pictures are black: for tests that ask which are taken, and not what they show."""

    class Blank:
        def render_many(self, views):
            return (self.render(*view) for view in views)

        def render(self, camera, _):
            return np.zeros((camera.height, camera.width, 3), np.float32)

    monkeypatch.setattr("toolkit.captures.shoot.make_renderer", lambda *_: Blank())


def save(space, pixels=RED, name="block", objects=("block",), keep=(), **more):
    items = {each: load_object(space.object_spec(each)) for each in objects}
    record = {
        "name": name, "class_name": "crate", "class_index": 1, "networks": [], "data": {}, "seed": 0, "settings": {},
        "final": {}, "toolkit_version": "0",
        "objects": [{"name": each, "mesh_sha256": item.shape_sha256, "keep": keep} for each, item in items.items()],
    }  # fmt: skip
    return write_texture(space.textures_dir, pixels, record, **more)


def shoot(space, variants, objects=("block",)):
    return shoot_plan(space, read_plan(space.plan_file), objects, variants, SETTINGS)


def picture(space, variant, name="block"):
    return np.asarray(Image.open(space.captures_dir / "sim" / name / variant / "pose_01.png"), float)


def seen_at(space, variant, point, reach=2):
    """Mean colour around a point of the object."""
    plan = read_plan(space.plan_file)
    place, _ = project(plan.camera, plan.objects["block"][0].matrix(), point[None])
    x, y = place[0].astype(int)
    return picture(space, variant)[y - reach : y + reach + 1, x - reach : x + reach + 1].mean(axis=(0, 1))


def is_red(colour):
    return colour[0] > 1.8 * colour[1:].max()


@pytest.mark.slow
def test_the_object_is_painted_and_the_table_is_not(space):
    save(space)
    shoot(space, ["unpatched", "textured"])
    for point in (ROOF, SLAB):
        assert is_red(seen_at(space, "textured", point)) and not is_red(seen_at(space, "unpatched", point))
    before, after = picture(space, "unpatched"), picture(space, "textured")
    corners = np.r_[0:8, -8:0]
    assert np.abs(after - before)[np.ix_(corners, corners)].max() < 12  # the same noise, a little of the red light


def test_texels_are_where_their_coordinates_say(space, block):
    """Texture coordinates are the object's own, row 0 at v = 1: a face has the colour of the texels it covers."""
    ramp = np.zeros((64, 64, 3), np.uint8)
    centres = (np.arange(64) + 0.5) * 4
    ramp[..., 0], ramp[..., 1], ramp[..., 2] = centres, centres[::-1, None], 128
    mesh = apply_booster(block, find_booster(space, block, "textured") if save(space, ramp) else None)
    assert len(mesh.faces) == len(block.mesh.faces)
    own, worn = block.mesh.uv[block.mesh.faces].mean(axis=1), mesh.uv[mesh.faces].mean(axis=1)
    np.testing.assert_allclose(worn, own, atol=1e-6)
    for face, (u, v) in enumerate(worn):
        texture = mesh.materials[mesh.face_material[face]].texture
        column, row = int(u * 64), int((1 - v) * 64)
        np.testing.assert_allclose(texture[row, column], [256 * u, 256 * v, 128], atol=4)


@pytest.mark.slow
def test_materials_and_images_keep_their_paint(space, block):
    save(space, keep=["glass"])
    shoot(space, ["unpatched", "textured"])
    assert is_red(seen_at(space, "textured", SLAB)) and not is_red(seen_at(space, "textured", ROOF))
    np.testing.assert_allclose(seen_at(space, "textured", ROOF), seen_at(space, "unpatched", ROOF), atol=8)

    mask = np.zeros((64, 64), bool)  # what the roof's material covers, said by an image instead
    glass = [index for index, material in enumerate(block.mesh.materials) if material.name == "glass"]
    corners = block.mesh.uv[block.mesh.faces[np.isin(block.mesh.face_material, glass)]].reshape(-1, 2)
    (left, low), (right, high) = corners.min(axis=0) * 64, corners.max(axis=0) * 64
    mask[int(64 - high) : int(65 - low), int(left) : int(right + 1)] = True
    by_material = fit_texture(block, find_texture(space, block)).trained
    save(space, keep_images={"block": mask})
    np.testing.assert_array_equal(fit_texture(block, find_texture(space, block)).trained, by_material)
    assert by_material.any() and not by_material.all()
    assert shoot(space, ["unpatched", "textured"]).shot == 1
    assert is_red(seen_at(space, "textured", SLAB)) and not is_red(seen_at(space, "textured", ROOF))


@pytest.mark.slow
def test_controls_take_the_textures_place(space, block):
    save(space, keep=["glass"])
    boosters = {variant: find_booster(space, block, variant) for variant in PAINTED}
    assert {booster.pixels.shape for booster in boosters.values()} == {(N, N, 3)}
    assert np.ptp(boosters["grey-texture"].pixels) == 0 and boosters["random-texture"].pixels.std() > 60
    again = find_booster(space, block, "random-texture")
    np.testing.assert_array_equal(again.pixels, boosters["random-texture"].pixels)
    other = find_texture(space, block)
    assert boosters["textured"].sha256 == other.record.png_sha256 and boosters["textured"].name == "block"
    shoot(space, ["unpatched", *PAINTED])
    grey = seen_at(space, "grey-texture", SLAB)
    assert np.ptp(grey) < 10 and not is_red(grey)
    for variant in PAINTED:
        np.testing.assert_allclose(seen_at(space, variant, ROOF), seen_at(space, "unpatched", ROOF), atol=8)
    records = read_manifest(space.captures_dir / "sim")
    assert {record.booster_sha256 for record in records.values()} == {
        None, *(booster.sha256 for booster in boosters.values()),
    }  # fmt: skip
    made = records["block/textured/pose_01.png"].made
    assert (made["booster"], made["booster_px"], "booster_mm" in made) == ("block", N, False)


@pytest.mark.slow
def test_stored_coordinates_are_used(space, block):
    """An object that was unwrapped: each triangle is given a corner of the texture, half of them red."""
    m = len(block.mesh.faces)
    left = np.array([[0.05, 0.05], [0.4, 0.05], [0.05, 0.9]], np.float32)
    right = left + np.float32([0.5, 0])
    up = (block.mesh.normals[block.mesh.faces].mean(axis=1)[:, 2] > 0.9)[:, None, None]
    pixels = np.full((N, N, 3), (20, 20, 20), np.uint8)
    pixels[:, : N // 2] = (220, 20, 20)
    save(space, pixels, corner_uv={"block": np.where(up, left, right)})
    shoot(space, ["textured"])
    assert is_red(seen_at(space, "textured", SLAB))
    side = np.array([50.0, 0, 20])
    assert not is_red(seen_at(space, "textured", side)) and seen_at(space, "textured", side).max() < 90
    assert fit_texture(block, find_texture(space, block)).unwrapped
    save(space, pixels, corner_uv={"block": np.repeat(left[None], m - 1, axis=0)})
    with pytest.raises(ToolkitError, match=rf"coordinates of {m - 1} triangles, the object has {m}: train again"):
        shoot(space, ["textured"])


def test_only_what_changed_is_shot_again(space, blank):
    save(space)
    assert shoot(space, ["unpatched", *PAINTED]).shot == 4
    assert shoot(space, ["unpatched", *PAINTED]).shot == 0
    save(space, RED // 2)
    assert shoot(space, ["unpatched", *PAINTED]).shot == 1  # grey and noise are of the same texels
    save(space, RED // 2, keep=["glass"])
    assert shoot(space, ["unpatched", *PAINTED]).shot == 3
    save(space, np.full((N + 4, N + 4, 3), 9, np.uint8), keep=["glass"])
    assert shoot(space, ["unpatched", *PAINTED]).shot == 3


def test_a_universal_texture_and_one_of_its_own(space, block, blank):
    """One record for several objects; a texture of the object's name wins, whatever lies beside it."""
    save(space, name="all-blocks", objects=("block", "brick"))
    brick = load_object(space.object_spec("brick"))
    assert {find_texture(space, item).record.name for item in (block, brick)} == {"all-blocks"}
    assert shoot(space, ["textured"], ["block", "brick"]).shot == 2
    save(space, RED // 2, name="block")
    assert find_texture(space, block).record.name == "block" and find_texture(space, brick).record.name == "all-blocks"
    for suffix in ("png", "json"):
        (space.textures_dir / f"all-blocks.{suffix}").unlink()
    (space.textures_dir / "turntable.png").write_bytes(encode_png(RED))  # no texture: it has no record
    with pytest.raises(ToolkitError, match="no texture for object 'brick': run 'toolkit train-texture"):
        find_texture(space, brick)
    save(space, name="brick")  # named like it, and of another object
    with pytest.raises(ToolkitError, match="--object brick'"):
        find_texture(space, brick)
    (space.textures_dir / "brick.json").unlink()
    with pytest.raises(ToolkitError, match=r"brick\.png has no record"):
        find_texture(space, brick)


@pytest.mark.parametrize("variant", PAINTED)
def test_what_is_missing_or_does_not_fit_is_said_before_anything_is_shot(space, variant, blank):
    with pytest.raises(ToolkitError, match="no texture for object 'block': run 'toolkit train-texture --object"):
        shoot(space, ["unpatched", variant])
    save(space)
    (space.objects_dir / "block.toml").write_text(SPEC.format(name="block", mm=99))
    with pytest.raises(
        ToolkitError, match="block: the object's mesh changed after training of its texture 'block'"
    ) as why:
        shoot(space, ["unpatched", variant])
    assert "train again with 'toolkit train-texture --object block'" in str(why.value) and "\n" not in str(why.value)
    (space.objects_dir / "block.toml").write_text(SPEC.format(name="block", mm=100))
    png = space.textures_dir / "block.png"
    png.write_bytes(png.read_bytes()[:-20])
    with pytest.raises(ToolkitError, match=r"block\.png: its hash"):
        shoot(space, ["unpatched", variant])
    assert not list(space.captures_dir.rglob("*.png"))


def test_the_mesh_is_hashed_once_for_all_variants(space, monkeypatch, blank):
    save(space)
    calls = []
    for name in ("hash_mesh", "hash_shape"):
        real = {"hash_mesh": hash_mesh, "hash_shape": hash_shape}[name]
        monkeypatch.setattr(f"toolkit.objects.load.{name}", lambda mesh, n=name, f=real: (calls.append(n), f(mesh))[1])
    shoot(space, ["unpatched", *PAINTED])
    assert sorted(calls) == ["hash_mesh", "hash_shape"]


def test_what_the_shapes_hash_sees(block):
    mesh = block.mesh
    gold = Material(mesh.materials[0].name, 255 - mesh.materials[0].texture, 0.1, 1.0)
    repainted = replace(mesh, materials=(gold, *mesh.materials[1:]))
    assert hash_shape(repainted) == hash_shape(mesh) and hash_mesh(repainted) != hash_mesh(mesh)
    signed = np.where(mesh.vertices == 0, np.float32(-0.0), mesh.vertices)
    assert np.signbit(signed).sum() != np.signbit(mesh.vertices).sum()
    assert hash_shape(replace(mesh, vertices=signed)) == hash_shape(mesh)
    renamed = replace(mesh.materials[0], name="glass2")
    for changed in (
        replace(mesh, vertices=mesh.vertices + np.float32(0.02)),
        replace(mesh, uv=mesh.uv * np.float32(0.999)),
        replace(mesh, faces=mesh.faces[::-1].copy()),
        replace(mesh, face_material=mesh.face_material[::-1].copy()),
        replace(mesh, materials=(renamed, *mesh.materials[1:])),
    ):
        assert hash_shape(changed) != hash_shape(mesh)


def test_a_shape_is_the_same_on_a_machine_whose_sines_end_otherwise(block):
    """Such a machine refused the textures that come with the kit."""
    rng = np.random.default_rng(0)
    towards = np.where(rng.random(block.mesh.vertices.shape) < 0.5, -np.inf, np.inf).astype(np.float32)
    elsewhere = replace(block, mesh=replace(block.mesh, vertices=np.nextafter(block.mesh.vertices, towards)))
    assert hash_shape(elsewhere.mesh, is_exact=True) != hash_shape(block.mesh, is_exact=True)
    assert elsewhere.has_shape(block.shape_sha256)
    assert block.has_shape(hash_shape(block.mesh, is_exact=True)), "older records stay good"
