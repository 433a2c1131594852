"""A user's panorama: its values, its direction, its sun, and what is refused."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import linear_to_srgb
from toolkit.imaging.read import MAX_MEGAPIXELS
from toolkit.rig.camera import orbit_direction
from toolkit.rig.scene import illuminate
from toolkit.rooms.worlds.sky import find_directions, load_sky, split_sun

HEIGHT = 128


def paint_day(sun_azimuth_deg: float = 30.0, sun_elevation_deg: float = 40.0, sun: float = 20_000.0) -> np.ndarray:
    """A blue upper half, a brown lower one, and a bright disc of two degrees."""
    directions = find_directions(HEIGHT)
    picture = np.where(directions[..., 2:] > 0, [0.3, 0.5, 0.9], [0.2, 0.15, 0.1]).astype(np.float32)
    picture[directions @ orbit_direction(sun_azimuth_deg, sun_elevation_deg) > np.cos(np.radians(2))] = sun
    return picture


def write(path: Path, picture: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), np.ascontiguousarray(picture[..., ::-1]))
    return path


def test_light_is_kept_when_the_sun_is_parted_from_the_sky(tmp_path):
    picture = paint_day()
    before = illuminate(picture, split_sun(paint_day(sun=1.0))[1])
    sky, sun = split_sun(picture)
    assert (sun.azimuth_deg, sun.elevation_deg) == pytest.approx((30, 40), abs=0.7)
    np.testing.assert_allclose(illuminate(sky, sun), before, rtol=0.01)
    assert sky.max() == pytest.approx(0.9)
    np.testing.assert_allclose(sky[:20, :20], [[[0.3, 0.5, 0.9]] * 20] * 20, rtol=1e-6)


def test_a_panorama_without_a_sun_has_none():
    sky, sun = split_sun(paint_day(sun=1.2))
    assert sun.irradiance == (0, 0, 0)
    np.testing.assert_array_equal(sky, paint_day(sun=1.2))


def test_linear_values_and_direction_of_an_hdr_file(tmp_path):
    sky = load_sky(write(tmp_path / "day.hdr", paint_day()))
    np.testing.assert_allclose(sky.panorama[5, 5], [0.3, 0.5, 0.9], rtol=0.015)  # RGBE keeps eight bits
    assert sky.sun.azimuth_deg == pytest.approx(30, abs=0.7) and sky.name == "day"
    turned = load_sky(tmp_path / "day.hdr", azimuth_deg=90)
    assert turned.sun.azimuth_deg == pytest.approx(120, abs=0.7)
    assert turned.sun.irradiance == pytest.approx(sky.sun.irradiance, rel=0.02)
    assert sky.exposure > 0 and np.isfinite(sky.airlight).all()


def test_a_photograph_is_decoded_to_linear_light(tmp_path):
    encoded = np.round(255 * linear_to_srgb(paint_day(sun=1.0))).astype(np.uint8)
    sky = load_sky(write(tmp_path / "day.png", encoded))
    np.testing.assert_allclose(sky.panorama[5, 5], [0.3, 0.5, 0.9], atol=0.006)
    assert sky.sun.irradiance == (0, 0, 0)


def test_what_is_no_panorama(tmp_path):
    def refuse(name: str, message: str) -> None:
        with pytest.raises(ToolkitError, match=message):
            load_sky(tmp_path / name)

    write(tmp_path / "square.hdr", paint_day()[:, :HEIGHT])
    refuse("square.hdr", "128 × 128 pixels: expected an equirectangular panorama, twice as wide as high")
    write(tmp_path / "night.hdr", 0 * paint_day())
    refuse("night.hdr", "its upper half is black")
    (tmp_path / "text.hdr").write_text("no picture")
    refuse("text.hdr", "not a Radiance picture")
    (tmp_path / "bomb.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 40000 +X 80000\n" + b"\2\2")
    refuse("bomb.hdr", f"3200 megapixels, more than {MAX_MEGAPIXELS}: a decompression bomb, or scale it down")
    (tmp_path / "cut.hdr").write_bytes((tmp_path / "square.hdr").read_bytes()[:90])
    refuse("cut.hdr", "a damaged Radiance picture|holds values|is black")
    (tmp_path / "text.png").write_text("no picture")
    refuse("text.png", "not an image")
    (tmp_path / "sky.exr").write_bytes(b"v/1\1")
    refuse("sky.exr", "save the panorama as .hdr")
    refuse("sky.tga", "expected a panorama as .hdr, .exr, .png")
    refuse("none.hdr", "no such file")


def test_values_that_are_no_numbers(tmp_path, monkeypatch):
    bad = paint_day()
    bad[3, 3] = np.nan
    write(tmp_path / "day.hdr", paint_day())
    monkeypatch.setattr(cv2, "imread", lambda *_: bad)  # RGBE itself cannot hold them
    with pytest.raises(ToolkitError, match="NaN or infinite"):
        load_sky(tmp_path / "day.hdr")
