"""The path tracer against the ray caster: the same geometry and about the same light, by code that shares nothing."""

from dataclasses import replace

import numpy as np
import pytest
from walled_field import make_field

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import Material
from toolkit.rig.camera import Camera, look_at, orbit_pose
from toolkit.rig.mitsuba import MitsubaRenderer, denoise, mitsuba_trouble
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.renderers import make_renderer
from toolkit.rig.scene import Stand
from toolkit.rig.studio import make_studio
from toolkit.rooms.worlds.place import find_spot, place_object
from toolkit.rooms.worlds.sky import make_sky

CAMERA = Camera.from_fov(96, 72, 40)
ASIDE = replace(CAMERA, cx=CAMERA.cx + 20, cy=CAMERA.cy - 12)
POSE = orbit_pose((0, 0, 20), 30, 40, 300)
STAND = Stand((15.0, -10.0, 0.0), 70.0)


@pytest.fixture(scope="module")
def needs_mitsuba():
    if (trouble := mitsuba_trouble()) is not None:
        pytest.skip(f"needs the extra mitsuba: {trouble}")


@pytest.fixture(scope="module")
def studio():
    return make_studio(0, 100, "white")


def painted(mesh, code, roughness=1.0):
    texture = np.full((4, 4, 3), code, np.uint8)
    return replace(mesh, materials=tuple(replace(one, texture=texture, roughness=roughness) for one in mesh.materials))


@pytest.mark.slow
@pytest.mark.parametrize("camera", [CAMERA, ASIDE], ids=["middle", "aside"])
def test_silhouettes_and_normals_are_the_ray_casters(needs_mitsuba, make_box, studio, camera):
    """A red box: what has its colour is the object, and its top looks up."""
    box = painted(make_box(), (200, 0, 0))
    renderer = MitsubaRenderer(box, studio, STAND, samples=16)
    _, albedo, normal = renderer.trace(camera, POSE)
    theirs = albedo[..., 0] - albedo[..., 2] > 0.3
    found = renderer.buffers(camera, POSE)
    ours = found["material"] >= 0
    assert ours.sum() > 400
    # pixels on the rim are part object: half of one row all round at most
    assert (ours & theirs).sum() / (ours | theirs).sum() > 0.93
    moment = [np.argwhere(mask).mean(axis=0) for mask in (ours, theirs)]
    assert np.abs(moment[0] - moment[1]).max() < 0.15
    top = ours & theirs & (normal[..., 2] > 0.99)
    assert top.sum() > 100


@pytest.mark.slow
def test_a_texture_lies_as_the_ray_caster_lays_it(needs_mitsuba, make_box, studio):
    """Red to the right, green upwards: mirrored or turned it would be another picture."""
    v, u = np.mgrid[63:-1:-1, 0:64] * 4
    ramp = np.stack([u, v, np.full(u.shape, 60)], axis=-1).astype(np.uint8)
    box = make_box()
    box = replace(box, materials=(Material("ramp", ramp, 1.0), *box.materials[1:]))
    renderer = MitsubaRenderer(box, studio, STAND, samples=4)
    albedo = renderer.trace(CAMERA, POSE)[1]
    found = renderer.buffers(CAMERA, POSE)
    # inside the object: a pixel's neighbours show it as well
    seen = found["material"] == 0
    inside = seen & np.roll(seen, 1, 0) & np.roll(seen, -1, 0) & np.roll(seen, 1, 1) & np.roll(seen, -1, 1)
    uv = found["uv"][inside]
    for channel in (0, 1):
        red = np.corrcoef(albedo[inside][:, channel], (uv[:, channel] % 1) ** 2.2)[0, 1]
        assert red > 0.97, channel


@pytest.mark.slow
@pytest.mark.parametrize("light", ["studio", "side", "dim"])
def test_exposure_key_and_room_are_the_scenes(needs_mitsuba, make_box, light):
    """Matt grey, so that its brightness is that of the light alone; bounces add a little to ours."""
    box = painted(make_box(), (128, 128, 128))
    studio = make_studio(0, 100, "white", light)
    dark = replace(studio.key, irradiance=(0.0, 0.0, 0.0))
    scenes = studio, replace(studio, exposure=studio.exposure / 2), replace(studio, key=dark)
    seen = RaycastRenderer(box, studio).buffers(CAMERA, POSE)["material"] >= 0
    for scene in scenes:
        ours = RaycastRenderer(box, scene).render(CAMERA, POSE)
        theirs = MitsubaRenderer(box, scene, samples=16).render(CAMERA, POSE)
        assert theirs[seen].mean() == pytest.approx(ours[seen].mean(), rel=0.15)
        assert theirs[~seen].mean() == pytest.approx(ours[~seen].mean(), rel=0.15)


@pytest.mark.slow
def test_pictures_are_denoised_and_the_same_each_time(needs_mitsuba, make_box, studio):
    box = painted(make_box(), (128, 128, 128))
    few = MitsubaRenderer(box, studio, samples=16)
    truth = MitsubaRenderer(box, studio, samples=400).trace(CAMERA, POSE)[0] * studio.exposure
    noisy, albedo, normal = few.trace(CAMERA, POSE)
    noisy = noisy * np.float32(studio.exposure)
    picture = few.render(CAMERA, POSE)
    assert np.array_equal(picture, denoise(noisy, albedo, normal))
    assert np.array_equal(picture, MitsubaRenderer(box, studio, samples=16).render(CAMERA, POSE))
    assert np.abs(picture - truth).mean() < 0.5 * np.abs(noisy - truth).mean()


@pytest.mark.slow
def test_a_world_has_its_sky_where_the_ray_caster_has_it(needs_mitsuba, make_box):
    field, sky = make_field(), make_sky("noon", 0, 32)
    placed = place_object(make_box((4.0, 2.4, 1.6)), field, find_spot(field, "west"), sky)
    pose = look_at(np.array([-14.0, 3.0, 4.0]), np.array([-4.0, 0.0, 0.8]))
    renderers = [make_renderer(name, placed.mesh, placed.scene, stand=placed.stand) for name in ("raycast", "mitsuba")]
    ours, theirs = (renderer.render(Camera.from_fov(64, 48, 60), pose) for renderer in renderers)
    found = renderers[1].buffers(Camera.from_fov(64, 48, 60), pose)
    for mesh in (0, 1, 255):
        part = found["mesh"] == mesh
        assert part.sum() > 20
        assert theirs[part].mean(axis=0) == pytest.approx(ours[part].mean(axis=0), rel=0.25), mesh


def test_what_it_cannot_do_is_one_line(make_box, studio, monkeypatch):
    monkeypatch.setattr("toolkit.rig.mitsuba.find_spec", lambda name: None)
    mitsuba_trouble.cache_clear()
    said = (
        r"mitsuba cannot start: mitsuba and pyoidn are not installed: run 'pip install .*mitsuba.*', or use .* raycast"
    )
    with pytest.raises(ToolkitError, match=said):
        make_renderer("mitsuba", make_box(), studio)
    mitsuba_trouble.cache_clear()
    pytest.importorskip("mitsuba")
    oblong = replace(CAMERA, fy=CAMERA.fy * 1.01)
    with pytest.raises(ToolkitError, match="the renderer mitsuba wants square pixels, and the camera has fx"):
        MitsubaRenderer(make_box(), studio).render(oblong, POSE)
