"""An evaluation in a world, from a config to a results folder: place, plan, render, weather, ask, summarise, write."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from toolkit.core.console import progress
from toolkit.core.errors import FieldError
from toolkit.core.locks import hold_folder
from toolkit.core.workspace import Workspace
from toolkit.engine.config import EngineConfig
from toolkit.experiments.worlds.ask import Asked, ask_missing
from toolkit.experiments.worlds.cameras import PlaceCameras, plan_cameras
from toolkit.experiments.worlds.frames import Stage, WorldVariant
from toolkit.experiments.worlds.keep import KeptFrames
from toolkit.experiments.worlds.simulator import shoot_missing
from toolkit.experiments.worlds.world_config import ABSENT, RIG, WorldEvalConfig
from toolkit.experiments.worlds.world_report import WorldFiles, write_results
from toolkit.experiments.worlds.world_results import WorldResults
from toolkit.models.network import Classifier
from toolkit.objects.load import TableObject, load_object
from toolkit.rig.camera import Camera
from toolkit.rig.variants import apply_booster, find_booster
from toolkit.worlds.airsim import Address
from toolkit.worlds.catalogue import open_world
from toolkit.worlds.picture import make_speck
from toolkit.worlds.place import choose_places, find_radius, place_object, scale_to_world
from toolkit.worlds.sky import make_sky

LONGEST_NAME = 90


@dataclass(frozen=True)
class WorldRun:
    """What a run found, and where it is.

    Attributes:
        results: the answers and what they were given to.
        files: what was written.
        computed, kept: answers that were computed now, and taken from before.
        failed: (what, reason) of pictures that could not be made or answered; the next run tries them again.
    """

    results: WorldResults
    files: WorldFiles
    computed: int
    kept: int
    failed: tuple[tuple[str, str], ...] = ()


def evaluate_world(
    workspace: Workspace, classifier: Classifier, config: WorldEvalConfig, engine: EngineConfig | None = None
) -> WorldRun:
    """Put an object into a world, look at it from a grid of cameras through weather, and ask a network what it sees.

    Results go to `eval/RUN`. An answer is computed once, whatever run asks for it. A camera whose picture fails in one
    variant is left out in all of them.

    Args:
        workspace: whose objects, patches and textures are meant, and whose `eval/` is written to.
        classifier: who is asked.
        config: object, variants, world, cameras and weathers.
        engine: where frames are rendered and answered; by default in this process.

    Raises:
        ToolkitError: an unknown object, variant, world or weather, a missing booster, an object that is larger than
            every place, no camera that can stand, a network whose output is never finite, a disk that is full, or a
            simulator that does not do as it is told.
    """
    if config.renderer != RIG and engine is not None and engine.engine != "local":
        raise FieldError(
            "expected local with a simulator, whose pictures lie on this machine", {"engine": engine.engine}
        )
    asked = plan_run(workspace, classifier, config)
    run_dir = workspace.eval_dir / (config.run or name_run(config, classifier))
    worlds_dir = workspace.eval_dir / "worlds"
    with hold_folder(worlds_dir), (engine or EngineConfig()).open(gpus=int(classifier.device != "cpu")) as workers:
        everything = config.keep or config.renderer != RIG
        kept = KeptFrames(run_dir / "frames", asked.stage, asked.places, asked.item.spec, everything)
        renderer = None
        if config.renderer != RIG:
            shots = shoot_missing(Address.parse(config.renderer), asked.stage, asked.places, asked.tasks(), kept)
            asked, renderer = replace(asked, shots=shots), shots.renderer
        said = ask_missing(asked, worlds_dir / "answers.jsonl", None if asked.shots else kept, workers)
    results = WorldResults(
        config,
        classifier,
        asked.item,
        asked.true_index,
        stage=asked.stage,
        places=said.places,
        answers=said.answers,
        renderer=renderer,
    )
    return WorldRun(results, write_results(run_dir, results, kept), said.computed, said.kept, said.failed)


def plan_run(workspace: Workspace, classifier: Classifier, config: WorldEvalConfig) -> Asked:
    """Everything before the first picture: object, world, places and cameras; raises as `evaluate_world`."""
    item = load_object(workspace.object_spec(config.object))
    true_index = classifier.class_index(item.spec.class_name)
    variants = dress_variants(workspace, item, config)
    world = open_world(workspace, config.world, config.world_seed, config.scale)
    sky = make_sky(config.time, config.seed)
    if config.renderer != RIG:
        if config.time != WorldEvalConfig.model_fields["time"].default:
            raise FieldError("goes with {renderer} raycast: a simulator has a sky of its own", {"time": config.time})
        sky = replace(sky, name="simulator's own")
    bare = scale_to_world(item.mesh, item.spec, config.length_m)
    # all variants stand in the same places, so the widest decides
    radius = max(find_radius(one.mesh) for one in variants.values())
    spots = choose_places(world, radius, config.places, config.seed, kinds=config.kinds)
    placed = tuple(place_object(bare, world, spot, sky) for spot in spots)
    side = classifier.preprocessing.crop_px
    camera = Camera.from_fov(side, side, config.fov_deg)
    stage = Stage(world, sky, camera, config.seed, placed, variants)
    places = plan_places(stage, config)
    return Asked(item, stage, places, classifier, true_index, config.weathers, config.batch_size)


def name_run(config: WorldEvalConfig, classifier: Classifier) -> str:
    """World, object and network, such as `world-city-warplane-resnet18`."""
    words = f"world-{Path(config.world).stem}-{config.object}-{classifier.name}"
    return re.sub(r"[^A-Za-z0-9._-]+", "-", words)[:LONGEST_NAME]


def dress_variants(workspace: Workspace, item: TableObject, config: WorldEvalConfig) -> dict[str, WorldVariant]:
    """The object in every variant, in metres."""
    found = {}
    for name in config.variants:
        if name == ABSENT:
            found[name] = WorldVariant(make_speck(), np.zeros(1, bool))
        else:
            mesh = apply_booster(item, find_booster(workspace, item, name))
            found[name] = WorldVariant.of(scale_to_world(mesh, item.spec, config.length_m), item.mesh)
    return found


def plan_places(stage: Stage, config: WorldEvalConfig) -> tuple[PlaceCameras, ...]:
    """The cameras at every place."""
    found = []
    with progress("planning cameras (places)", len(stage.places)) as bar:
        for k, placed in enumerate(stage.places):
            # a stream of draws for each place; 51 keeps it apart from the seed's other uses
            rng = np.random.default_rng([config.seed, 51, k])
            grid, extent = config.grid, config.extent
            found.append(plan_cameras(stage.world, placed, stage.camera, grid, extent, config.sample, rng))
            bar.advance()
    return tuple(found)
