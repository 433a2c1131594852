"""USDZ files as OpenUSD's own library reads and checks them."""

import sys
import zipfile
from io import BytesIO

import numpy as np
import pytest
from one_line import error_of
from PIL import Image

from toolkit.objects.mesh import merge_meshes
from toolkit.objects.usdz import to_usdz


@pytest.fixture(scope="module")
def mesh(make_box):
    return merge_meshes([make_box((100, 60, 40), (200, 40, 30), 0.3), make_box((20, 30, 50), (20, 60, 200), 0.9)])


@pytest.fixture
def stage(mesh, tmp_path):
    pytest.importorskip("pxr", reason="needs the extra usd")
    from pxr import Usd

    (tmp_path / "crate.usdz").write_bytes(to_usdz(mesh, "crate 1"))
    return Usd.Stage.Open(str(tmp_path / "crate.usdz"))


def test_it_is_in_metres_with_y_up(stage):
    from pxr import Usd, UsdGeom

    assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    assert str(stage.GetDefaultPrim().GetPath()) == "/crate_1"
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
    box = cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
    np.testing.assert_allclose(box.GetMin(), [-0.03, 0, -0.05], atol=1e-6)  # left, up, front
    np.testing.assert_allclose(box.GetMax(), [0.03, 0.05, 0.05], atol=1e-6)


def test_shape_coordinates_and_pictures_are_the_objects(mesh, stage, tmp_path):
    from pxr import UsdGeom, UsdShade

    pieces = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert len(pieces) == len(mesh.materials) and sum(len(one.GetFaceVertexCountsAttr().Get()) for one in pieces) == 24
    with zipfile.ZipFile(tmp_path / "crate.usdz") as package:
        # the format asks for files that are stored as they are, each from a multiple of 64 bytes
        assert all(one.compress_type == zipfile.ZIP_STORED for one in package.infolist())
        pictures = {name: np.asarray(Image.open(BytesIO(package.read(name)))) for name in package.namelist()[1:]}
    for index, piece in enumerate(pieces):
        corners = np.array(piece.GetFaceVertexIndicesAttr().Get())
        points = np.array(piece.GetPointsAttr().Get())[corners]
        rows = mesh.faces[mesh.face_material == index].reshape(-1)
        x, y, z = mesh.vertices[rows].T / 1000
        np.testing.assert_allclose(points, np.stack([y, z, x], axis=1), atol=1e-6)
        st = np.array(UsdGeom.PrimvarsAPI(piece).GetPrimvar("st").Get())[corners]
        np.testing.assert_allclose(st, mesh.uv[rows], atol=1e-6)
        look = UsdShade.MaterialBindingAPI(piece).ComputeBoundMaterial()[0]
        surface = look.ComputeSurfaceSource()[0]
        assert surface.GetInput("roughness").Get() == pytest.approx(mesh.materials[index].roughness)
        texture = UsdShade.Shader(surface.GetInput("diffuseColor").GetConnectedSources()[0][0].source)
        assert np.array_equal(pictures[texture.GetInput("file").Get().path], mesh.materials[index].texture)


def test_openusds_checks_find_nothing(stage):
    usd_validation = pytest.importorskip("pxr.UsdValidation", reason="needs usd-core with UsdValidation")
    registry = usd_validation.ValidationRegistry()
    found = usd_validation.ValidationContext(registry.GetOrLoadAllValidators()).Validate(stage)
    assert [error.GetMessage() for error in found] == []


def test_the_same_mesh_gives_the_same_bytes(mesh):
    pytest.importorskip("pxr", reason="needs the extra usd")
    assert to_usdz(mesh, "crate") == to_usdz(mesh, "crate")


def test_without_the_extra_a_line_names_it(mesh, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    assert "pip install '.[usd]'" in error_of(lambda: to_usdz(mesh, "crate"))
