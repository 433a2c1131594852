"""The table of renderers: one more is one file, and all see the same geometry."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.renderer import Renderer
from toolkit.rig.renderers import RENDERERS, RendererKind, describe_cost, make_renderer
from toolkit.rig.scene import Stand
from toolkit.rig.studio import make_studio

CAMERA, POSE = Camera.from_fov(48, 36), orbit_pose((0, 0, 20), 30, 40, 300)
FLAT = """
import numpy as np

from toolkit.rig.renderer import Renderer
from toolkit.rig.renderers import RENDERERS, RendererKind


class FlatRenderer(Renderer):
    def render(self, camera, T_world_camera):
        seen = self.buffers(camera, T_world_camera)["material"] >= 0
        return seen[..., None].repeat(3, axis=2).astype(np.float32)


RENDERERS["flat"] = RendererKind(lambda mesh, scene, detail, stand: FlatRenderer(mesh, scene, stand), version=3)
"""
ROAD = """
import flat, json, sys
from pathlib import Path
from typer.testing import CliRunner
from toolkit.cli import app

done = CliRunner().invoke(app, ["capture-sim", "--renderer", "flat", "--format", "png", "--workspace", sys.argv[1]])
assert done.exit_code == 0, (done.output, done.exception)
from PIL import Image
picture = next(Path(sys.argv[1]).glob("captures/sim-flat/crate/unpatched/*.png"))
low, high = Image.open(picture).convert("L").getextrema()
assert low < 20 and high > 150, (low, high)
lines = (Path(sys.argv[1]) / "captures/sim-flat/manifest.jsonl").read_text().splitlines()
assert {json.loads(line)["made"]["renderer"] for line in lines} == {"flat"}
done = CliRunner().invoke(app, ["capture-sim", "--help"], terminal_width=200)
assert "raycast|filament" in done.output and "|flat" in done.output, done.output
"""


class Dark(Renderer):
    """No light at all."""

    def render(self, camera, T_world_camera):
        return np.zeros((camera.height, camera.width, 3), np.float32)


def test_one_more_renderer_is_a_file_and_a_line_of_the_table(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path / "space")
    (tmp_path / "flat.py").write_text(FLAT)
    (tmp_path / "road.py").write_text(ROAD)
    done = subprocess.run(
        [sys.executable, "road.py", str(space.root)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("stand", [Stand(), Stand((40.0, -30.0, 0.0), 70.0)])
def test_buffers_are_the_same_in_all(make_box, stand):
    studio = make_studio(0, 100, "white")
    ours, other = RaycastRenderer(make_box(), studio, stand=stand), Dark(make_box(), studio, stand)
    assert (ours.buffers(CAMERA, POSE)["material"] >= 0).any()
    for name, values in ours.buffers(CAMERA, POSE).items():
        theirs = other.buffers(CAMERA, POSE)[name]
        assert np.array_equal(values, theirs, equal_nan=values.dtype.kind == "f"), name
    assert np.array_equal(ours.outline, other.outline)
    assert other.render_with_depth(CAMERA, POSE)[1].keys() == {"depth", "mesh", "face"}


def test_what_a_renderer_cannot_do_is_one_line(make_box):
    studio = make_studio(0, 100, "white")
    with pytest.raises(ToolkitError, match="no renderer called 'raycat': did you mean raycast"):
        make_renderer("raycat", make_box(), studio)
    with pytest.raises(ToolkitError, match="the renderer filament draws studios alone: use raycast"):
        make_renderer("filament", make_box(), replace(studio, table=None))
    with pytest.raises(ToolkitError, match="Dark has no views to train a texture on: use the renderer raycast"):
        Dark(make_box(), studio).render_linear(CAMERA, POSE, np.zeros((4, 4, 3), np.uint8))


def test_the_cost_is_said_before_a_slow_renderer_starts(monkeypatch):
    monkeypatch.setitem(
        RENDERERS, "slow", RendererKind(None, describe=lambda: ("slow 1.2", ""), cpu_s_per_megapixel=30)
    )
    assert describe_cost("slow", [640 * 480] * 100) == "100 images by slow 1.2: about 15 minutes of one core"
    assert describe_cost("slow", []) == describe_cost("raycast", [640 * 480]) == ""
    faster = replace(RENDERERS["slow"], describe=lambda: ("slow 1.2", "apt-get install fast"))
    monkeypatch.setitem(RENDERERS, "slow", faster)
    assert describe_cost("slow", [1]).endswith(
        "1 minute of one core, and six times that before you run 'apt-get install fast'"
    )
