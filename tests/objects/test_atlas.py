"""Objects made ready for a trained texture: whose coordinates, which faces, and that nothing bleeds."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from kernel_samples import sample
from slow_cases import mark_slow

from toolkit.core.errors import ToolkitError
from toolkit.objects.atlas import apply_texture, dilate, make_atlas, take_paint
from toolkit.objects.load import build_mesh, read_mesh
from toolkit.objects.mesh import Material, Mesh, make_ray_scene, mesh_from_corners, place_on_table
from toolkit.rig.camera import Camera, orbit_pose, pixel_rays


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """A function (name) -> one of a few shapes read from an STL, which has no texture coordinates."""
    folder = tmp_path_factory.mktemp("bare")
    shapes = {
        "sphere": trimesh.creation.icosphere(3),
        "cube": trimesh.creation.box((1, 1, 1)),
        "torus": trimesh.creation.torus(1, 0.4),
    }

    def read(name: str) -> Mesh:
        shapes[name].export(folder / f"{name}.stl")
        return place_on_table(read_mesh(folder / f"{name}.stl"), 200)

    return read


def a_square(uv, texture=None) -> Mesh:
    """Two triangles facing up, 100 mm a side, with these four texture coordinates counter-clockwise."""
    corners = np.array([[0, 0, 0], [100, 0, 0], [100, 100, 0], [0, 100, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    paint = Material("paint", np.full((4, 4, 3), 90, np.uint8) if texture is None else texture, 0.3, 0.7)
    return mesh_from_corners(corners, faces, np.array(uv, np.float32)[faces], np.zeros(2, int), (paint,))


UNIT_SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))


def colours(n: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (n, n, 3), dtype=np.uint8)


def corners_of(mesh: Mesh, values: np.ndarray) -> np.ndarray:
    return values[mesh.faces]


def seen(mesh: Mesh, azimuth_deg: float, size: int = 120):
    """Triangles, barycentrics and texture coordinates at the pixels that see the mesh."""
    import open3d as o3d

    camera = Camera.from_fov(size, size)
    distance = 2.0 * float(mesh.size_mm.max())
    pose = orbit_pose([0, 0, mesh.size_mm[2] / 2], azimuth_deg, 25, distance)
    y, x = np.mgrid[:size, :size] + 0.5
    rays = pixel_rays(camera, pose, np.stack([x, y], -1).reshape(-1, 2).astype(np.float32))
    hits = make_ray_scene(mesh).cast_rays(o3d.core.Tensor(rays))
    on = np.isfinite(hits["t_hit"].numpy())
    triangle = hits["primitive_ids"].numpy()[on].astype(int)
    b, c = hits["primitive_uvs"].numpy()[on].T
    weights = np.column_stack([1 - b - c, b, c])
    return triangle, weights, np.einsum("kc,kci->ki", weights, mesh.uv[mesh.faces[triangle]].astype(float))


def texel_of(uv: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    return tuple(np.clip(np.floor(np.stack([1 - uv[:, 1], uv[:, 0]]) * n).astype(int), 0, n - 1))


@pytest.mark.parametrize("name", ["sphere", "cube", "torus"])
def test_a_mesh_without_coordinates_is_unwrapped_and_otherwise_stays_the_same(bare, name):
    mesh = bare(name)
    atlas = make_atlas(mesh, 64)
    assert atlas.unwrapped and atlas.trained.all()
    for values in ("vertices", "normals"):
        np.testing.assert_array_equal(
            corners_of(atlas.mesh, getattr(atlas.mesh, values)), corners_of(mesh, getattr(mesh, values))
        )
    assert len(atlas.mesh.vertices) <= 3 * len(mesh.faces)
    assert atlas.mesh.faces.max() == len(atlas.mesh.vertices) - 1


@pytest.mark.parametrize("name", ["sphere", "cube", "torus"])
def test_a_texture_of_coordinates_comes_back_to_half_a_texel(bare, name):
    n = 64
    atlas = make_atlas(bare(name), n)
    row, column = np.mgrid[:n, :n]
    own = np.stack([column, row, column * 0], axis=-1).astype(np.uint8)
    worn = apply_texture(atlas, own)
    _, _, uv = seen(worn, 40)
    at = worn.materials[0].texture[texel_of(uv, n)].astype(float)
    wanted = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1) * n - 0.5
    assert np.abs(at[:, :2] - wanted).max() <= 0.5 + 1e-3


@pytest.mark.parametrize("name", mark_slow(["racer", "coffeepot"], "racer"))
def test_every_visible_texel_of_a_built_in_object_is_covered(name):
    mesh, n = build_mesh(name), 1024
    atlas = make_atlas(mesh, n)
    assert not atlas.unwrapped
    for azimuth in (20, 200):
        triangle, _, uv = seen(atlas.mesh, azimuth, 200)
        inside = np.abs(uv * n - np.round(uv * n)).min(axis=1) > 1e-3  # on a border rounding decides
        assert atlas.trained[triangle].all() and inside.mean() > 0.9
        assert atlas.covered[texel_of(uv[inside], n)].all()


def test_a_built_in_object_keeps_its_coordinates_and_gets_one_sheet():
    mesh = build_mesh("racer")
    atlas = make_atlas(mesh, 200)
    np.testing.assert_array_equal(atlas.mesh.uv, mesh.uv)
    np.testing.assert_array_equal(atlas.mesh.faces, mesh.faces)
    worn = apply_texture(atlas, colours(200))
    assert len({id(m.texture) for m in worn.materials}) == 1
    assert [m.name for m in worn.materials] == [m.name for m in mesh.materials]
    assert [m.roughness for m in worn.materials] == [m.roughness for m in mesh.materials]
    assert {m.metallic for m in worn.materials} == {0.0}


def test_kept_materials_stay_as_they_were():
    mesh = build_mesh("racer")
    atlas = make_atlas(mesh, 64, keep=["rubber", "metal"])
    worn = apply_texture(atlas, colours(64))
    names = np.array([m.name for m in mesh.materials])[mesh.face_material]
    np.testing.assert_array_equal(atlas.trained, ~np.isin(names, ["rubber", "metal"]))
    for index, material in enumerate(worn.materials):
        before = next(m for m in mesh.materials if m.name == material.name)
        faces = worn.face_material == index
        assert (names[faces] == material.name).all()
        assert (material is before) == (material.name in ("rubber", "metal")) == (not atlas.trained[faces].any())


def test_kept_faces_keep_their_coordinates_when_the_rest_is_unwrapped():
    mesh = build_mesh("coffeepot")
    atlas = make_atlas(mesh, 64, keep=["trim"], unwrap=True)
    assert atlas.unwrapped
    kept, trained = ~atlas.trained, atlas.trained
    np.testing.assert_array_equal(atlas.corner_uv[kept], mesh.uv[mesh.faces[kept]])
    assert (atlas.corner_uv[trained] != mesh.uv[mesh.faces[trained]]).any()


def test_an_image_keeps_the_faces_mostly_under_it():
    uv = np.array([[0, 0], [0.4, 0], [0.6, 0], [1, 0], [0, 1], [0.4, 1], [0.6, 1], [1, 1]], np.float32)
    faces = np.array([[0, 1, 5], [0, 5, 4], [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6]])
    places = np.column_stack([uv * 100, np.zeros(8)]).astype(np.float32)
    paint = Material("paint", np.full((4, 4, 3), 90, np.uint8))
    mesh = mesh_from_corners(places, faces, uv[faces], np.zeros(6, int), (paint,))
    marks = np.zeros((10, 20), bool)
    marks[:, 13:] = True  # u > 0.65: the right strip of faces but for a bit
    atlas = make_atlas(mesh, 16, keep_image=marks)
    np.testing.assert_array_equal(atlas.trained, [True, True, True, True, False, False])
    assert [m.name for m in atlas.mesh.materials] == ["paint", "paint"]
    assert atlas.mesh.materials[0] is paint and atlas.mesh.materials[1] is not paint
    marks = np.zeros((10, 20), bool)
    marks[:5, :8] = True  # row 0 is v = 1: the upper half of the left strip, most of its upper triangle
    np.testing.assert_array_equal(make_atlas(mesh, 16, keep_image=marks).trained, [True, False, True, True, True, True])


def test_mirrored_halves_may_share_texels():
    mesh = a_square(((0, 0), (1, 0), (1, 1), (0, 0)))
    mirrored = replace(mesh, uv=mesh.uv * [[0.5, 1]])
    both = Mesh(
        np.concatenate([mesh.vertices, -mesh.vertices]), np.concatenate([mesh.normals, mesh.normals]),
        np.concatenate([mirrored.uv, mirrored.uv]).astype(np.float32),
        np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices)]), np.zeros(4, np.int32), mesh.materials,
    )  # fmt: skip
    one, two = make_atlas(mirrored, 32, unwrap=False), make_atlas(both, 32, unwrap=False)
    np.testing.assert_array_equal(one.covered, two.covered)


def test_own_coordinates_are_used_only_where_they_can_carry_a_texture():
    assert not make_atlas(a_square(UNIT_SQUARE), 16).unwrapped
    assert not make_atlas(a_square(np.array(UNIT_SQUARE) + 2e-4), 16).unwrapped  # a rounding
    assert make_atlas(a_square(np.array(UNIT_SQUARE) * 2), 16).unwrapped
    assert make_atlas(a_square(((0, 0), (1, 0), (1, 1), (0.5, 0.5))), 16).unwrapped  # half of it has no area
    assert make_atlas(a_square(UNIT_SQUARE), 16, unwrap=True).unwrapped
    square = a_square(UNIT_SQUARE)
    other = Material("other", np.full((4, 4, 3), 10, np.uint8))
    two = replace(square, materials=(*square.materials, other), face_material=np.array([0, 1], np.int32))
    assert make_atlas(two, 16).unwrapped
    assert not make_atlas(two, 16, keep=["other"]).unwrapped  # one sheet among those that are trained
    same = replace(other, texture=square.materials[0].texture.copy())
    assert not make_atlas(replace(two, materials=(square.materials[0], same)), 16).unwrapped


def test_the_edges_at_one_belong_to_the_last_texels():
    atlas = make_atlas(a_square(UNIT_SQUARE), 8)
    assert atlas.covered.all()
    np.testing.assert_array_equal(atlas.source, np.arange(64).reshape(8, 8))
    edge = make_atlas(a_square(((1, 1), (1, 1), (1, 0), (1, 0))), 8, unwrap=None)
    assert edge.unwrapped  # a line on the texture carries nothing


def test_stored_coordinates_give_the_same_atlas(bare):
    mesh = bare("torus")
    first = make_atlas(mesh, 64)
    again = make_atlas(mesh, 64, corner_uv=first.corner_uv)
    assert again.unwrapped
    for name in ("vertices", "normals", "uv", "faces", "face_material"):
        np.testing.assert_array_equal(getattr(again.mesh, name), getattr(first.mesh, name))
    np.testing.assert_array_equal(again.source, first.source)


def test_uncovered_texels_take_the_nearest_covered_colour(bare):
    n = 64
    atlas = make_atlas(bare("cube"), n)
    texture = colours(n)
    spread = dilate(texture, atlas)
    np.testing.assert_array_equal(spread[atlas.covered], texture[atlas.covered])
    np.testing.assert_array_equal(dilate(spread, atlas), spread)
    np.testing.assert_array_equal(apply_texture(atlas, texture).materials[0].texture, spread)
    texture[~atlas.covered] = 0
    np.testing.assert_array_equal(dilate(texture, atlas), spread)  # whatever was there


def test_the_paint_of_ones_own_coordinates_is_the_picture_itself():
    n = 16
    mesh = a_square(UNIT_SQUARE, colours(n))
    np.testing.assert_array_equal(take_paint(make_atlas(mesh, n), mesh), colours(n))


def test_paint_of_one_colour_is_that_colour_and_needs_no_looking(monkeypatch):
    plain = np.full((8, 8, 3), (200, 90, 10), np.uint8)
    spotted = plain.copy()
    spotted[0, 0] = 0  # where the square below does not reach, so that each texel is looked up
    square = np.array(UNIT_SQUARE) * 0.5
    looked_up = a_square(square, spotted)
    wanted = take_paint(make_atlas(looked_up, 16), looked_up)
    monkeypatch.setattr("toolkit.objects.atlas._middles", None)
    mesh = a_square(square, plain)
    np.testing.assert_array_equal(take_paint(make_atlas(mesh, 16), mesh), wanted)


def test_paint_of_finer_pictures_is_their_mean_light():
    """A chessboard of two squares a texel is as bright as half of the light: 188 of 255, not 128."""
    board = np.indices((32, 32)).sum(axis=0) % 2 * 255
    mesh = a_square(UNIT_SQUARE, np.repeat(board[..., None], 3, axis=2).astype(np.uint8))
    assert np.abs(take_paint(make_atlas(mesh, 16), mesh).astype(int) - 188).max() < 12


@pytest.mark.parametrize("unwrap", mark_slow([False, True], True))
def test_in_its_paint_an_object_looks_as_before(unwrap):
    mesh, n = build_mesh("eggnog"), 384
    atlas = make_atlas(mesh, n, unwrap=unwrap)
    worn = apply_texture(atlas, take_paint(atlas, mesh))
    triangle, weights, uv = seen(atlas.mesh, 20)
    sheet = worn.materials[worn.face_material[triangle[0]]].texture
    now = sheet[texel_of(uv, n)].astype(int)
    own_uv = np.einsum("kc,kci->ki", weights, mesh.uv[mesh.faces[triangle]].astype(float))
    before = np.empty_like(now)
    for k, material in enumerate(mesh.materials):
        of_it = mesh.face_material[triangle] == k
        height, width = material.texture.shape[:2]
        column, row = own_uv[of_it, 0] * width, (1 - own_uv[of_it, 1]) * height
        before[of_it] = material.texture[row.astype(int) % height, column.astype(int) % width]
    error = np.abs(now - before).max(axis=1)
    assert np.median(error) <= 2 and (error < 40).mean() > 0.95, "but along the edges of its label"


def test_seams_do_not_bleed(bare):
    """Each side of a cube in one colour: filtered look-ups right up to its edges give that colour."""
    n = 64
    atlas = make_atlas(bare("cube"), n)
    corners = atlas.mesh.vertices[atlas.mesh.faces].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    side = np.unique(np.round(normals / np.abs(normals).max(axis=1, keepdims=True)), axis=0, return_inverse=True)[1]
    side = side.reshape(-1)
    assert side.max() == 5
    from toolkit.objects.atlas import cover_texels

    palette = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0], [0, 255, 255], [255, 0, 255]], np.uint8)
    texture = np.zeros((n, n, 3), np.uint8)
    for i in range(6):
        texture[cover_texels(atlas.corner_uv[side == i], n)] = palette[i]
    rng = np.random.default_rng(0)
    weights = rng.dirichlet((0.2, 0.2, 0.2), (len(side), 400))  # mostly near edges and corners
    uv = np.einsum("mkc,mci->mki", weights, atlas.corner_uv.astype(float)).reshape(-1, 2)
    wanted = np.repeat(palette[side], 400, axis=0) / 255

    def errors(pixels: np.ndarray, level: int) -> np.ndarray:
        return np.abs(sample(pixels, *uv.T, level) - wanted).max(axis=1)

    spread = apply_texture(atlas, texture).materials[0].texture
    assert errors(spread, 0).max() < 1e-3
    # a texel of level 1 is two wide: where two sides lie two texels apart, a little of the other is in reach
    assert errors(spread, 1).max() < 0.15 and errors(texture, 1).max() > 0.4
    assert errors(spread, 2).max() < 0.3 and errors(texture, 2).max() > 0.6


def test_a_chart_of_ones_own_does_not_take_in_the_ground():
    """White up to a border between texels: without spreading, half of every look-up there is ground."""
    n = 16
    atlas = make_atlas(a_square(0.25 + 0.5 * np.array(UNIT_SQUARE)), n)
    assert not atlas.unwrapped and atlas.covered.sum() == 64
    texture = np.where(atlas.covered[..., None], 255, 0).astype(np.uint8).repeat(3, axis=-1)
    edge = np.column_stack([np.linspace(0.25, 0.75, 33), np.full(33, 0.75)])
    worn = apply_texture(atlas, texture).materials[0].texture
    assert texture.shape == (n, n, 3)
    for level in range(3):
        np.testing.assert_allclose(sample(worn, *edge.T, level), 1, atol=1e-5)
    assert sample(texture, *edge.T).max() < 0.51


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"keep": ["tyre"]}, "'tyre'.*it has paint"),
        ({"keep": ["paint"]}, "nothing is left to train"),
        ({"keep_image": np.ones((4, 4), bool)}, "nothing is left to train"),
        ({"keep_image": np.ones((4, 4, 3), bool)}, r"\(height, width\).*\(4, 4, 3\)"),
        ({"keep_image": np.ones((4, 4), np.uint8)}, "True and False, found uint8"),
        ({"n": 7}, "8 to 1024 texels, found 7"),
        ({"n": 1025}, "found 1025"),
        ({"n": 20.5}, "found 20.5"),
        ({"corner_uv": np.zeros((3, 3, 2), np.float32)}, r"expected 2×3×2.*\(3, 3, 2\).*another mesh"),
        ({"corner_uv": np.full((2, 3, 2), np.nan, np.float32)}, "NaN"),
    ],
)
def test_what_does_not_fit_is_said_in_one_line(arguments, said):
    with pytest.raises(ToolkitError, match=said) as caught:
        make_atlas(a_square(UNIT_SQUARE), **{"n": 16, **arguments})
    assert "\n" not in str(caught.value)


def test_a_mesh_without_coordinates_cannot_be_masked_by_an_image_nor_keep_its_own(bare):
    with pytest.raises(ToolkitError, match="no texture coordinates; name materials"):
        make_atlas(bare("cube"), 16, keep_image=np.zeros((4, 4), bool))
    with pytest.raises(ToolkitError, match="no texture coordinates: let new coordinates be made"):
        make_atlas(bare("cube"), 16, unwrap=False)
    with pytest.raises(ToolkitError, match="repeat the texture too often"):
        make_atlas(a_square(np.array(UNIT_SQUARE) * 50), 16, unwrap=False)


def test_a_texture_of_another_size_is_refused(bare):
    atlas = make_atlas(bare("cube"), 16)
    for wrong in (np.zeros((17, 17, 3), np.uint8), np.zeros((16, 16, 3), np.float32), np.zeros((16, 16, 4), np.uint8)):
        with pytest.raises(ToolkitError, match="16×16 RGB pixels of 8 bits"):
            apply_texture(atlas, wrong)


@pytest.mark.parametrize(
    ("file", "unwrapped"),
    [
        ("warplane_highpoly.ply", False),
        ("carton_lowpoly/carton_kenney.obj", False),
        ("racer_lowpoly/racer_kenney.obj", False),
    ],
)
def test_meshes_made_by_others(shared, file, unwrapped):
    path = shared / "meshes" / file
    if not path.is_file():
        pytest.skip(f"needs {path}, which is not here")
    mesh, n = place_on_table(read_mesh(path), 270), 200
    atlas = make_atlas(mesh, n)
    assert atlas.unwrapped == unwrapped and 0.4 < atlas.covered.mean() < 0.9
    _, _, uv = seen(atlas.mesh, 30, 160)
    inside = np.abs(uv * n - np.round(uv * n)).min(axis=1) > 1e-3
    assert atlas.covered[texel_of(uv[inside], n)].all()
