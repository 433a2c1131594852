"""Renders to train on: each from its own number, none from the plan's poses."""

import numpy as np
import pytest

from toolkit.rig import views as training
from toolkit.rig.camera import project


@pytest.fixture
def drawn(tmp_path, make_crate_space, monkeypatch):
    """A function (count, seed) -> images, cameras and studios, with a renderer that draws nothing but its camera."""
    space = make_crate_space(tmp_path)

    def draw(count, seed):
        cameras, studios = [], []

        class Still:
            def __init__(self, mesh, studio):
                self.mesh, self.studio = mesh, studio

            def render_many(self, views):
                return (self.render(*view) for view in views)

            def render(self, camera, T_world_camera):
                cameras.append((camera, T_world_camera, self.mesh))
                studios.append(self.studio.name)
                return np.full((camera.height, camera.width, 3), 0.2, np.float32)

        monkeypatch.setattr(training, "make_renderer", lambda name, mesh, studio: Still(mesh, studio))
        images = list(training.render_training_images(space, "crate", count, seed))
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
    assert len(set(more_studios[:24])) == 1 and more_studios[24] != more_studios[0]


def test_cameras_stand_above_the_table_and_see_the_whole_object(drawn):
    _, cameras, _ = drawn(48, 1)
    azimuths = []
    for camera, T_world_camera, mesh in cameras:
        position = T_world_camera[:3, 3]
        assert position[2] > 15
        azimuths.append(np.degrees(np.arctan2(position[1], position[0])) % 360)
        pixels, depth = project(camera, T_world_camera, mesh.vertices)
        assert depth.min() > 0
        seen = ((pixels >= 0) & (pixels <= [camera.width, camera.height])).all(axis=1)
        assert seen.mean() > 0.8
    assert np.histogram(azimuths, bins=4, range=(0, 360))[0].min() > 3  # from all sides


def test_images_are_pictures_of_the_size_said(drawn):
    (image,), _, _ = drawn(1, 0)
    assert image.shape == (288, 320, 3) and image.dtype == np.uint8
