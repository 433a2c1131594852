"""GLB files as another program reads them."""

from io import BytesIO

import numpy as np
import pytest
import trimesh

from toolkit.objects.export_mesh import to_glb
from toolkit.objects.load import read_mesh, turn_upright
from toolkit.objects.mesh import merge_meshes


@pytest.fixture(scope="module")
def mesh(make_box):
    return merge_meshes([make_box((100, 60, 40), (200, 40, 30), 0.3), make_box((20, 30, 50), (20, 60, 200), 0.9)])


def test_it_has_the_same_shape_in_metres_with_y_up(mesh):
    scene = trimesh.load_scene(BytesIO(to_glb(mesh, "crate")), file_type="glb")
    np.testing.assert_allclose(scene.extents, [0.060, 0.050, 0.100], rtol=1e-5)  # left, up, front
    assert sum(len(piece.faces) for piece in scene.geometry.values()) == 24
    assert scene.bounds[0, 1] == pytest.approx(0, abs=1e-7)
    assert scene.volume == pytest.approx((0.1 * 0.06 * 0.04) + (0.02 * 0.03 * 0.05), rel=1e-4)


def test_it_carries_materials_and_pictures(mesh):
    scene = trimesh.load_scene(BytesIO(to_glb(mesh, "crate")), file_type="glb")
    looks = [piece.visual.material for piece in scene.geometry.values()]
    assert sorted(round(look.roughnessFactor, 3) for look in looks) == [0.3, 0.9]
    by_roughness = {round(look.roughnessFactor, 1): look.baseColorTexture.convert("RGB") for look in looks}
    for roughness, colour in ((0.3, (200, 40, 30)), (0.9, (20, 60, 200))):
        texels = {texel for _, texel in by_roughness[roughness].getcolors()}
        assert texels == {colour, (128, 128, 128)}  # the paint, and the atlas' empty ground


def test_what_is_written_is_read_back_the_same(mesh, tmp_path):
    file = tmp_path / "crate.glb"
    file.write_bytes(to_glb(mesh, "crate"))
    again = turn_upright(read_mesh(file), "y", "z")
    np.testing.assert_allclose(again.size_mm * 1000, mesh.size_mm, rtol=1e-5)
    ours, theirs = (
        np.sort(np.round(m.vertices[m.faces].mean(axis=1) * scale, 2).view("f4,f4,f4"), axis=0)
        for m, scale in ((mesh, 1), (again, 1000))
    )
    assert len(ours) == len(theirs)
    np.testing.assert_allclose(ours.view("f4").reshape(-1, 3), theirs.view("f4").reshape(-1, 3), atol=0.011)
