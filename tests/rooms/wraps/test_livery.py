"""A picture that exists already, on the pieces of a wrap: each colour where the object's coordinates have it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pypdf
import pytest
from one_line import error_of
from PIL import Image
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.objects.load import load_object
from toolkit.objects.records import read_texture, write_texture
from toolkit.rig.variants import find_booster
from toolkit.rooms.wraps.config import WrapConfig
from toolkit.rooms.wraps.printing.print_wrap import print_wrap
from toolkit.rooms.wraps.wrap import Wrap, find_wrap, read_wrap, write_wrap
from toolkit.rooms.wraps.wrap_plan import plan_wrap

SIZE_MM = np.array([60.0, 40.0, 30.0])
COLOURS = np.array([[9, 1, 1], [1, 9, 1], [1, 1, 9], [9, 9, 1], [9, 1, 9], [1, 9, 9]], np.uint8) * 25
"""Of the sides +x -x +y -y +z -z."""
COARSE = {"views": 8, "texel_mm": 0.5}


def write_carton(folder: Path) -> None:
    """A box whose sides have a cell each of a grid of 3 × 2."""
    lines, count = [], 0
    for side in range(6):
        axis, sign = side // 2, 1 - 2 * (side % 2)
        cell = np.array([side % 3, 1 - side // 3])
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        places = np.zeros((4, 3))
        places[:, axis], places[:, [(axis + 1) % 3, (axis + 2) % 3]] = sign, corners[::sign]
        lines += ["v {} {} {}".format(*row) for row in places * SIZE_MM / 2]
        lines += ["vt {} {}".format(*row) for row in (cell + (corners[::sign] * 0.98 + 1) / 2) / [3, 2]]
        lines.append("f " + " ".join(f"{count + k}/{count + k}" for k in range(1, 5)))
        count += 4
    (folder / "carton.obj").write_text("\n".join(lines) + "\n")
    spec = 'class = "carton"\nmesh = "carton.obj"\nlength_mm = 60\nup = "z"\nfront = "x"\n'
    (folder / "carton.toml").write_text(spec)


@pytest.fixture
def space(tmp_path: Path, monkeypatch) -> Workspace:
    made = make_workspace(tmp_path / "w")
    write_carton(made.objects_dir)
    Image.fromarray(np.kron(COLOURS.reshape(2, 3, 3), np.ones((40, 40, 1), np.uint8))).save(made.root / "livery.png")
    monkeypatch.chdir(made.root)
    return made


def sides_of(wrap: Wrap, mesh) -> np.ndarray:
    """(n, n) the side of the carton that lies at each texel of the canvas, -1 off the pieces."""
    found = np.full((wrap.record.n_px, wrap.record.n_px), -1)
    uv = wrap.corner_uv(len(mesh.faces)) * wrap.record.n_px
    for face in np.concatenate([piece.faces for piece in wrap.pieces]):
        a, b, c = mesh.vertices[mesh.faces[face]].astype(float)
        normal = np.cross(b - a, c - a)
        axis = int(np.abs(normal).argmax())
        # well inside the triangle, so that no texel is shared
        for share in np.random.default_rng(face).dirichlet([2, 2, 2], 60):
            column, row = (share @ uv[face]).astype(int)
            found[wrap.record.n_px - 1 - row, column] = 2 * axis + int(normal[axis] < 0)
    return found


def test_each_side_has_what_the_picture_has_in_its_coordinates(space: Workspace):
    item = load_object(space.object_spec("carton"))
    wrap = write_wrap(space.wraps_dir / "carton", plan_wrap(item, WrapConfig(picture=Path("livery.png"), **COARSE)))
    sides = sides_of(wrap, item.mesh)
    there = sides >= 0
    assert there.sum() > 500 and set(np.unique(sides[there])) >= {0, 1, 2, 3, 4}
    wrong = (wrap.pixels[there] != COLOURS[sides[there]]).any(axis=1)
    assert wrong.mean() < 0.02  # texels on a fold between two sides
    assert wrap.record.picture is not None and wrap.record.picture.name == "livery.png"
    # what has no picture is written as it was before there were any
    assert "picture" not in plan_wrap(item, WrapConfig(**COARSE)).record.model_dump()
    assert "livery.png" in pypdf.PdfReader(print_wrap(space, "carton").file).pages[0].extract_text()
    booster = find_booster(space, item, "wrapped")  # it can be shot, untrained as it is
    assert booster is not None and booster.note()["booster"] == "carton"


def test_a_pattern_repeats_at_its_size_and_stands_upright(space: Workspace):
    """Stripes of 10 mm, drawn level, are level on each side of the carton, and as high on paper."""
    stripes = np.zeros((8, 4, 3), np.uint8)
    stripes[:4] = 250
    Image.fromarray(stripes).save("stripes.png")
    item = load_object(space.object_spec("carton"))
    wrap = plan_wrap(item, WrapConfig(picture=Path("stripes.png"), pattern_mm=20, sheet_mm=(62, 42), **COARSE))
    assert wrap.pixels is not None
    judged = 0
    for k, piece in enumerate(wrap.pieces):
        corners = item.mesh.vertices[item.mesh.faces[piece.faces]].astype(float)
        if np.ptp(corners[..., 2]) < 1:
            continue  # it lies level
        picture = wrap.picture(k)[..., 0]
        # along height the level changes every 10 mm; across, never
        weights = np.random.default_rng(k).dirichlet([1, 1, 1], 400)
        flat = np.einsum("sc,fci->fsi", weights, piece.flat_mm).reshape(-1, 2)
        z = np.einsum("sc,fc->fs", weights, corners[..., 2]).reshape(-1)
        sides = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]) < 1e-6
        upright = np.repeat(sides, len(weights))
        at = np.floor(flat / wrap.record.texel_mm).astype(int) + wrap.record.bleed_px
        seen = picture[len(picture) - 1 - at[:, 1], at[:, 0]] > 125
        if not upright.all():
            continue  # folded over the top: the whole piece has one upright
        phases = [np.mean(seen == ((z - start) % 20 < 10)) for start in np.arange(0, 20, 0.5)]
        assert max(phases) > 0.93, k
        judged += 1
    assert judged >= 3


def test_a_texture_and_a_wrap_are_taken_and_those_of_others_refused(space: Workspace):
    item = load_object(space.object_spec("carton"))
    first = write_wrap(space.wraps_dir / "carton", plan_wrap(item, WrapConfig(picture=Path("livery.png"), **COARSE)))
    again = plan_wrap(item, WrapConfig(picture=space.wraps_dir / "carton", **COARSE))
    there = sides_of(first, item.mesh) >= 0
    assert again.pixels is not None and np.array_equal(again.pixels[there], first.pixels[there])
    assert again.record.picture is not None and again.record.picture.name == "carton"
    record = {
        "name": "carton", "class_name": "carton", "class_index": 0, "networks": [], "data": {}, "seed": 0,
        "settings": {}, "final": {}, "toolkit_version": "0",
    }  # fmt: skip
    pixels = np.asarray(Image.open("livery.png").resize((64, 64), Image.Resampling.NEAREST))
    for name, sha256 in (("carton", item.shape_sha256), ("other", "0" * 64)):
        object_name = "carton" if name == "carton" else "crate"
        write_texture(space.root / name, pixels, record | {"objects": [{"name": object_name, "mesh_sha256": sha256}]})
    assert read_texture(space.root / "carton/carton.png").record.n_px == 64
    textured = plan_wrap(item, WrapConfig(picture=Path("carton/carton.png"), **COARSE))
    assert textured.pixels is not None
    assert (textured.pixels[there] == COLOURS[sides_of(first, item.mesh)[there]]).all(axis=1).mean() > 0.95

    def plan(file: str, **more) -> str:
        return error_of(lambda: plan_wrap(item, WrapConfig(picture=Path(file), **COARSE, **more)))

    assert "was not trained on object 'carton'" in plan("other/carton.png")
    assert "goes with a picture alone" in plan("carton/carton.png", keep=("paint",))
    moved = item.mesh.vertices * np.float32([1, 1, 1.1])
    other = replace(item, mesh=replace(item.mesh, vertices=moved))
    line = error_of(lambda: plan_wrap(other, WrapConfig(picture=space.wraps_dir / "carton", **COARSE)))
    assert "made for another mesh" in line


def test_pictures_that_cannot_be_on_pieces_in_one_line(space: Workspace):
    item = load_object(space.object_spec("carton"))
    (space.root / "empty.png").write_bytes(b"")
    Image.new("RGBA", (8, 8), (255, 0, 0, 90)).save("clear.png")
    Image.new("RGBA", (8, 8), (255, 0, 0, 255)).save("opaque.png")

    def plan(file: str, spec=item) -> str:
        return error_of(lambda: plan_wrap(spec, WrapConfig(picture=Path(file), **COARSE)))

    assert "the file is empty" in plan("empty.png") and "no such file" in plan("missing.png")
    assert "100% of it is transparent" in plan("clear.png")
    plan_wrap(item, WrapConfig(picture=Path("opaque.png"), **COARSE))
    assert "no wrap" in plan("print")
    bare = replace(item, mesh=replace(item.mesh, uv=np.zeros_like(item.mesh.uv)))
    assert "belong to several pictures" in plan("livery.png", bare)
    own = replace(item.mesh.materials[0], texture=np.eye(64, dtype=np.uint8)[..., None].repeat(3, 2))
    square = replace(item, mesh=replace(item.mesh, materials=(own,)))
    assert "120 × 80 px: expected the form of the texture of 'carton', 64 × 64 px" in plan("livery.png", square)
    for wrong, words in (
        ({"pattern_mm": 5}, "goes with {picture}"), ({"keep": ("x",)}, "goes with {picture}"),
        ({"keep": ("x",), "pattern_mm": 5, "picture": Path("livery.png")}, "cannot be used with {pattern_mm}"),
    ):  # fmt: skip
        with pytest.raises(ToolkitError, match=words.replace("{", r"\{?").replace("}", r"\}?")):
            WrapConfig(**wrong)


@pytest.mark.slow
def test_the_command_cuts_a_picture_and_says_what_comes_next(space: Workspace):
    words = ["wrap", "--object", "carton", "--picture", "livery.png", "--views", "8"]
    said = CliRunner().invoke(app, words).stdout
    assert "livery.png is on the pieces" in said and "--start" in said and "shipped" not in said
    wrap = find_wrap(space, load_object(space.object_spec("carton")))
    assert wrap.record.texel_mm < 60 / 270  # finer than what is trained
    assert json.loads((space.wraps_dir / "carton/wrap.json").read_text())["picture"]["pattern_mm"] is None
    assert read_wrap(space.wraps_dir / "carton").record == wrap.record


def test_pieces_that_hide_a_shipped_wrap_are_named(space: Workspace):
    (space.objects_dir / "racer.toml").write_bytes((space.objects_dir / "carton.toml").read_bytes())
    said = CliRunner().invoke(app, ["wrap", "--object", "racer", "--views", "8"]).stdout
    assert "these pieces hide the shipped wrap of racer" in " ".join(said.split())
