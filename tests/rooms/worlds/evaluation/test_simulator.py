"""The grid shot in a simulator: the object where it should be, weathers, depth, classes; and what is refused."""

import json
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from fake_airsim import FakeAirSim, serve
from simulated_field import OBJECT_COLOUR, make_simulated_field
from walled_field import make_config, make_onlooker, stand_in

from toolkit.core.errors import ToolkitError
from toolkit.engine import EngineConfig
from toolkit.rig.camera import Camera
from toolkit.rig.renderer import Renderer
from toolkit.rig.renderers import RENDERERS, RendererKind
from toolkit.rooms.worlds.airsim import Address, AirSim
from toolkit.rooms.worlds.evaluation.frames import OBJECT_ID, SKY_ID, Frame, render_frames
from toolkit.rooms.worlds.evaluation.simulator import name_actor, shoot_frames, write_objects
from toolkit.rooms.worlds.evaluation.world_run import Asked, WorldRun, evaluate_world, plan_run


@pytest.fixture(scope="module")
def asked(tmp_path_factory, make_crate_space) -> Asked:
    """Two variants of the crate, two places, five cameras at each, clear air and one fog."""
    with pytest.MonkeyPatch.context() as patch:
        stand_in(patch)
        space = make_crate_space(tmp_path_factory.mktemp("planned"))
        config = make_config(weathers=("fog:3",), sample=5, variants=("unpatched", "patched", "absent"))
        return plan_run(space, make_onlooker(), config)


def make_fake(asked: Asked, **settings: object) -> FakeAirSim:
    meshes = {name_actor("crate", name): one.mesh for name, one in asked.stage.variants.items() if name != "absent"}
    return make_simulated_field(meshes, **settings)


def shoot_all(asked: Asked, fake: FakeAirSim) -> list[Frame]:
    tasks = [task._replace(is_kept=True) for task in asked.tasks()]
    with serve(fake) as port, AirSim(Address("127.0.0.1", port), 5.0) as simulator:
        return list(shoot_frames(simulator, asked.stage, asked.places, "crate", tasks))


