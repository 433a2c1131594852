"""Pads on their places, seen from above."""

from copy import copy
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.threads import map_ahead
from toolkit.core.workspace import make_workspace
from toolkit.rig.camera import Camera
from toolkit.rig.renderer import Renderer
from toolkit.rig.renderers import RENDERERS, RendererKind
from toolkit.rooms.landing.config import CameraConfig
from toolkit.rooms.landing.episodes import place_cameras
from toolkit.rooms.landing.site import (
    KINDS,
    Pad,
    PadPlace,
    PadSite,
    Sites,
    SiteView,
    draw_pad,
    find_pad,
    place_at,
    plan_places,
)
from toolkit.rooms.worlds.sky import Sky
from toolkit.rooms.worlds.world import SceneClass, World


def above(site: PadSite, offset: tuple[float, float, float], yaw: float = 0.4) -> np.ndarray:
    return place_cameras(site.centre[None] + [offset], np.cos([yaw]), np.sin([yaw]), np.zeros((1, 2)))[0]


def test_the_pad_is_seen_where_the_truth_says(site: PadSite) -> None:
    """The middle of the pad's pixels, against the truth through the camera's matrix."""
    for offset in ((0, 0, 4.0), (1.2, -0.7, 6.0), (-1.5, 1.0, 8.0)):
        pose = above(site, offset)
        view, mask = site.look(pose)
        x, y, z = site.truth(pose)
        row, column = np.argwhere(mask).mean(axis=0) + 0.5
        assert z == pytest.approx(offset[2])
        assert column == pytest.approx(site.camera.cx + site.camera.fx * x / z, abs=0.6)
        assert row == pytest.approx(site.camera.cy + site.camera.fy * y / z, abs=0.6)
        picture, same = site.photograph_with_mask(SiteView(pose, 3, 7, ("fog", 3)))
        assert (mask == same).all()
        assert (picture == site.photograph(SiteView(pose, 3, 7, ("fog", 3)))).all()
        side = (site.camera.fx * site.pad.size_m / z) ** 2
        assert mask.sum() == pytest.approx(side, rel=0.12)
        assert view.depth_m[mask].min() == pytest.approx(z, rel=0.05)


def test_the_picture_shows_the_pads_own_picture(site: PadSite) -> None:
    """Seen straight from above along its own axes, the render is the drawing up to light."""
    turn = np.radians(site.place.turn_deg) + np.pi / 2
    height = site.camera.fx * site.pad.size_m / site.camera.width  # it fills the frame
    seen = site.photograph(SiteView(above(site, (0, 0, height), turn), 0, 0))
    drawn = cv2.resize(site.pad.picture, seen.shape[:2][::-1], interpolation=cv2.INTER_AREA)
    assert np.corrcoef(seen[..., 1].ravel(), drawn[..., 1].ravel())[0, 1] > 0.95


