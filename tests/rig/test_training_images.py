"""Renders to train on: each from its own number, none from the plan's poses."""

import numpy as np
import pytest

from toolkit.rig import views
from toolkit.rig.camera import project

PX, PER_STUDIO = 96, 24


@pytest.fixture
def drawn(make_box, monkeypatch):
    """A function (count, seed) -> images, cameras and studios, with a renderer that draws nothing but its camera."""
    mesh = make_box()

    def draw(count, seed):
        cameras, studios = [], []

        class Still:
            def __init__(self, name, mesh, scene, detail, stand):
                self.scene, self.outline = scene, stand.to_world(mesh.vertices)

            def render(self, camera, T_world_camera):
                cameras.append((camera, T_world_camera, self.outline))
                studios.append(self.scene.name)
                return np.full((camera.height, camera.width, 3), 0.2, np.float32)

        monkeypatch.setattr(views, "make_renderer", Still)
        settings = views.ViewSettings(image_px=PX, per_studio=PER_STUDIO)
        images = list(views.render_pictures(mesh, count, settings, seed, threads=1))
        return images, cameras, studios

    return draw


def test_an_image_depends_on_seed_and_number_alone(drawn):
    few, cameras, studios = drawn(3, 5)
    more, more_cameras, more_studios = drawn(26, 5)
    other, other_cameras, _ = drawn(3, 6)
    for i in range(3):
        assert few[i].tobytes() == more[i].tobytes() != other[i].tobytes()
        np.testing.assert_array_equal(cameras[i][1], more_cameras[i][1])
        assert (cameras[i][1] != other_cameras[i][1]).any()
    assert studios == more_studios[:3]
    assert len(set(more_studios[:PER_STUDIO])) == 1 and more_studios[PER_STUDIO] != more_studios[0]


def test_no_two_images_share_camera_or_grain(drawn):
    images, cameras, _ = drawn(50, 0)
    assert len({image.tobytes() for image in images}) == len({pose.tobytes() for _, pose, _ in cameras}) == 50


def test_a_seed_of_several_numbers_is_none_of_fewer(drawn):
    (one,), (two,), (three,) = drawn(1, 5)[0], drawn(1, (5, 0))[0], drawn(1, (5,))[0]
    assert one.tobytes() == three.tobytes() != two.tobytes()


def test_cameras_stand_above_the_table_and_see_the_whole_object(drawn):
    _, cameras, _ = drawn(48, 1)
    azimuths = []
    for camera, T_world_camera, outline in cameras:
        position = T_world_camera[:3, 3]
        assert position[2] > 15
        azimuths.append(np.degrees(np.arctan2(position[1], position[0])) % 360)
        pixels, depth = project(camera, T_world_camera, outline)
        assert depth.min() > 0
        seen = ((pixels >= 0) & (pixels <= [camera.width, camera.height])).all(axis=1)
        assert seen.mean() > 0.8
    assert np.histogram(azimuths, bins=4, range=(0, 360))[0].min() > 3  # from all sides


def test_images_are_pictures_of_the_size_said(drawn):
    (image,), _, _ = drawn(1, 0)
    assert image.shape == (PX, PX, 3) and image.dtype == np.uint8
