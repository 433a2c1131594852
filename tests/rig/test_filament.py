"""The Filament renderer, and with it the ray-cast one: two that share no code must see the same silhouettes."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import Material, Mesh, place_on_table
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.filament import FilamentRenderer
from toolkit.rig.graphics import EGL, VULKAN, graphics_trouble
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.renderers import RENDERERS, make_renderer
from toolkit.rig.studio import make_studio


@pytest.fixture(scope="module")
def needs_graphics():
    if (trouble := graphics_trouble()) is not None:
        pytest.skip(f"the Filament renderer cannot start: {trouble}")


@pytest.fixture(scope="module")
def studio():
    return make_studio(0, 100, "white")


def knotted():
    """Some complexity: holes, thin parts and overlaps."""
    import trimesh

    rings = [trimesh.creation.torus(30, 5, major_sections=48, minor_sections=20) for _ in range(3)]
    rings[1].apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0], [0, 0, 0]))
    rings[2].apply_transform(trimesh.transformations.rotation_matrix(np.pi / 3, [0, 1, 0], [0, 0, 0]))
    rings.append(trimesh.creation.cylinder(1.5, 110, sections=16))
    rings.append(trimesh.creation.icosphere(2, 14))
    shape = trimesh.util.concatenate(rings)

    def painted(code):
        material = Material("plain", np.full((4, 4, 3), code, np.uint8), 0.9)
        faces = np.asarray(shape.faces, np.int32)
        uv = np.full((len(shape.vertices), 2), 0.5, np.float32)
        return place_on_table(
            Mesh(
                shape.vertices.astype(np.float32), shape.vertex_normals.astype(np.float32), uv, faces,
                np.zeros(len(faces), np.int32), (material,),
            )
        )  # fmt: skip

    return painted


@pytest.mark.slow
def test_silhouettes_are_those_of_an_independent_rasteriser(needs_graphics, studio):
    """Pixels that change when the object is painted white instead of black are the object, whatever the light."""
    painted, camera = knotted(), Camera.from_fov(480, 360, 40)
    views = [orbit_pose(np.array([0, 0, 50.0]), azimuth, 35, 190) for azimuth in (20, 140, 265)]
    filament = []
    for code in (0, 255):
        renderer = FilamentRenderer(painted(code), studio)
        filament.append([renderer.render(camera, view) for view in views])
        del renderer
    raycast = RaycastRenderer(painted(255), studio)
    for black, white, view in zip(*filament, views, strict=True):
        theirs = (white - black).max(axis=-1) > 0.02  # five of the 8-bit steps
        ours = raycast.buffers(camera, view)["material"] >= 0
        assert ours.sum() > 10_000
        assert (ours & theirs).sum() / (ours | theirs).sum() > 0.99


@pytest.mark.slow
def test_the_scene_is_built_once_for_all_its_poses(needs_graphics, studio, make_box, monkeypatch, capfd):
    """And what Filament says while it is built does not mix with what a command prints."""
    built = []
    build = FilamentRenderer._build
    monkeypatch.setattr(FilamentRenderer, "_build", lambda self, *size: built.append(size) or build(self, *size))
    renderer, camera = FilamentRenderer(make_box(), studio), Camera.from_fov(64, 48, 40)
    first, *others = (renderer.render(camera, orbit_pose((0, 0, 20), turn, 35, 300)) for turn in (0, 90, 200, 360))
    assert built == [(64, 48)]
    assert all(np.abs(other - first).mean() > 0.01 for other in others[:2])
    np.testing.assert_allclose(others[-1], first, atol=1 / 255 + 1e-6)
    assert capfd.readouterr().out == ""


@pytest.mark.slow
@pytest.mark.parametrize("light", ["studio", "side", "dim"])
def test_exposure_and_the_rooms_light_are_the_scenes(needs_graphics, make_box, light):
    """Matt and grey, so that the picture's brightness is that of the light alone."""
    box, camera = make_box(), Camera.from_fov(64, 48, 40)
    box = replace(box, materials=tuple(
        replace(one, texture=np.full((4, 4, 3), 128, np.uint8), roughness=1.0, metallic=0.0) for one in box.materials
    ))  # fmt: skip
    studio = make_studio(0, 100, "white", light)
    scenes = (
        studio,
        replace(studio, exposure=studio.exposure / 2),
        replace(studio, environment=studio.environment / 4),
    )
    view = orbit_pose((0, 0, 20), 30, 35, 300)
    seen = RaycastRenderer(box, studio).buffers(camera, view)["material"] >= 0
    for scene in scenes:
        ours, theirs = (
            kind(box, scene).render(camera, view)[seen].mean() for kind in (RaycastRenderer, FilamentRenderer)
        )
        assert theirs == pytest.approx(ours, rel=0.25)


AFTERWARDS = """
from toolkit.objects.mesh import place_on_table
from toolkit.rooms.worlds.content.modelling import assemble, box
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.filament import FilamentRenderer
from toolkit.rig.studio import make_studio
mesh = place_on_table(assemble(box((50, 40, 30)), {"paint": (0.6, 0.0)}, 64))
renderer = FilamentRenderer(mesh, make_studio(0, 50, "white"))
picture = renderer.render(Camera.from_fov(64, 48), orbit_pose((0, 0, 15), 30, 40, 200))
import torch, torchvision
print("sum", torchvision.models.resnet18().eval()(torch.zeros(1, 3, 32, 32)).shape[1], picture.shape)
"""


@pytest.mark.slow
def test_a_network_still_runs_in_the_process_that_has_rendered(needs_graphics):
    """Mesa's and torch's compilers are both LLVM: in the wrong order the second one ends the process."""
    done = subprocess.run([sys.executable, "-c", AFTERWARDS], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-500:]
    assert "sum 1000 (48, 64, 3)" in done.stdout


@pytest.mark.parametrize("graphics", [EGL, VULKAN], ids=lambda graphics: graphics.name)
def test_every_graphics_interface_names_its_packages(graphics):
    driver = {"EGL": "libegl-mesa0", "Vulkan": "mesa-vulkan-drivers"}[graphics.name]
    assert driver in graphics.packages and "libegl1" in graphics.packages


def test_without_graphics_it_says_what_to_install_instead_of_ending_the_process(monkeypatch, make_box, studio):
    kind = replace(RENDERERS["filament"], find_trouble=lambda: "a library is missing")
    monkeypatch.setitem(RENDERERS, "filament", kind)
    with pytest.raises(
        ToolkitError, match=r"cannot start: a library is missing: run 'sudo .* libegl1 .*', or use the renderer raycast"
    ):
        make_renderer("filament", make_box(), studio)