def test_the_camera_s_renderer_draws_it(site: PadSite, monkeypatch: pytest.MonkeyPatch) -> None:
    class Dark(Renderer):
        def render(self, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
            return np.zeros((camera.height, camera.width, 3), np.float32)

    make = RendererKind(lambda mesh, scene, detail, stand: Dark(mesh, scene, stand), draws_worlds=True)
    monkeypatch.setitem(RENDERERS, "dark", make)
    optics = CameraConfig(image_px=64, renderer="dark")
    dark = PadSite(site.world, site.place, site.sky, site.pad, optics)
    view = SiteView(above(site, (0, 0, 6.0)), 3, 7)
    picture, mask = dark.photograph_with_mask(view)
    assert picture.mean() < 10 < site.photograph(view).mean()
    assert np.array_equal(mask, site.photograph_with_mask(view)[1])
    # sets of the default keep their hash
    assert "renderer" not in CameraConfig().record() and optics.record()["renderer"] == "dark"
    with pytest.raises(ToolkitError, match="the renderer filament draws studios alone: use raycast"):
        CameraConfig(renderer="filament")


def test_fog_fades_it_and_the_same_view_has_the_same_bytes(site: PadSite) -> None:
    pose = above(site, (0, 0, 6.0))
    clear, fog = (site.photograph(SiteView(pose, 3, 7, weather)) for weather in (("clear", 0), ("fog", 5)))
    assert fog.std() < 0.5 * clear.std()
    # on all cores, as data sets and flights take them
    again = list(map_ahead(site.photograph, [SiteView(pose, 3, 7, ("fog", 5)), SiteView(pose, 3, 7)]))
    assert again[0].tobytes() == fog.tobytes()
    assert again[1].tobytes() == clear.tobytes()
    assert site.photograph(SiteView(pose, 3, 8)).tobytes() != clear.tobytes()


def test_places_are_of_seed_and_number_and_off_the_middle(grass: World) -> None:
    few, many = plan_places(grass, 2.0, 2, seed=4), plan_places(grass, 2.0, 5, seed=4)
    assert many[:2] == few
    assert len({place.centre for place in many}) == 5
    decks, bare = plan_places(grass, 2.0, 3, ground="pads"), plan_places(grass, 2.0, 3, ground="bare")
    assert all(abs(place.centre[2] - 0.26) < 0.02 for place in decks)
    assert all(abs(place.centre[2] - 0.01) < 0.02 for place in bare)


def test_the_ground_is_what_a_drone_can_touch(site: PadSite) -> None:
    above_pad = site.centre[None] + [[0, 0, 5.0]]
    assert site.ground.height_below(above_pad)[0] == pytest.approx(site.centre[2] - 0.01, abs=0.01)
    assert site.ground.is_hit(above_pad, above_pad - [[0, 0, 6.0]])[0]
    assert not site.ground.is_hit(above_pad, above_pad - [[0, 0, 4.0]])[0]


def test_pads_of_every_kind(tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    for kind in KINDS:
        pad = find_pad(space, kind, 1.0)
        assert pad.picture.shape[0] == pad.picture.shape[1]
        assert pad.picture.dtype == np.uint8
    family = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    _, ids, _ = family.detectMarkers(np.pad(draw_pad("apriltag").picture[..., 0], 40, constant_values=128))
    assert ids.ravel().tolist() == [7]
    own = space.print_dir / "pads" / "mine.png"
    own.parent.mkdir(parents=True)
    Image.fromarray(draw_pad("noise").picture).save(own)
    assert find_pad(space, "mine").picture.tobytes() == draw_pad("noise").picture.tobytes()


def test_bad_pads_are_one_line(grass: World, tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    with pytest.raises(ToolkitError, match="no pad called 'plane': did you mean plain"):
        find_pad(space, "plane")
    with pytest.raises(FieldError, match=r"size_m 9: expected 0\.2 to 5 m"):
        Pad("plain", draw_pad("grey").picture, 9.0)
    Image.new("RGB", (30, 20)).save(tmp_path / "flat.png")
    with pytest.raises(ToolkitError, match="30 × 20 pixels, expected a square"):
        find_pad(space, str(tmp_path / "flat.png"))
    with pytest.raises(FieldError, match="outside grass, which goes from"):
        place_at(grass, 1e5, 0.0, 2.0)
    with pytest.raises(FieldError, match="larger than the roof or ground"):
        place_at(grass, 6.0, 0.0, 2.0)  # half on the deck
    with pytest.raises(FieldError, match="size_m 30: larger than every place of grass: the widest, 'meadow-1'"):
        plan_places(grass, 30.0, 1)
    assert place_at(grass, 1.0, 2.0, 2.0).centre[2] == pytest.approx(0.26, abs=0.01)


def test_pads_are_lit_sky_by_sky(grass: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """Light on a world is kept for few skies, and worked out anew where they take turns."""
    lit: list[tuple[str, str, int]] = []

    def light(world: World, place: PadPlace, sky: Sky, pad: Pad, optics: CameraConfig) -> object:
        lit.append((sky.name.partition("/")[0], place.name, id(pad.mesh)))
        return object()

    monkeypatch.setattr("toolkit.rooms.landing.site.PadSite", light)
    sites = Sites(grass, plan_places(grass, 2.0, 12), ("noon", "dusk", "overcast"), CameraConfig())
    sites.light_pads(draw_pad("plain"), range(12))
    assert [name for name, _, _ in lit] == ["noon"] * 4 + ["dusk"] * 4 + ["overcast"] * 4
    assert {place.rpartition("-")[2] for name, place, _ in lit if name == "dusk"} == {"3", "4", "9", "10"}
    assert len({mesh for *_, mesh in lit}) == 1


def test_no_rain_and_no_snow_lie_on_water(site: PadSite) -> None:
    """The same field as a lake: the sheet alone carries snow, as in pictures of objects in worlds."""
    pose = above(site, (0, 0, 6.0))
    land, mask = site.look(pose)
    assert land.ground is not None and land.ground[~mask].all()
    afloat = copy(site)
    afloat.world = replace(site.world, face_class=np.full_like(site.world.face_class, SceneClass.WATER))
    lake, _ = afloat.look(pose)
    assert lake.ground is not None and lake.normals is not None
    assert not lake.ground.any()
    assert (lake.normals[~mask] == 0).all() and (lake.normals[mask] == (0, 0, 1)).all()
