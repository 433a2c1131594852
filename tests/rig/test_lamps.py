"""What materials give off: radiance that is added where lamps are on, and nothing at all where they are off."""

from dataclasses import replace

import numpy as np
import pytest
from test_surroundings import CRUMB, FAR_OFF, GREY, HALF, QUICK, make_world, see, slab

from toolkit.objects.mesh import Material, Mesh
from toolkit.rig.camera import Camera, look_at
from toolkit.rig.raycast import RaycastRenderer

EXPOSURE, LAMPS = 0.7, 3.0
UP = (0.0, 0.0, 1.0)


def lit(mesh: Mesh, emission: np.ndarray) -> Mesh:
    return replace(mesh, materials=tuple(replace(one, emission=emission) for one in mesh.materials))


def sheet(code: int, size: int = 4) -> np.ndarray:
    return np.full((size, size, 3), code, np.uint8)


def render(surroundings: Mesh, lamps: float, item: Mesh = CRUMB) -> RaycastRenderer:
    scene = replace(make_world(surroundings, sky=0.3), exposure=EXPOSURE, lamps=lamps)
    return RaycastRenderer(item, scene, QUICK, FAR_OFF)


@pytest.mark.parametrize("size", [4, 8, 2])
def test_emission_is_added_to_what_a_surface_sends(size: int) -> None:
    ground = lit(slab((-20, -20, -1), (20, 20, 0)), sheet(GREY, size))
    dark, bright = see(render(ground, 0.0), (1, 2, 0), UP), see(render(ground, LAMPS), (1, 2, 0), UP)
    assert dark.min() > 0
    assert bright - dark == pytest.approx(np.full(3, HALF * LAMPS * EXPOSURE), rel=1e-3)


def test_emission_is_read_where_the_texture_is() -> None:
    ground = slab((-20, -20, -1), (20, 20, 0))
    ground = replace(ground, uv=(ground.vertices[:, :2] / 40 + 0.5).astype(np.float32))
    halves = np.zeros((16, 16, 3), np.uint8)
    halves[:, 8:, 1] = 255  # green to the right
    renderer, without = render(lit(ground, halves), LAMPS), render(ground, LAMPS)
    assert np.array_equal(see(renderer, (-10, 3, 0), UP), see(without, (-10, 3, 0), UP))
    gained = see(renderer, (10, 3, 0), UP) - see(without, (10, 3, 0), UP)
    assert gained == pytest.approx([0, LAMPS * EXPOSURE, 0], abs=1e-5)


def test_the_object_gives_light_off_too() -> None:
    item = lit(slab((-2, -2, 0), (2, 2, 3)), sheet(GREY))
    place = np.add(FAR_OFF.place, [0, 0, 3])
    ground = slab((-200, -200, -1), (200, 200, 0))
    gained = see(render(ground, LAMPS, item), place, UP) - see(render(ground, 0.0, item), place, UP)
    assert gained == pytest.approx(np.full(3, HALF * LAMPS * EXPOSURE), rel=1e-3)


def test_where_lamps_are_off_emission_changes_no_byte() -> None:
    ground = slab((-20, -20, -1), (20, 20, 0))
    camera, pose = Camera.from_fov(32, 24, 60), look_at(np.array([9.0, 4.0, 3.0]), np.zeros(3))
    plain = render(ground, 0.0).render(camera, pose)
    assert np.array_equal(plain, render(lit(ground, sheet(255)), 0.0).render(camera, pose))
    assert np.array_equal(plain, render(ground, LAMPS).render(camera, pose))


def test_a_linear_view_holds_the_light_of_lamps() -> None:
    left_out = sheet(200)
    hull = Material("hull", left_out, 1.0, 0.0, sheet(GREY))
    item = replace(slab((-2, -2, 0), (2, 2, 3)), materials=(hull,) * 6)
    camera, place = Camera.from_fov(24, 24, 40), np.array(FAR_OFF.place)
    pose = look_at(np.add(place, [9.0, 4.0, 6.0]), np.add(place, [0, 0, 1.5]))
    bright, dark = (
        render(slab((-200, -200, -1), (200, 200, 0)), lamps, item).render_linear(camera, pose, left_out)
        for lamps in (LAMPS, 0.0)
    )
    assert (bright.dark - dark.dark)[12, 12] == pytest.approx(np.full(3, HALF * LAMPS * EXPOSURE), rel=1e-3)
    assert np.array_equal(bright.gain, dark.gain)
