"""An evaluation in a world, from a config to a results folder: place, plan, render, weather, ask, summarise, write."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toolkit.captures.shoot import LOOK_VERSION
from toolkit.core.console import progress
from toolkit.core.files import sha256_bytes
from toolkit.core.locks import hold_folder
from toolkit.core.workspace import Workspace
from toolkit.evaluation.predict import classify_stream
from toolkit.models.network import Classifier
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.mesh import hash_mesh
from toolkit.rig.camera import Camera
from toolkit.rig.variants import dress, find_booster
from toolkit.world_eval.answers import (
    METHOD_VERSION,
    Answer,
    Answers,
    FrameAnswers,
    WeatherKey,
    hash_inputs,
    make_answer,
    name_weather,
    open_answers,
    read_answers,
)
from toolkit.world_eval.cameras import PlaceCameras, plan_cameras
from toolkit.world_eval.config import ABSENT, WorldEvalConfig
from toolkit.world_eval.frames import Stage, Task, Variant, render_frames
from toolkit.world_eval.keep import KeptFrames
from toolkit.world_eval.report import WorldFiles, write_results
from toolkit.world_eval.results import WorldResults
from toolkit.worlds.catalogue import open_world
from toolkit.worlds.picture import make_speck
from toolkit.worlds.place import choose_places, find_radius, place_object, scale_to_world
from toolkit.worlds.sky import Sky, make_sky

BATCH_FRAMES = 4
"""Frames whose answers are written together: what a kill may cost."""
LONGEST_NAME = 90


@dataclass(frozen=True)
class WorldRun:
    """What a run found, and where it is.

    Attributes:
        results: the answers and what they were given to.
        files: what was written.
        computed, kept: answers that were computed now, and taken from before.
    """

    results: WorldResults
    files: WorldFiles
    computed: int
    kept: int


def evaluate_world(workspace: Workspace, classifier: Classifier, config: WorldEvalConfig) -> WorldRun:
    """Put an object into a world, look at it from a grid of cameras through weather, and ask a network what it sees.

    Results go to `eval/RUN`. An answer is computed once, whatever run asks for it.

    Args:
        workspace: whose objects, patches and textures are meant, and whose `eval/` is written to.
        classifier: who is asked.
        config: object, variants, world, cameras and weathers.

    Raises:
        ToolkitError: an unknown object, variant, world or weather, a missing booster, an object that is larger than
            every place, no camera that can stand, a network's output that is not finite, or a disk that is full.
    """
    asked = plan_run(workspace, classifier, config)
    run_dir = workspace.eval_dir / (config.run or name_run(config, classifier))
    worlds_dir = workspace.eval_dir / "worlds"
    with hold_folder(worlds_dir):
        kept = KeptFrames(run_dir / "frames", asked.stage, asked.places, asked.item.spec, everything=config.keep)
        answers, computed = ask_missing(asked, worlds_dir / "answers.jsonl", kept)
    results = WorldResults(config, classifier, asked.item, asked.true_index, asked.stage, asked.places, answers)
    total = sum(len(one.true_rank) for one in answers.values())
    return WorldRun(results, write_results(run_dir, results, kept), computed, total - computed)


def plan_run(workspace: Workspace, classifier: Classifier, config: WorldEvalConfig) -> "Asked":
    """Everything before the first picture: object, world, places and cameras; raises as `evaluate_world`."""
    item = load_object(workspace.object_spec(config.object))
    true_index = classifier.class_index(item.spec.class_name)
    variants = dress_variants(workspace, item, config)
    world = open_world(workspace, config.world, config.world_seed, config.scale)
    sky = make_sky(config.time, config.seed)
    bare = scale_to_world(item.mesh, item.spec, config.length_m)
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


def dress_variants(workspace: Workspace, item: TableObject, config: WorldEvalConfig) -> dict[str, Variant]:
    """The object in every variant, in metres."""
    found = {}
    for name in config.variants:
        if name == ABSENT:
            found[name] = Variant(make_speck(), np.zeros(1, bool))
        else:
            mesh = dress(item, find_booster(workspace, item, name))
            found[name] = Variant.of(scale_to_world(mesh, item.spec, config.length_m), item.mesh)
    return found


def plan_places(stage: Stage, config: WorldEvalConfig) -> tuple[PlaceCameras, ...]:
    """The cameras at every place."""
    found = []
    with progress("planning cameras (places)", len(stage.places)) as bar:
        for k, placed in enumerate(stage.places):
            rng = np.random.default_rng([config.seed, 51, k])
            grid, extent = config.grid, config.extent
            found.append(plan_cameras(stage.world, placed, stage.camera, grid, extent, config.sample, rng))
            bar.advance()
    return tuple(found)


@dataclass(frozen=True)
class Asked:
    """What is asked of whom.

    Attributes:
        item: the object.
        stage: world, sky, camera, places and variants.
        places: the cameras at each place.
        classifier: who is asked.
        true_index: class of the object.
        weathers: that every frame is seen in.
        batch_size: pictures that are gathered for a pass.
    """

    item: TableObject
    stage: Stage
    places: tuple[PlaceCameras, ...]
    classifier: Classifier
    true_index: int
    weathers: tuple[WeatherKey, ...]
    batch_size: int | None

    def tasks(self) -> list[Task]:
        """Every frame in every weather; those of a place and variant follow each other."""
        stage = self.stage
        camera = stage.camera.intrinsics
        shared = hash_inputs(
            METHOD_VERSION, LOOK_VERSION, stage.world.sha256, _hash_sky(stage.sky), camera, stage.seed,
            self.classifier.arch, self.classifier.weights.sha256, self.classifier.preprocessing.describe(),
            self.true_index,
        )  # fmt: skip
        meshes = {name: hash_mesh(one.mesh) for name, one in stage.variants.items()}
        tasks = []
        for k, place in enumerate(self.places):
            stand = place.placed.stand
            for name in stage.variants:
                there = hash_inputs(shared, meshes[name], list(stand.place), stand.turn_deg)
                for one in place.cameras:
                    item = k * 1_000_000_000 + one.number  # a grid has at most a million points
                    frame = hash_inputs(there, one.T_world_camera.tolist(), item)
                    tasks.append(Task(frame, k, name, item, one, self.weathers, False))
        return tasks


def _hash_sky(sky: Sky) -> str:
    light = np.array([sky.sun.azimuth_deg, sky.sun.elevation_deg, *sky.sun.irradiance, sky.exposure, sky.lamps])
    return sha256_bytes(np.ascontiguousarray(sky.panorama).tobytes() + light.tobytes())


def ask_missing(asked: Asked, log: Path, kept: KeptFrames) -> tuple[dict[tuple[str, WeatherKey], Answers], int]:
    """Answers by variant and weather, those that are not in the log computed and added to it, and how many these are.

    Memory holds one batch of pictures and a few frames, whatever the size of the grid. A killed run goes on with the
    next frames.
    """
    tasks = asked.tasks()
    known = read_answers(log, (task.frame for task in tasks))
    names = {weather: name_weather(weather) for weather in asked.weathers}
    missing = [(task, [w for w in task.weathers if names[w] not in known[task.frame]]) for task in tasks]
    wanted = [
        task if kept.lacks(task) else task._replace(weathers=tuple(weathers))
        for task, weathers in missing
        if weathers or kept.lacks(task)
    ]
    wanted = [task._replace(is_kept=kept.wants(task)) for task in wanted]
    computed = sum(len(task.weathers) for task in wanted)
    total = len(tasks) * len(asked.weathers)
    with progress("evaluating (pictures)", total, done=total - computed) as bar:
        for lines in _answer_frames(asked, wanted, names, kept):
            open_answers(log).append(*lines)
            for line in lines:
                known[line.frame].update(line.answers)
            bar.advance(sum(len(line.answers) for line in lines))
    return {
        (variant, weather): Answers.of(known[task.frame][names[weather]] for task in tasks if task.variant == variant)
        for variant in asked.stage.variants
        for weather in asked.weathers
    }, computed


def _answer_frames(
    asked: Asked, tasks: Sequence[Task], names: dict[WeatherKey, str], kept: KeptFrames
) -> Iterator[list[FrameAnswers]]:
    """Answers of a few frames at a time, each frame's whole, in order."""

    def show() -> Iterator[tuple[tuple[Task, WeatherKey], np.ndarray]]:
        for frame in render_frames(asked.stage, tasks):
            if frame.task.is_kept:
                kept.write(frame)
            for weather, picture in zip(frame.task.weathers, frame.pictures, strict=True):
                yield (frame.task, weather), picture

    lines: list[FrameAnswers] = []
    answers: dict[str, Answer] = {}
    for (task, weather), order, probabilities in classify_stream(show(), asked.classifier, asked.batch_size):
        answers[names[weather]] = make_answer(order, probabilities, asked.true_index)
        if weather == task.weathers[-1]:
            lines.append(FrameAnswers(frame=task.frame, answers=answers))
            answers = {}
        if len(lines) == BATCH_FRAMES:
            yield lines
            lines = []
    if lines:
        yield lines
