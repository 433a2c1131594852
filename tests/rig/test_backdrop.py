"""Table and room behind the object: where each begins, in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from toolkit.rig.camera import Camera, orbit_pose, pixel_rays, project
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.scene import KeyLight
from toolkit.rig.studio import make_studio

CAMERA = Camera.from_fov(160, 120, 50)


@pytest.fixture(scope="module")
def renderer(make_box):
    """A white table of 640 × 480 mm in a black room under a white key light, and a tiny box."""
    studio = make_studio(0, 100, "white")
    lit = replace(
        studio, environment=np.zeros_like(studio.environment), exposure=1.0,
        key=KeyLight(azimuth_deg=0, elevation_deg=80, irradiance=(3, 3, 3)),
        table=replace(studio.table, picture=np.full_like(studio.table.picture, 255)),
    )  # fmt: skip
    return RaycastRenderer(make_box((4, 4, 2)), lit)


@pytest.mark.slow
@pytest.mark.parametrize("view", [(0, 2, 700), (90, 8, 500), (30, 15, 900), (200, 0.5, 400), (70, 50, 900)])
def test_the_table_ends_at_its_edge_and_the_room_is_all_above_it(renderer, view):
    T_world_camera = orbit_pose(np.array([0, 0, 40.0]), *view)
    picture = renderer.render(CAMERA, T_world_camera)[..., 0]

    def hits_table(dx, dy):
        x, y = np.meshgrid(np.arange(160) + 0.5 + dx, np.arange(120) + 0.5 + dy)
        rays = pixel_rays(CAMERA, T_world_camera, np.stack([x, y], -1).reshape(-1, 2).astype(np.float32)).astype(float)
        with np.errstate(divide="ignore", invalid="ignore"):
            land = rays[:, :2] + -rays[:, 2:3] / rays[:, 5:] * rays[:, 3:5]
        return ((np.abs(land) < [320, 240]).all(axis=1) & (rays[:, 5] < 0)).reshape(120, 160)

    corners = np.stack([hits_table(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
    assert corners.all(axis=0).sum() > 500
    ((box_x, box_y),) = project(CAMERA, T_world_camera, np.zeros((1, 3)))[0]
    y, x = np.mgrid[:120, :160]
    free = np.hypot(x - box_x, y - box_y) > 12
    assert picture[corners.all(axis=0) & free].min() > 0.8  # 3 sin 80° / π
    assert picture[~corners.any(axis=0)].max(initial=0) < 0.01


def test_a_lit_white_table_has_the_radiance_of_lamberts_law(renderer):
    picture = renderer.render(CAMERA, orbit_pose(np.array([200.0, 150, 0]), 40, 60, 100))
    np.testing.assert_allclose(picture, 3 * np.sin(np.radians(80)) / np.pi, rtol=0.02)
