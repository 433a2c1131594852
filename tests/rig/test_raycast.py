"""The ray-cast renderer against closed forms."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from toolkit.objects.mesh import Material, Mesh, merge_meshes
from toolkit.rig.camera import Camera, look_at, orbit_pose, pixel_rays
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.scene import KeyLight
from toolkit.rig.shading import tone_map
from toolkit.rig.studio import make_studio

CAMERA = Camera.from_fov(96, 72, 40)


@pytest.fixture(scope="module")
def studio():
    return make_studio(0, 100, "white")


@pytest.fixture(scope="module")
def even(studio):
    """Even white light without a key, over a black table."""
    return replace(
        studio, environment=np.ones_like(studio.environment), key=KeyLight(irradiance=(0, 0, 0)), exposure=1.0,
        table=replace(studio.table, picture=np.zeros_like(studio.table.picture)),
    )  # fmt: skip


@pytest.fixture(scope="module")
def boxed(make_box, studio):
    return RaycastRenderer(make_box(), studio)


@pytest.mark.parametrize("view", [(30, 30, 300), (200, 70, 260), (0, 5, 400)])
def test_depth_is_the_closed_form_of_a_ray_and_a_box(boxed, view):
    T_world_camera = orbit_pose(np.array([0, 0, 20.0]), *view)
    depth = boxed.buffers(CAMERA, T_world_camera)["depth"].reshape(-1)
    x, y = np.meshgrid(np.arange(96) + 0.5, np.arange(72) + 0.5)
    local = np.stack([(x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, np.ones_like(x)], -1).reshape(-1, 3)
    forward = local @ T_world_camera[:3, :3].T
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    rays = np.concatenate([np.broadcast_to(T_world_camera[:3, 3], forward.shape), forward], axis=1)
    low, high = np.array([-50, -30, 0]), np.array([50, 30, 40])
    with np.errstate(divide="ignore"):
        slabs = np.stack([(low - rays[:, :3]) / rays[:, 3:], (high - rays[:, :3]) / rays[:, 3:]])
    enter, leave = slabs.min(axis=0).max(axis=1), slabs.max(axis=0).min(axis=1)
    hit = enter < leave
    sure = np.abs(enter - leave) > 1e-2  # a ray along an edge may be either
    np.testing.assert_array_equal(np.isfinite(depth)[sure], hit[sure])
    assert 300 < hit.sum() < 5000
    np.testing.assert_allclose(depth[hit & sure], enter[hit & sure], rtol=1e-5)


def sheet(texture):
    """A square of 100 mm that lies 1 mm over the table, with uv from corner to corner."""
    corners = np.array([[-50, -50, 1], [50, -50, 1], [50, 50, 1], [-50, 50, 1]], np.float32)
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    up = np.repeat(np.array([[0, 0, 1]], np.float32), 4, axis=0)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(corners, up, uv, faces, np.zeros(2, np.int32), (Material("card", texture, 1.0),))


def test_uv_finds_the_texel_that_the_pixel_sees(even):
    """Each texel's colour is its own column and row: looked up at the buffer's uv, it is where the ray lands."""
    row, column = np.mgrid[:64, :64]
    texture = np.stack([column * 4, row * 4, 0 * row], axis=-1).astype(np.uint8)
    renderer = RaycastRenderer(sheet(texture), even)
    T_world_camera = orbit_pose(np.zeros(3), 25, 50, 220)
    buffers = renderer.buffers(CAMERA, T_world_camera)
    seen = (buffers["material"] == 0).reshape(-1)
    x, y = np.meshgrid(np.arange(96) + 0.5, np.arange(72) + 0.5)
    rays = pixel_rays(CAMERA, T_world_camera, np.stack([x, y], -1).reshape(-1, 2).astype(np.float32)).astype(float)
    land = rays[:, :3] + (1 - rays[:, 2])[:, None] / rays[:, 5:] * rays[:, 3:]
    assert seen.sum() > 800
    uv = buffers["uv"].reshape(-1, 2)[seen]
    np.testing.assert_allclose(uv, land[seen, :2] / 100 + 0.5, atol=1e-4)
    colour = cv2.remap(
        texture.astype(np.float32), uv[None, :, 0] * 64 - 0.5, (1 - uv[None, :, 1]) * 64 - 0.5, cv2.INTER_LINEAR
    )[0]
    inner = (np.abs(uv - 0.5) < 0.5 - 1 / 64).all(axis=1)  # half a texel at the border mixes with the other side
    np.testing.assert_allclose(colour[inner, 0] / 4, (land[seen, 0] / 100 + 0.5)[inner] * 64 - 0.5, atol=0.1)
    np.testing.assert_allclose(colour[inner, 1] / 4, (0.5 - land[seen, 1] / 100)[inner] * 64 - 0.5, atol=0.1)


def test_a_matte_card_in_even_light_has_its_albedo(even):
    """Radiance = albedo × π L / π; the dielectric's own sheen adds a few hundredths."""
    texture = np.full((8, 8, 3), 188, np.uint8)  # half of the light
    picture = RaycastRenderer(sheet(texture), even).render(CAMERA, orbit_pose(np.zeros(3), 0, 80, 220))
    assert 0.49 < picture[36, 48].mean() < 0.56
    assert np.ptp(picture[30:42, 40:56]) < 0.01


