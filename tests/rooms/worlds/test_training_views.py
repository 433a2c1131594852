"""Views to train on in a world: free places, seen objects, never those of an evaluation, the same from one seed."""

from dataclasses import replace

import numpy as np
import pytest

from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.mesh import Mesh, merge_meshes
from toolkit.rig import bake_cache
from toolkit.rig.camera import project
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.views import HELD_OUT, TRAIN, PaintableObject, ViewRanges, ViewSettings, ViewStream, render_block
from toolkit.rooms.worlds.content.modelling import assemble, box
from toolkit.rooms.worlds.place import choose_places
from toolkit.rooms.worlds.sky import make_sky
from toolkit.rooms.worlds.views import EVALUATED_PLACES, EVALUATED_SEED, WorldSetting, open_setting
from toolkit.rooms.worlds.world import SceneClass, Spot, World

SIDE = 24
RADIUS_M, REACH_M = 3.0, float(np.hypot(1.5, 1.0))
SETTINGS = ViewSettings(ViewRanges((2.0, 75.0), fill=(0.3, 1.0)), SIDE, studios=2, per_studio=3)


def make_box(low, high) -> Mesh:
    size, middle = np.subtract(high, low), np.add(high, low) / 2
    made = assemble(box(tuple(size), paint=(150, 150, 150)), {"paint": (0.9, 0.0)}, 32)
    return replace(made, vertices=(made.vertices - made.bounds.mean(axis=0) + middle).astype(np.float32))


def make_field(seed: int = 1, spots: int = 9, walls: bool = True) -> World:
    """Level ground with a row of spots 20 m apart, and a wall beside each."""
    ground = make_box((-60, -120, -1), (60, 120, 0))
    places = [Spot(f"spot-{k}", "grass", (0.0, 20.0 * (k - 4), 0.0), RADIUS_M, 0.0, "ground") for k in range(spots)]
    standing = [make_box((4, 20 * (k - 4) - 6, 0), (5, 20 * (k - 4) + 6, 9)) for k in range(spots if walls else 0)]
    mesh = merge_meshes([ground, *standing])
    classes = np.full(len(mesh.faces), int(SceneClass.BUILDING), np.uint8)
    classes[: len(ground.faces)] = int(SceneClass.GRASS)
    return World("field", seed, mesh, classes, tuple(places), None, np.array([[-60, -120], [60, 120.0]]))


@pytest.fixture(scope="module")
def subject() -> PaintableObject:
    """A box of 3 × 2 × 1 m; its texture is left out."""
    mesh = make_box((-1.5, -1, 0), (1.5, 1, 1))
    painted = replace(mesh, materials=tuple(replace(one, metallic=0.0) for one in mesh.materials))
    return PaintableObject(painted, 0, mesh)


@pytest.fixture(scope="module")
def field() -> WorldSetting:
    return WorldSetting(make_field(), (make_sky("noon", 0, 64),))


def draws(block: int, kind: str = TRAIN) -> Draws:
    return Draws(3, block, kind)


