"""A mesh as USDZ, for phones, Omniverse and Blender: a single file with its pictures, in metres, y up."""

import os
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

import numpy as np

from toolkit.core.extras import import_package
from toolkit.core.files import write_bytes
from toolkit.objects.export_mesh import MM_PER_M, T_GLTF_WORLD, unit_normals
from toolkit.objects.mesh import Mesh
from toolkit.objects.records import encode_png

MADE_S = 946_728_000
"""Time of a package's files, seconds since 1970: noon of 1 January 2000, so that bytes do not change."""


def to_usdz(mesh: Mesh, name: str) -> bytes:
    """Write a USDZ package of an object in millimetres: a mesh for each material, with USD's own preview surface.

    Faces are drawn from both sides, as in the rig. The same mesh gives the same bytes.

    Raises:
        ToolkitError: usd-core is not installed.

    Source: OpenUSD, "Usdz file format specification" 1.3 and "UsdPreviewSurface specification" 2.6.
    """
    usd = _import_usd()
    with TemporaryDirectory() as folder:
        layer = Path(folder) / "object.usdc"
        stage = usd.Usd.Stage.CreateNew(str(layer))
        # phones and glTF have y up; USD states its axis and unit
        usd.UsdGeom.SetStageUpAxis(stage, usd.UsdGeom.Tokens.y)
        usd.UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        root = usd.UsdGeom.Xform.Define(stage, f"/{usd.Tf.MakeValidIdentifier(name)}")
        stage.SetDefaultPrim(root.GetPrim())
        # ARKit asks for a kind of the whole
        usd.Usd.ModelAPI(root.GetPrim()).SetKind("component")
        pictures: dict[int, str] = {}
        for index, material in enumerate(mesh.materials):
            rows = np.flatnonzero(mesh.face_material == index)
            if not len(rows):
                continue
            # materials that share a picture share its file
            picture = pictures.setdefault(id(material.texture), f"picture{len(pictures) + 1}.png")
            if not (Path(folder) / picture).exists():
                write_bytes(Path(folder) / picture, encode_png(material.texture))
            place = root.GetPath().AppendChild(f"piece{index + 1}")
            piece = _add_piece(usd, stage, place, mesh, rows)
            look = _add_look(usd, stage, place.AppendChild("look"), picture, material)
            usd.UsdShade.MaterialBindingAPI.Apply(piece.GetPrim()).Bind(look)
        stage.GetRootLayer().Save()
        package = Path(folder) / "object.usdz"
        writer = usd.Sdf.ZipFileWriter.CreateNew(str(package))
        # a fixed time, so that the same mesh gives the same bytes
        for file in (layer.name, *dict.fromkeys(pictures.values())):
            os.utime(Path(folder) / file, (MADE_S, MADE_S))
            writer.AddFile(str(Path(folder) / file), file)
        writer.Save()
        return package.read_bytes()


def _import_usd() -> ModuleType:
    """Import the modules of OpenUSD that are used here, as attributes of `pxr`."""
    for name in ("Gf", "Sdf", "Tf", "Usd", "UsdGeom", "UsdShade", "Vt"):
        import_package(f"pxr.{name}", "usd", "USDZ")
    return import_package("pxr", "usd", "USDZ")


def _add_piece(usd: Any, stage: Any, place: Any, mesh: Mesh, rows: np.ndarray) -> Any:
    """Add the faces of a material."""
    # only the vertices that these faces use
    used, corners = np.unique(mesh.faces[rows], return_inverse=True)
    points = (mesh.vertices[used] @ T_GLTF_WORLD.T / MM_PER_M).astype(np.float32)
    piece = usd.UsdGeom.Mesh.Define(stage, place)
    piece.CreatePointsAttr(usd.Vt.Vec3fArray.FromNumpy(points))
    piece.CreateFaceVertexCountsAttr(usd.Vt.IntArray.FromNumpy(np.full(len(rows), 3, np.int32)))
    piece.CreateFaceVertexIndicesAttr(usd.Vt.IntArray.FromNumpy(corners.reshape(-1).astype(np.int32)))
    piece.CreateSubdivisionSchemeAttr(usd.UsdGeom.Tokens.none)
    piece.CreateDoubleSidedAttr(True)
    # viewers place the camera by the stated extent
    extent = np.stack([points.min(axis=0), points.max(axis=0)])
    piece.CreateExtentAttr(usd.Vt.Vec3fArray.FromNumpy(extent))
    normals = (unit_normals(mesh.normals[used]) @ T_GLTF_WORLD.T).astype(np.float32)
    piece.CreateNormalsAttr(usd.Vt.Vec3fArray.FromNumpy(normals))
    piece.SetNormalsInterpolation(usd.UsdGeom.Tokens.vertex)
    kind = usd.Sdf.ValueTypeNames.TexCoord2fArray
    st = usd.UsdGeom.PrimvarsAPI(piece).CreatePrimvar("st", kind, usd.UsdGeom.Tokens.vertex)
    st.Set(usd.Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(mesh.uv[used], np.float32)))
    return piece


def _add_look(usd: Any, stage: Any, place: Any, picture: str, material: Any) -> Any:
    """Add a material with a picture, looked up by the texture coordinates `st`."""
    kinds = usd.Sdf.ValueTypeNames

    def shader(name: str, kind: str, **inputs: tuple[Any, Any]) -> Any:
        made = usd.UsdShade.Shader.Define(stage, place.AppendChild(name))
        made.CreateIdAttr(kind)
        for key, (type_name, value) in inputs.items():
            made.CreateInput(key, type_name).Set(value)
        return made

    # the graph of USD's preview surface: coordinates -> picture -> colour
    look = usd.UsdShade.Material.Define(stage, place)
    reader = shader("coordinates", "UsdPrimvarReader_float2", varname=(kinds.String, "st"))
    texture = shader(
        "texture", "UsdUVTexture", file=(kinds.Asset, picture), wrapS=(kinds.Token, "repeat"),
        wrapT=(kinds.Token, "repeat"), sourceColorSpace=(kinds.Token, "sRGB"),
    )  # fmt: skip
    texture.CreateInput("st", kinds.Float2).ConnectToSource(reader.CreateOutput("result", kinds.Float2))
    surface = shader(
        "surface", "UsdPreviewSurface", roughness=(kinds.Float, float(material.roughness)),
        metallic=(kinds.Float, float(material.metallic)),
    )  # fmt: skip
    colour = surface.CreateInput("diffuseColor", kinds.Color3f)
    colour.ConnectToSource(texture.CreateOutput("rgb", kinds.Float3))
    look.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", kinds.Token))
    return look
