"""Bytes that another program would be started for: pictures are opened as pictures, by one reader."""

import ast
import base64
import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import EpsImagePlugin, Image

import toolkit
from toolkit.core.errors import ToolkitError
from toolkit.corruptions.folder import corrupt_images
from toolkit.imaging.read import decode_frame, decode_image, read_image
from toolkit.objects.load import read_mesh
from toolkit.objects.records import decode_png
from toolkit.rooms.photos.lens import turns_upright
from toolkit.rooms.photos.photo import read_photo
from toolkit.rooms.worlds.sky import load_sky

EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 64 32\n%%EndComments\nshowpage\n%%EOF\n"


@pytest.fixture
def started(tmp_path, monkeypatch):
    """The file that a Ghostscript in the search path writes when it is started."""
    program = tmp_path / "bin" / "gs"
    program.parent.mkdir()
    program.write_text(f"#!/bin/sh\necho started >> {tmp_path}/started\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr(EpsImagePlugin, "gs_binary", None)  # Pillow looks once
    return tmp_path / "started"


def read_textured(file: Path, suffix: str) -> None:
    """A mesh whose picture is the file."""
    square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl skin\nf 1/1 2/2 3/3\n"
    mesh = file.with_name(f"card{suffix}")
    if suffix == ".obj":
        file.with_name("skin.mtl").write_text(f"newmtl skin\nmap_Kd {file.name}\n")
        mesh.write_text(f"mtllib skin.mtl\n{square}")
    elif suffix == ".ply":
        corners = "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n"
        names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "s", "t"))
        mesh.write_text(
            f"ply\nformat ascii 1.0\ncomment TextureFile {file.name}\nelement vertex 3\n{names}"
            f"element face 1\nproperty list uchar int vertex_indices\nend_header\n{corners}3 0 1 2\n"
        )
    else:
        numbers = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], "<f4").tobytes() + np.eye(3, 2, dtype="<f4").tobytes()
        inside = base64.b64encode(numbers).decode()
        glossy = suffix == "-glossy.gltf"
        picture = {"index": 0}
        look = (
            {"extensions": {"KHR_materials_pbrSpecularGlossiness": {
                "diffuseTexture": picture, "specularGlossinessTexture": picture}}}
            if glossy else {"pbrMetallicRoughness": {"baseColorTexture": picture}}
        )  # fmt: skip
        uri = file.name if suffix == ".gltf" else f"data:image/png;base64,{base64.b64encode(EPS).decode()}"
        tree = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "buffers": [{"byteLength": len(numbers), "uri": f"data:application/octet-stream;base64,{inside}"}],
            "bufferViews": [{"buffer": 0, "byteOffset": k, "byteLength": 36 - k // 3} for k in (0, 36)],
            "accessors": [
                {"bufferView": k, "componentType": 5126, "count": 3, "type": f"VEC{3 - k}"} for k in (0, 1)
            ],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
            "materials": [look], "textures": [{"source": 0}], "images": [{"uri": uri}],
        }  # fmt: skip
        if suffix == ".glb":
            text = json.dumps(tree).encode()
            text += b" " * (-len(text) % 4)
            head = struct.pack("<4sII", b"glTF", 2, 20 + len(text)) + struct.pack("<I4s", len(text), b"JSON")
            mesh.write_bytes(head + text)
        else:
            mesh.write_text(json.dumps(tree))
    read_mesh(mesh)


READERS = {
    "photograph": read_image,
    "photograph to be shrunk": lambda file: read_image(file, 8),
    "bytes": lambda file: decode_image(file.read_bytes(), file),
    "patch": lambda file: decode_png(file.read_bytes(), file),
    "frame": lambda file: decode_frame(file.read_bytes(), file),
    "upload": read_photo,
    "sky": load_sky,
    "corrupt": lambda file: corrupt_images(file, file.with_name("out.png"), [("fog", 1)]),
}


@pytest.mark.parametrize("name", ["a.png", "a.jpg"])
@pytest.mark.parametrize("reader", READERS)
def test_no_program_is_started_for_a_picture(tmp_path, started, reader, name):
    (tmp_path / name).write_bytes(EPS)
    with pytest.raises(ToolkitError) as caught:
        READERS[reader](tmp_path / name)
    assert "\n" not in str(caught.value)
    assert not started.exists()
    turns_upright(tmp_path / name)
    assert not started.exists()


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".gltf", ".glb", "-glossy.gltf"])
def test_no_program_is_started_for_a_texture(tmp_path, started, suffix):
    (tmp_path / "skin.png").write_bytes(EPS)
    before = Image.open
    with pytest.raises(ToolkitError, match=r"(card|skin)\S*: .*a texture that cannot be read \(not an image"):
        read_textured(tmp_path / "skin.png", suffix)
    assert not started.exists() and Image.open is before


def test_the_planted_program_would_have_been_started(tmp_path, started):
    """Else the tests above could not fail."""
    (tmp_path / "a.png").write_bytes(EPS)
    with pytest.raises(Exception), Image.open(tmp_path / "a.png") as image:  # noqa: B017
        image.load()
    assert started.exists()


OPENERS = {
    "imread", "imreadmulti", "imdecode", "imdecodemulti", "imreadanimation", "VideoCapture", "ImageReader",
    "drawInlineImage", "ImageFolder", "default_loader", "pil_loader", "decode_jpeg", "load_scene", "load_mesh",
}  # fmt: skip
ALLOWED = {
    ("imaging/read.py", "open"),
    ("imaging/read.py", "imread"),  # Radiance and OpenEXR, after a look at its first bytes
    ("imaging/read.py", "imdecode"),  # PNG, likewise
    ("corruptions/digital.py", "imdecode"),  # what it has just encoded
    ("rooms/photos/video.py", "VideoCapture"),
    ("rooms/worlds/picture.py", "VideoCapture"),  # what it has just written
    ("printing/canvas.py", "ImageReader"),  # what it has just encoded
    ("objects/export_mesh.py", "load_scene"),  # what it has just encoded
}


def find_openers(file):
    """Calls in a module, or names that it takes from others, that could open a picture."""
    text = file.read_text(encoding="utf-8")
    if not any(word in text for word in (*OPENERS, "Image", "trimesh")):
        return  # most of them, and to parse one takes long
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            yield from ("open" for one in node.names if node.module == "PIL.Image" and one.name in ("open", "*"))
            yield from (one.name for one in node.names if one.name in OPENERS - {"ImageReader"})
        elif isinstance(node, ast.Attribute):
            owner = getattr(node.value, "attr", getattr(node.value, "id", ""))
            if node.attr == "open" and owner in ("Image", "PILImage", "ImageFile"):
                yield "open"
            if node.attr in OPENERS or (owner == "trimesh" and node.attr.startswith("load")):
                yield node.attr
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in OPENERS:
            yield node.func.id


def test_every_picture_is_opened_by_one_reader():
    package = Path(toolkit.__file__).parent
    found = {(str(file.relative_to(package)), call) for file in package.rglob("*.py") for call in find_openers(file)}
    assert found == ALLOWED
