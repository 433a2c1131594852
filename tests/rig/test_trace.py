"""First hits that are drawn, against Embree's rays: the same faces, depths and weights, wherever the camera stands."""

import numpy as np
import pytest

from toolkit.objects.mesh import Material, Mesh
from toolkit.rig.camera import Camera, look_at
from toolkit.rig.kernel.frame import NOTHING, SUBPIXELS, Samples
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.renderer import view_from
from toolkit.rig.scene import Stand
from toolkit.rig.studio import make_studio
from toolkit.rig.trace import CENTRE, FACES_PER_SAMPLE, LitBody, _rays_of

RNG = np.random.default_rng(4)
CAMERA = Camera.from_fov(96, 64, 60)


def make_soup(count: int, size: float) -> Mesh:
    """Triangles in all directions from the origin, each with corners of its own; some have no area."""
    corners = (RNG.normal(0, 60, (count, 1, 3)) + RNG.normal(0, size, (count, 3, 3))).astype(np.float32)
    corners[::17, 2] = corners[::17, 1]
    up = np.repeat(np.array([[0, 0, 1]], np.float32), 3 * count, axis=0)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    paint = Material("", np.full((8, 8, 3), 128, np.uint8))
    return Mesh(
        corners.reshape(-1, 3), up, np.zeros((3 * count, 2), np.float32), faces, np.zeros(count, np.int32), (paint,)
    )


def make_body(mesh: Mesh, stand: Stand) -> LitBody:
    return RaycastRenderer(mesh, make_studio(0, 100, "white"), BakeDetail(1, 1, 1.0, 1.0), stand)._object


@pytest.mark.parametrize("size", [5.0, 15.0, 60.0])
@pytest.mark.parametrize("eye", [(0, 0, 0), (150, 40, 60), (0.1, 2, -30)])
@pytest.mark.parametrize("offsets", [CENTRE, SUBPIXELS], ids=["centres", "samples"])
def test_what_is_drawn_is_what_rays_meet(size, eye, offsets):
    body = make_body(make_soup(900, size), Stand((5.0, -3.0, 2.0), 40.0))
    view = view_from(CAMERA, look_at(np.array(eye, float), np.array([10.0, 5, 1]), 25))
    pixels = np.flatnonzero(RNG.random(50 * 60) < 0.7).astype(np.int32)
    samples = Samples(20, 10, 80, 60, pixels, offsets)
    drawn, cast = body.draw(view, samples), body.cast(_rays_of(view, samples))
    same = drawn.face == cast.face
    assert same.mean() > 0.998  # where two triangles meet in float32's last places, either may come first
    met = same & (cast.face != NOTHING)
    assert met.sum() > 100
    np.testing.assert_allclose(drawn.distance[met], cast.distance[met], rtol=2e-4)
    np.testing.assert_allclose(drawn.distance[~same], cast.distance[~same], rtol=2e-4)
    assert np.median(np.abs(drawn.uv - cast.uv)[met]) < 1e-5 and np.abs(drawn.uv - cast.uv)[met].max() < 0.02


def test_a_closed_surface_has_no_gaps(make_box):
    """Each edge belongs to both of its triangles: from inside a box, every ray meets it."""
    body = make_body(make_box(), Stand())
    samples = Samples(0, 0, 96, 64, np.arange(96 * 64, dtype=np.int32), SUBPIXELS)
    for roll in range(0, 180, 20):
        view = view_from(CAMERA, look_at(np.array([1.0, 2, 15]), np.array([0.0, 0, 15]), roll))
        assert (body.draw(view, samples).face != NOTHING).all()


def test_a_mesh_of_many_faces_is_seen_by_rays(monkeypatch):
    body = make_body(make_soup(500, 8), Stand())
    view = view_from(CAMERA, look_at(np.array([150.0, 0, 0]), np.zeros(3)))
    ways = []
    monkeypatch.setattr(LitBody, "draw", lambda *_: ways.append("drawn"))
    monkeypatch.setattr(LitBody, "cast", lambda *_: ways.append("rays"))
    for count in (500 // FACES_PER_SAMPLE - 1, 500 // FACES_PER_SAMPLE):
        body.see(view, Samples(0, 0, 96, 64, np.arange(count, dtype=np.int32), CENTRE))
    assert ways == ["rays", "drawn"]