def test_several_textures_stay_with_their_parts(make_box, even):
    red, blue = make_box((40, 40, 20), (200, 30, 30)), make_box((40, 40, 20), (30, 30, 200))
    apart = [replace(m, vertices=m.vertices + np.array([0, y, 0], np.float32)) for m, y in ((red, 30), (blue, -30))]
    picture = RaycastRenderer(merge_meshes(apart), even).render(CAMERA, orbit_pose(np.zeros(3), 0, 60, 250))
    left, right = picture[36, 30], picture[36, 66]  # from the front, +y is at the right
    assert right[0] > 4 * right[2] and left[2] > 4 * left[0]


def test_the_same_inputs_give_the_same_bytes(make_box, studio, boxed):
    T_world_camera = orbit_pose(np.array([0, 0, 20.0]), 33, 41, 280)
    first = boxed.render(CAMERA, T_world_camera)
    again = RaycastRenderer(make_box(), studio).render(CAMERA, T_world_camera)
    assert first.tobytes() == again.tobytes()
    assert tone_map(first, (0,)).tobytes() == tone_map(again, (0,)).tobytes()
    assert first.dtype == np.float32 and first.shape == (72, 96, 3) and np.isfinite(first).all()


def test_an_object_out_of_frame_leaves_the_backdrop(boxed):
    position = orbit_pose(np.array([0, 0, 20.0]), 0, 30, 300)[:3, 3]
    away = boxed.render(CAMERA, look_at(position, position + np.array([300, 0, -60])))
    assert np.isfinite(away).all() and away.min() >= 0
    aside = look_at(position, np.array([0, 75.0, 20]))
    partly = boxed.render(CAMERA, aside)
    seen = boxed.buffers(CAMERA, aside)["material"] >= 0
    assert 0 < seen.sum() < seen.size / 2 and seen[:, 0].any()
    assert np.isfinite(partly).all()


def test_a_camera_inside_the_mesh_sees_its_walls(boxed):
    inside = look_at(np.array([0, 0, 20.0]), np.array([50.0, 10, 20]))
    assert (boxed.buffers(CAMERA, inside)["material"] == 0).all()
    assert np.isfinite(boxed.render(CAMERA, inside)).all()


def test_the_thinnest_tip_of_a_heavy_mesh_is_in_the_picture(make_box, even):
    """What bounds the traced pixels must see every vertex, not a sample of them."""
    pole = make_box((2, 2, 120), (255, 255, 255))
    slab = make_box((60, 60, 20), (255, 255, 255))
    filler = np.random.default_rng(0).uniform(-10, 10, (200_000, 3)).astype(np.float32)
    mesh = merge_meshes([slab, pole])
    start = len(slab.vertices)  # put the filler before the pole: a stride over all would step across the pole
    mesh = replace(
        mesh,
        vertices=np.concatenate([mesh.vertices[:start], filler.clip(0.1), mesh.vertices[start:]]).astype(np.float32),
        normals=np.concatenate([mesh.normals[:start], np.zeros_like(filler), mesh.normals[start:]]).astype(np.float32),
        uv=np.concatenate([mesh.uv[:start], np.zeros((200_000, 2)), mesh.uv[start:]]).astype(np.float32),
        faces=np.where(mesh.faces < start, mesh.faces, mesh.faces + 200_000).astype(np.int32),
    )
    renderer = RaycastRenderer(mesh, even)
    camera = Camera.from_fov(160, 120, 40)
    T_world_camera = orbit_pose(np.array([0, 0, 60.0]), 90, 60, 260)
    seen = renderer.buffers(camera, T_world_camera)["material"] >= 0
    picture = renderer.render(camera, T_world_camera).mean(axis=-1)
    assert seen.sum() > 300
    assert picture[seen].min() > 0.15  # white in even light, also where the pole stands before the black table