def test_places_are_drawn_anywhere_on_free_spots(field, subject):
    stands = [field.set_up(subject.mesh, draws(k))[1] for k in range(60)]
    train, held_out = field.divide(subject.mesh)
    assert not {spot.name for spot in train} & {spot.name for spot in held_out}
    assert len(train) + len(held_out) == 9 and len(held_out) == 3
    for stand in stands:
        away = [np.hypot(*np.subtract(stand.place[:2], spot.position[:2])) for spot in train]
        assert min(away) <= RADIUS_M - REACH_M + 1e-6  # still free all around
        assert stand.place[2] == pytest.approx(0, abs=2e-3)
    assert len({stand.place for stand in stands}) == 60
    assert len({int(stand.turn_deg // 60) for stand in stands}) == 6
    again = field.set_up(subject.mesh, draws(7))[1]
    assert again == stands[7]
    held = field.set_up(subject.mesh, draws(0, HELD_OUT))[1]
    assert min(np.hypot(*np.subtract(held.place[:2], spot.position[:2])) for spot in train) > RADIUS_M


def test_places_of_an_evaluation_are_left_out_in_the_world_that_is_evaluated(subject):
    evaluated = make_field(EVALUATED_SEED)
    chosen = {spot.name for spot in choose_places(evaluated, REACH_M, EVALUATED_PLACES, EVALUATED_SEED)}
    found = WorldSetting(evaluated, (make_sky("noon", 0, 64),)).divide(subject.mesh)
    seen = {spot.name for part in found for spot in part}
    assert not seen & chosen and len(seen) == 9 - EVALUATED_PLACES
    few = WorldSetting(make_field(EVALUATED_SEED, spots=1), (make_sky("noon", 0, 64),)).divide(subject.mesh)
    assert [len(part) for part in few] == [1, 1]  # there is no other


def test_every_camera_sees_the_object_and_none_is_in_the_ground(field, subject):
    """Among ranges that reach below the ground, and beside walls 9 m high."""
    low = replace(SETTINGS, ranges=ViewRanges((-60.0, 40.0), fill=(0.3, 1.0)))
    scene, stand = field.set_up(subject.mesh, draws(1))
    renderer = RaycastRenderer(subject.mesh, scene, stand=stand)
    offsets = []
    for k in range(25):
        camera, pose = field.aim(renderer, stand, draws(2).of(str(k)), low)
        assert pose[2, 3] > 0
        found = renderer.buffers(camera, pose)
        assert (found["mesh"] == 0).mean() > 0.005  # a fifth of what, filling 0.3, is some 7 x 4 of 24 x 24 pixels
        assert camera.width == camera.height == SIDE and 39.9 < camera.fov_deg < 60.1
        middle = project(camera, pose, stand.to_world(subject.mesh.bounds.mean(axis=0)[None]))[0][0]
        offsets.append(np.abs(middle - SIDE / 2).max())
    assert min(offsets) > 1e-6  # an evaluation's cameras all look at the middle


def test_an_object_that_is_hidden_everywhere_is_said(field, subject):
    scene, stand = field.set_up(subject.mesh, draws(1))
    below = replace(SETTINGS, ranges=ViewRanges((-80.0, -60.0), fill=(0.3, 0.5)))
    with pytest.raises(ToolkitError, match=r"field: at \(.*\) m the object was hidden from 40 random cameras"):
        field.aim(RaycastRenderer(subject.mesh, scene, stand=stand), stand, draws(2).of(""), below)


def test_a_view_is_the_render_of_its_world(field, subject):
    """The linear view with the texture's own colours, against the picture of the object in its own paint."""
    views = render_block((subject,), SETTINGS, 5, HELD_OUT, 0, setting=field, with_depth=True)
    code = float(subject.mesh.materials[0].texture[0, 0, 0])
    colour = ((code / 255 + 0.055) / 1.055) ** 2.4
    for one in views:
        light = (one.view.dark + (1 - one.view.coverage[..., None]) * one.view.behind).astype(np.float32).reshape(-1, 3)
        np.add.at(light, one.view.pixel, one.view.gain.astype(np.float32) * colour)
        # half precision, and the own paint's mip levels
        assert np.abs(light - one.view.bare.reshape(-1, 3)).mean() < 2e-3
        assert one.view.depth.depth.min() > 0.5 and one.view.depth.camera.width == SIDE


def test_who_renders_changes_nothing_and_the_world_is_lit_once_for_each_sky(field, subject, monkeypatch):
    baked, bake = [], bake_cache.bake_surroundings
    monkeypatch.setattr(bake_cache, "bake_surroundings", lambda *a: baked.append(1) or bake(*a))
    monkeypatch.setattr(bake_cache, "keep_arrays", lambda kind, inputs, make: make())  # none is read from disk
    bake_cache._in_use.clear()
    with ViewStream([subject], SETTINGS, 5, 2, workers=2, setting=field, with_depth=True) as stream:
        ahead = [*stream.group(0), *stream.group(1)]
    assert len(baked) == 1  # for four places
    with ViewStream([subject], SETTINGS, 5, 2, workers=0, setting=field, with_depth=True) as stream:
        alone = [*stream.group(0), *stream.group(1)]
    assert len(ahead) == 12
    for one, other in zip(ahead, alone, strict=True):
        assert one.view.sha256 == other.view.sha256
        assert np.array_equal(one.view.depth.depth, other.view.depth.depth)
    other_seed = render_block((subject,), SETTINGS, 6, TRAIN, 0, setting=field)
    assert other_seed[0].view.sha256 != ahead[0].view.sha256


def test_several_skies_take_turns(subject):
    skies = tuple(make_sky(time, 0, 64) for time in ("noon", "overcast"))
    setting = WorldSetting(make_field(walls=False), skies)
    drawn = [setting.set_up(subject.mesh, draws(k))[0].environment for k in range(20)]
    assert {id(one) for one in drawn} == {id(sky.panorama) for sky in skies}
    assert setting.record([subject.mesh])["skies"] == ["noon/0", "overcast/0"]
    assert setting.describe([subject.mesh]).startswith("field 1, noon/0, overcast/0; on spot-")


def test_what_cannot_be_used_is_one_clear_line(tmp_path, field):
    wide = make_box((-9, -9, 0), (9, 9, 2))
    with pytest.raises(ToolkitError, match=r"field has no place for an object that reaches 12.7 m"):
        field.divide(wide)
    space = Workspace(tmp_path)
    with pytest.raises(ToolkitError, match="city"):
        open_setting(space, "citty", ("noon",), seed=1, scale=1.0)
    with pytest.raises(ToolkitError, match="time of day"):
        open_setting(space, "grass", ("midnight",), seed=1, scale=1.0)
    blocked = make_field(walls=False)
    crate = make_box((-1, -1, 0.0), (1, 1, 2.0))
    clutter = [replace(crate, vertices=crate.vertices + np.float32(spot.position)) for spot in blocked.spots]
    mesh = merge_meshes([blocked.mesh, *clutter])
    crowded = replace(blocked, mesh=mesh, face_class=np.zeros(len(mesh.faces), np.uint8))
    with pytest.raises(ToolkitError, match=r"no place for an object|is free for"):
        WorldSetting(crowded, field.skies).set_up(crate, draws(1))