def test_another_renderer_has_frames_of_its_own(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    class Dark(Renderer):
        def render(self, camera: Camera, T_world_camera: np.ndarray) -> np.ndarray:
            return np.zeros((camera.height, camera.width, 3), np.float32)

    kind = RendererKind(lambda mesh, scene, detail, stand: Dark(mesh, scene, stand), draws_worlds=True)
    monkeypatch.setitem(RENDERERS, "dark", kind)
    assert make_config(renderer="dark").record()["renderer"] == "dark"
    dark = replace(asked, stage=replace(asked.stage, renderer="dark"))
    assert not {task.frame for task in dark.tasks()} & {task.frame for task in asked.tasks()}
    first, other = (next(render_frames(one.stage, one.tasks()[:1])) for one in (asked, dark))
    assert other.pictures[0].mean() < 10 < first.pictures[0].mean()
    with pytest.raises(ToolkitError, match="the renderer filament draws studios alone"):
        make_config(renderer="filament")


@pytest.mark.parametrize("flavour", ["airsim", "cosys"])
def test_the_same_cameras_see_the_same_things(asked: Asked, flavour: str) -> None:
    """Depth and outline as our own renderer has them, which knows no north and no quaternion."""
    frames = shoot_all(asked, make_fake(asked, flavour=flavour))
    assert len(frames) == 3 * 2 * 5 * 2
    clear = {(one.task.place, one.task.variant, one.task.item): one for one in frames if one.depth_m is not None}
    ours = render_frames(asked.stage, [task._replace(is_kept=True) for task in asked.tasks()])
    for frame in ours:
        task = frame.task
        theirs = clear[task.place, task.variant, task.item]
        agree = np.isclose(theirs.depth_m, frame.depth_m, rtol=1e-3) | (
            np.isinf(theirs.depth_m) & np.isinf(frame.depth_m)
        )
        assert agree.mean() > 0.995
        own = np.isin(frame.classes, (100, 101)) & (task.variant != "absent")
        assert (own == (theirs.classes == OBJECT_ID)).mean() > 0.99
        assert ((theirs.classes == SKY_ID) == (frame.classes == SKY_ID)).mean() > 0.99
    fogged = next(one for one in frames if one.task.weathers == (("fog", 3),))
    assert fogged.depth_m is None and fogged.pictures[0].mean() > 100


def test_each_variant_wears_its_own_and_nothing_is_left(asked: Asked) -> None:
    fake = make_fake(asked)
    frames = shoot_all(asked, fake)
    reds = {
        variant: {
            tuple(colour)
            for one in frames
            if one.task.variant == variant and one.depth_m is not None
            for colour in one.pictures[0][one.classes == OBJECT_ID]
        }
        for variant in ("unpatched", "patched", "absent")
    }
    assert reds == {"unpatched": {(100, 20, 20)}, "patched": {(160, 20, 20)}, "absent": set()}
    assert not fake.actors and not any(fake.weather.values())


def test_one_of_another_size_or_place_is_refused(asked: Asked) -> None:
    meshes = {name_actor("crate", name): one.mesh for name, one in asked.stage.variants.items()}
    half = {name: replace(mesh, vertices=mesh.vertices / 2) for name, mesh in meshes.items()}
    with pytest.raises(ToolkitError, match=r"'crate_unpatched' is not seen where it stands at 'west': depth agrees on"):
        shoot_all(asked, make_simulated_field(half))
    with pytest.raises(ToolkitError, match=r"its pictures have 20 × 20 pixels, expected 32 × 32: set Width"):
        fake = make_fake(asked)
        fake.side_px = 20
        shoot_all(asked, fake)


def test_a_colour_that_all_share_is_not_the_objects(asked: Asked) -> None:
    fake = make_fake(asked)
    draw = fake.draw
    fake.draw = lambda one: (*draw(one)[:2], np.full((32, 32, 3), OBJECT_COLOUR, np.uint8))
    assert not any((one.classes == OBJECT_ID).any() for one in shoot_all(asked, fake) if one.classes is not None)


def test_the_glbs_are_as_large_as_what_stands_there(asked: Asked, tmp_path) -> None:
    files = write_objects(tmp_path, asked.stage, "crate")
    assert sorted(file.name for file in files.values()) == ["crate_patched.glb", "crate_unpatched.glb"]
    size = trimesh.load_scene(files["unpatched"]).extents  # (y, z, x) of ours
    assert size[[2, 0, 1]] == pytest.approx(np.ptp(asked.stage.places[0].mesh.bounds, axis=0), rel=1e-5)


@contextmanager
def run_in(fake: FakeAirSim):
    """A function (space, settings) -> the run with that simulator."""
    with serve(fake) as port:

        def run(space, **settings: object) -> WorldRun:
            config = make_config(weathers=("fog:3",), sample=5, renderer=f"airsim://127.0.0.1:{port}", **settings)
            return evaluate_world(space, make_onlooker(), config)

        yield run


def test_results_say_who_made_the_pictures_and_need_it_no_more(asked, tmp_path, make_crate_space, in_field) -> None:
    fake, space = make_fake(asked, flavour="cosys"), make_crate_space(tmp_path)
    with run_in(fake) as run:
        first = run(space)
        assert (first.computed, first.kept, first.failed) == (2 * 2 * 5 * 2, 0, ())
        summary = json.loads(first.files.summary.read_text())
        assert summary["about"]["renderer"] == "Cosys-AirSim, server version 4"
        assert summary["about"]["sky"] == "simulator's own"
        assert any("Pictures by Cosys-AirSim" in note for note in summary["notes"])
        lines = [json.loads(line) for line in (first.files.frames / "manifest.jsonl").read_text().splitlines()]
        assert {line["renderer"] for line in lines} == {"Cosys-AirSim, server version 4"}
        assert {line["sky"] for line in lines} == {"simulator's own"}
        folder = first.files.frames / lines[0]["path"]
        assert {file.name for file in folder.iterdir()} == {"clear.png", "fog-3.png", "depth.png", "classes.png"}
        shot, fake.faults = fake.pictures, {"getServerVersion": "gone"}
        again = run(space)
    assert fake.pictures == shot and (again.computed, again.kept) == (0, first.computed)
    assert again.files.predictions.read_bytes() == first.files.predictions.read_bytes()


@pytest.mark.slow
def test_another_simulators_pictures_are_shot_and_answered_anew(asked, tmp_path, make_crate_space, in_field) -> None:
    space = make_crate_space(tmp_path)
    with run_in(make_fake(asked)) as run:
        first = run(space)
    with run_in(make_fake(asked, flavour="cosys")) as run:  # at another port; it shows the same to the byte
        other = run(space)
    ours = evaluate_world(space, make_onlooker(), make_config(weathers=("fog:3",), sample=5))
    assert ours.computed == other.computed == first.computed == 40
    assert "renderer" not in json.loads(ours.files.summary.read_text())["about"]


def test_what_was_shot_before_it_broke_is_not_shot_again(asked, tmp_path, make_crate_space, in_field) -> None:
    fake, space = make_fake(asked), make_crate_space(tmp_path)
    with run_in(fake) as run:
        images = FakeAirSim.simGetImages
        fake.faults = {"simGetImages": lambda one, *given: images(one, *given) if one.pictures < 40 else [{}]}
        with pytest.raises(ToolkitError, match="expected width, height"):
            run(space)
        kept = len([*space.eval_dir.rglob("clear.png"), *space.eval_dir.rglob("fog-3.png")])
        assert 0 < kept < 40
        fake.faults, fake.pictures, fake.actors = {}, 0, {}
        checks = 4  # of the object in its place
        assert run(space).computed == 40 and fake.pictures <= 2 * 2 * (40 - kept + checks)
        one = next(space.eval_dir.rglob("fog-3.png"))
        one.write_bytes(b"no picture")
        [(_, reason)] = run(space).failed
        assert "a damaged one: delete it and run again" in reason


def test_what_does_not_go_with_a_simulator(tmp_path, make_crate_space, in_field) -> None:
    space = make_crate_space(tmp_path)
    config = make_config(renderer="airsim://127.0.0.1:9")
    with pytest.raises(ToolkitError, match="engine ray: expected local with a simulator"):
        evaluate_world(space, make_onlooker(), config, EngineConfig(engine="ray"))
    with pytest.raises(ToolkitError, match="time dusk: goes with renderer raycast: a simulator draws its own sky"):
        evaluate_world(space, make_onlooker(), config.with_overrides(time="dusk"))
    with pytest.raises(ToolkitError, match=r"airsim://127\.0\.0\.1:9: no answer"):
        evaluate_world(space, make_onlooker(), config)
    objects = space.eval_dir / "world-city-crate-onlooker" / "objects"
    assert sorted(file.name for file in objects.iterdir()) == ["crate_patched.glb", "crate_unpatched.glb"]
