"""What workers need to find the tests' own modules, and small work to give them."""

import os
from pathlib import Path

import engine_work
import pytest


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """Workers find the tests' own modules, and this checkout."""
    places = [Path(engine_work.__file__).parent, Path(__file__).parents[2], os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, places)))


@pytest.fixture
def shoot(make_crate_space, tmp_path):
    """A function (name, engine) -> result of `shoot_plan` and all bytes of its folder."""
    from toolkit.captures.shoot import ShootSettings, shoot_plan
    from toolkit.rig.plan import read_plan

    space = make_crate_space(tmp_path / "crates")

    def call(name, engine):
        plan, settings = read_plan(space.plan_file), ShootSettings(backdrop="white")
        result = shoot_plan(space, plan, ["crate"], settings=settings, source=name, engine=engine)
        return result, read_all(result.source_dir)

    return call


@pytest.fixture
def ask(tmp_path):
    """A function (name, engine) -> the finished benchmark of nine images, and its log of answers."""
    from hue_network import make_hue_classifier, write_photos, write_set

    from toolkit.core.workspace import make_workspace
    from toolkit.rooms.benchmarks.corruptions import CorruptEvalConfig
    from toolkit.rooms.benchmarks.corruptions.cells import open_variants, share_classes
    from toolkit.rooms.benchmarks.corruptions.grid import Grid, run_grid
    from toolkit.training.images import open_images

    space = make_workspace(tmp_path / "space")
    write_set(space)
    write_photos(tmp_path / "data")

    def call(name, engine):
        classifier = make_hue_classifier()
        variants, _ = open_variants(space, ("paint-16",), classifier, make_hue_classifier)
        images = open_images(str(tmp_path / "data"), classifier)
        images = images.only(share_classes(variants, images.classes))
        config = CorruptEvalConfig(corruptions=(("fog", 3), ("jpeg_compression", 4)))
        file = tmp_path / name / "cells.jsonl"
        return run_grid(Grid(images, tuple(variants), config), file, engine=engine), file.read_bytes()

    return call


@pytest.fixture
def train(tmp_path):
    """A function (name, engine, network) -> patches of three classes, what was skipped, and all bytes of their set."""
    from hue_network import make_hue_classifier, write_photos

    from toolkit.boosters.transforms.placement import Placement
    from toolkit.core.workspace import make_workspace
    from toolkit.rooms.benchmarks.patch_sets import ClassPatchesConfig, make_flat_config
    from toolkit.rooms.benchmarks.patch_sets.class_patches import train_class_patches
    from toolkit.training.images import open_images

    data = write_photos(tmp_path / "data", 4)
    config = ClassPatchesConfig(set_name="hues", sizes_px=(16,), images=20)
    patch = make_flat_config("default", {"steps": 6, "batch": 4}, Placement(), config)

    def call(name, engine=None, network=None, classes=(0, 1, 2), restart=False):
        space, network = make_workspace(tmp_path / name), network or make_hue_classifier()
        images = open_images(str(data), network, "train")
        done = train_class_patches(config, patch, images, classes, network, space, restart=restart, engine=engine)
        return done.patches, done.skipped, read_all(space.root / "print" / "patches" / "hues-16")

    return call


@pytest.fixture(scope="session")
def look(make_crate_space, tmp_path_factory):
    """A function (name, engine) -> an evaluation in a small field whose units are eight frames, and all its bytes."""
    from forked import parent
    from walled_field import make_config, make_onlooker, stand_in

    from toolkit.core import child
    from toolkit.rooms.worlds.evaluation import world_run
    from toolkit.rooms.worlds.evaluation.world_run import evaluate_world

    folder = tmp_path_factory.mktemp("fields")

    def call(name, engine=None):
        with pytest.MonkeyPatch.context() as patch:
            stand_in(patch, is_drawn=False)
            patch.setattr(child, "_Context", parent)
            patch.setattr(world_run, "UNIT_PICTURES", 32)
            space = make_crate_space(folder / name)
            done = evaluate_world(space, make_onlooker(), make_config(keep=True, run="run"), engine)
            return done, read_all(space.eval_dir)

    call.folder = folder
    return call


@pytest.fixture(scope="session")
def looked(look):
    """The evaluation in this process, and all its bytes."""
    return look("here")


def read_all(folder):
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}
