"""`capture-sim --also-renderer`: the same plan by several renderers, each in a source of its own."""

import json

import numpy as np
import pytest

from toolkit.captures.manifest import read_manifest
from toolkit.captures.simulate import SimulateConfig, simulate_captures
from toolkit.core.errors import ToolkitError
from toolkit.rig.renderer import Renderer
from toolkit.rig.renderers import RENDERERS, RendererKind


class Grey(Renderer):
    """Even light."""

    def render(self, camera, T_world_camera):
        return np.full((camera.height, camera.width, 3), 0.2, np.float32)


@pytest.fixture(autouse=True)
def renderers(monkeypatch):
    """The ray caster, one that starts at once, and one that cannot start."""

    def make(mesh, scene, detail, stand):
        return Grey(mesh, scene, stand)

    for name in [name for name in RENDERERS if name != "raycast"]:
        monkeypatch.delitem(RENDERERS, name)
    grey = RendererKind(make, version=1, describe=lambda: ("grey 4.2", ""), cpu_s_per_megapixel=1e6)
    monkeypatch.setitem(RENDERERS, "grey", grey)
    broken = RendererKind(make, find_trouble=lambda: "it ended with code -6", fix="apt-get install it")
    monkeypatch.setitem(RENDERERS, "broken", broken)


def shoot(space, *also, **more):
    return simulate_captures(space, SimulateConfig(also_renderers=also, backdrop="white", **more), ["crate"])


def test_the_same_images_lie_beside_each_other_and_resume(space, capsys):
    done = shoot(space, "grey")
    (other,) = done.others
    assert (done.shot.shot, other.shot, other.source_dir) == (4, 4, space.captures_dir / "sim-grey")
    assert "4 images by grey 4.2: about" in capsys.readouterr().err
    one, two = (read_manifest(folder) for folder in (done.shot.source_dir, other.source_dir))
    assert one.keys() == two.keys()
    for path, record in two.items():
        assert record.T_world_camera == one[path].T_world_camera
        assert (record.made["renderer"], record.made["renderer_version"]) == ("grey", "grey 4.2")
        assert "renderer_version" not in one[path].made
    next(other.source_dir.rglob("*.jpg")).unlink()
    again = shoot(space, "grey")
    assert [(one.shot, one.kept) for one in (again.shot, *again.others)] == [(0, 4), (1, 3)]
    assert json.loads(json.dumps(again.as_json()))["others"] == [
        {"folder": str(other.source_dir), "shot": 1, "kept": 3}
    ]
    assert sum("sim-grey" in line for line in again.lines()) == 1


def test_all_means_what_starts_here(space):
    done = shoot(space, "all")
    assert [one.source_dir.name for one in done.others] == ["sim-grey"]
    assert done.all_remarks == ["not shot by broken: it ended with code -6; 'apt-get install it' brings it"]


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ({"source": "shelf"}, ["shelf", "shelf-grey"]),
        ({"source": "shelf", "renderer": "grey"}, ["shelf", "shelf-raycast"]),
        ({"renderer": "grey"}, ["sim-grey", "sim"]),
    ],
)
def test_no_two_renderers_share_a_folder(space, given, names):
    other = "raycast" if given.get("renderer") == "grey" else "grey"
    done = shoot(space, other, other, given.get("renderer", "raycast"), **given)
    assert [one.source_dir.name for one in (done.shot, *done.others)] == names


@pytest.mark.parametrize(
    ("also", "more", "said"),
    [
        ("broken", {}, "the renderer broken cannot start: it ended with code -6: run 'apt-get install it'"),
        ("gray", {}, "no renderer called 'gray'"),
        ("grey", {"like": "."}, "goes with the plan"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_shot(space, also, more, said):
    with pytest.raises(ToolkitError, match=said):
        shoot(space, also, **more)
    assert not list(space.captures_dir.rglob("*.jpg"))
