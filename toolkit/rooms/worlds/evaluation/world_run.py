"""An evaluation in a world, from a config to a results folder: place, plan, render, ask, summarise, write.

Frames without an answer are work units: some frames of a variant at a place, each in all of its weathers, which
share a render.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from toolkit.captures.shoot import SHOTS
from toolkit.core.console import progress
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import sha256_bytes, sha256_json
from toolkit.core.records import hold_folder
from toolkit.core.work import INPUTS, NOWHERE, Work
from toolkit.core.workspace import Workspace
from toolkit.engine import EngineConfig
from toolkit.engine.units import Engine, Ran, Shared, Unit, WorkLog, cut_groups, run_resumable
from toolkit.evaluation.run_files import explain_run_dir, find_run_dir, lacks_other_inputs
from toolkit.models.identity import describe_network
from toolkit.models.network import Classifier
from toolkit.models.predict import CPU_PART, RankedAnswer, predict_stream
from toolkit.objects.load import TableObject, load_object, scale_to_world
from toolkit.objects.mesh import hash_mesh
from toolkit.rig.bake_cache import BakedLight, keep_light, light_surroundings
from toolkit.rig.camera import Camera
from toolkit.rig.renderers import RAYCAST, RENDERERS
from toolkit.rig.variants import apply_booster, find_booster
from toolkit.rooms.worlds.airsim import Address
from toolkit.rooms.worlds.evaluation import ABSENT, WorldEvalConfig
from toolkit.rooms.worlds.evaluation.cameras import PlaceCameras, plan_cameras
from toolkit.rooms.worlds.evaluation.frames import (
    FRAMES,
    AnswerKey,
    Frame,
    FrameAnswers,
    FrameSource,
    PictureTask,
    Stage,
    ViewAnswers,
    WeatherKey,
    WorldVariant,
    make_answer,
    name_weather,
    render_frames,
)
from toolkit.rooms.worlds.evaluation.keep import KeptFrames, ShotFrames, encode_frame
from toolkit.rooms.worlds.evaluation.simulator import shoot_missing
from toolkit.rooms.worlds.evaluation.world_report import WorldFiles, write_results
from toolkit.rooms.worlds.evaluation.world_results import WorldResults
from toolkit.rooms.worlds.own import open_world
from toolkit.rooms.worlds.picture import make_speck
from toolkit.rooms.worlds.place import choose_places, find_radius, place_object
from toolkit.rooms.worlds.sky import Sky, make_sky

UNIT_PICTURES = 256
"""Pictures of a unit, about: what a kill may cost is two units for each worker."""


@dataclass(frozen=True)
class Asked:
    """An evaluation's object, places and network."""

    item: TableObject
    stage: Stage  # world, sky, camera, places and variants
    places: tuple[PlaceCameras, ...]  # the cameras at each place
    classifier: Classifier  # who is asked
    true_index: int  # class of the object
    weathers: tuple[WeatherKey, ...]  # that every frame is seen in
    batch_size: int | None  # pictures that are gathered for a pass
    shots: ShotFrames | None = None  # pictures that a simulator made, if a simulator was used

    def tasks(self) -> list[PictureTask]:
        """Every frame in every weather; those of a place and variant follow each other."""
        stage = self.stage
        camera = stage.camera.intrinsics
        network = (
            self.classifier.arch, self.classifier.weights.sha256, self.classifier.preprocessing.describe(),
            self.true_index,
        )  # fmt: skip
        # frames of the default renderer keep their hash
        other = () if stage.renderer == RAYCAST else (stage.renderer, RENDERERS[stage.renderer].version)
        shared = FRAMES.key(
            SHOTS.version, stage.world.sha256, _hash_sky(stage.sky), camera, stage.seed, *network, *other
        )
        # a variant is identified by its mesh, so an edited booster makes new frames
        meshes = {name: hash_mesh(variant.mesh) for name, variant in stage.variants.items()}
        tasks = []
        for k, place in enumerate(self.places):
            stand = place.placed.stand
            for name in stage.variants:
                # hashed once for each place, not for each of its cameras
                there = sha256_json([shared, meshes[name], list(stand.place), stand.turn_deg])
                for grid_camera in place.cameras:
                    item = k * 1_000_000_000 + grid_camera.number  # a grid has at most a million points
                    frame = sha256_json([there, grid_camera.T_world_camera.tolist(), item])
                    tasks.append(PictureTask(frame, k, name, item, grid_camera, self.weathers, False))
        if self.shots is None:
            return tasks
        # a simulator's pictures are known by their bytes: what they were made of is not ours to hash
        return [task._replace(frame=FRAMES.key(*network, self.shots.hash_pictures(task))) for task in tasks]


def _hash_sky(sky: Sky) -> str:
    # by the light itself: another file of the same name may hold another sky
    light = np.array([sky.sun.azimuth_deg, sky.sun.elevation_deg, *sky.sun.irradiance, sky.exposure, sky.lamps])
    return sha256_bytes(np.ascontiguousarray(sky.panorama).tobytes() + light.tobytes())


Answers = tuple[tuple[PlaceCameras, ...], dict[tuple[str, WeatherKey], ViewAnswers]]
"""The cameras whose pictures were all answered, a place without any left out; by variant and weather what was said."""


def ask_missing(asked: Asked, log: Path, kept: KeptFrames | None, engine: Engine) -> tuple[Answers, Ran]:
    """All answers, those that are not in the log computed and added to it.

    Memory holds the units that wait, and in one process a batch of pictures and a few frames, whatever the size of the
    grid. A killed run resumes with the next frames. If a unit fails, its cameras are left out.

    Args:
        kept: gets the frames that stay on disk; None where all are there, as a simulator's are.

    Raises:
        ToolkitError: no camera is left, or the disk is full.
    """
    tasks = asked.tasks()
    wanted = {task.frame: task for task in tasks}  # a simulator may give the same pictures twice
    names = {weather: name_weather(weather) for weather in asked.weathers}
    keys = {(frame, name) for frame in wanted for name in names.values()}
    cache = WorkLog(log, FrameAnswers, FrameAnswers.entries, keys)

    def find_rest(task: PictureTask) -> PictureTask:
        """Missing weathers of a frame: all of them if it must be kept on disk and is not."""
        weathers = [weather for weather in task.weathers if (task.frame, names[weather]) not in cache.known]
        if kept is None:
            return task._replace(weathers=tuple(weathers))
        return task._replace(weathers=task.weathers if kept.lacks(task) else tuple(weathers), is_kept=kept.wants(task))

    missing = {frame: rest for frame, task in wanted.items() if (rest := find_rest(task)).weathers}

    def keep(frame: str, task: PictureTask, answered: AnsweredFrame) -> None:
        answers, files = answered
        if files and kept is not None:
            kept.write(task, files)
        cache.add(FrameAnswers(frame=frame, answers=answers))

    # answers are kept frame by frame, so an interrupted run resumes
    units = list_units(asked, missing, engine)
    ran = run_resumable(
        "evaluating (pictures)", wanted, missing, units, keep, engine, log.parent, lambda task: len(task.weathers)
    )
    found = _gather(asked, tasks, cache.known)
    if not found[0]:
        raise ToolkitError(ran.failed[0][1])
    return found, ran


def _gather(asked: Asked, tasks: Sequence[PictureTask], known: Mapping[AnswerKey, RankedAnswer]) -> Answers:
    """Cameras with answers in every variant and weather, and their answers: all variants keep the same cameras."""
    names = {weather: name_weather(weather) for weather in asked.weathers}
    # an image without an answer in any variant or weather removes its camera everywhere, or pairs would be uneven
    failed: list[set[int]] = [set() for _ in asked.places]
    for task in tasks:
        if any((task.frame, name) not in known for name in names.values()):
            failed[task.place].add(task.camera.number)
    places = tuple(place.without(lost) for place, lost in zip(asked.places, failed, strict=True))
    whole = [task for task in tasks if task.camera.number not in failed[task.place]]
    answers = {
        (variant, weather): ViewAnswers.of(
            known[task.frame, names[weather]] for task in whole if task.variant == variant
        )
        for variant in asked.stage.variants
        for weather in asked.weathers
        if whole
    }
    return tuple(place for place in places if place.cameras), answers


class Rendered(NamedTuple):
    """Frames of our renderers."""

    stage: Stage  # what is rendered
    light: BakedLight  # on what stands around, worked out once by the driver

    def frames(self, tasks: Sequence[PictureTask]) -> Iterator[Frame]:
        """See `render_frames`."""
        keep_light(self.stage.places[0].scene, self.light)
        return render_frames(self.stage, tasks)


AnsweredFrame = tuple[dict[str, RankedAnswer], dict[str, bytes]]
"""Guesses for a frame, by the weather's name (`name_weather`); files of a kept frame, see `encode_frame`."""


class Setup(NamedTuple):
    """Inputs of all units of a run."""

    source: FrameSource  # of the pictures
    classifier: Classifier  # classifier, true_index, batch_size: see `Asked`
    true_index: int
    batch_size: int | None


def list_units(asked: Asked, tasks: Mapping[str, PictureTask], engine: Engine) -> Iterator[Unit[AnsweredFrame]]:
    """Units of frames; those of a place and variant follow each other, so that a worker lights each object once."""
    stage = asked.stage
    source = asked.shots or Rendered(stage, light_surroundings(stage.places[0].scene))
    setup = engine.share(Setup(source, asked.classifier, asked.true_index, asked.batch_size))
    most = max(len(task.weathers) for task in tasks.values())
    count = max(1, round(UNIT_PICTURES / most / CPU_PART)) * CPU_PART  # its pictures fill whole passes
    for frames, some in cut_groups(tasks, lambda task: (task.place, task.variant), count):
        place, variant = stage.places[some[0].place].spot.name, some[0].variant
        name = f"{place} {variant} cameras {some[0].camera.number}-{some[-1].camera.number}"
        yield Unit(frames, answer_unit, (setup, tuple(some)), name)


def answer_unit(shared: Shared[Setup], tasks: Sequence[PictureTask]) -> Iterator[AnsweredFrame]:
    """The work of a unit: its frames' answers, each frame's whole, in order."""
    setup = shared.get()

    # images of a unit go through the network in batches that may mix frames
    def show() -> Iterator[tuple[tuple[int, WeatherKey, dict[str, bytes]], np.ndarray]]:
        for at, frame in enumerate(setup.source.frames(tasks)):
            files = encode_frame(frame) if frame.task.is_kept else {}
            for weather, picture in zip(frame.task.weathers, frame.pictures, strict=True):
                yield (at, weather, files), picture

    answers: dict[str, RankedAnswer] = {}
    for (at, weather, files), logits in predict_stream(show(), setup.classifier, setup.batch_size):
        answers[name_weather(weather)] = make_answer(logits, setup.true_index)
        # the last of its weathers makes a frame whole
        if weather == tasks[at].weathers[-1]:
            yield answers, files
            answers = {}


LONGEST_NAME = 90


@dataclass(frozen=True)
class WorldRun:
    """Results of a run, and their files."""

    results: WorldResults  # the answers and what they were given to
    files: WorldFiles  # what was written
    computed: int  # computed, kept: answers that were computed now, and taken from before
    kept: int
    # (what, reason) of pictures that could not be made or answered; the next run tries them again
    failed: tuple[tuple[str, str], ...] = ()


def evaluate_world(
    workspace: Workspace, classifier: Classifier, config: WorldEvalConfig, engine: EngineConfig | None = None
) -> WorldRun:
    """Put an object into a world, look at it from a grid of cameras through weather, and ask a network what it sees.

    Results go to `eval/RUN`. An answer is computed once, whatever run asks for it. A camera whose picture fails in a
    variant is left out in all of them.

    Args:
        workspace: whose objects, patches and textures are meant, and whose `eval/` is written to.
        engine: where frames are rendered and answered; by default in this process.

    Raises:
        ToolkitError: an unknown object, variant, world or weather, a missing booster, an object that is larger than
            every place, no camera that can stand, a network whose output is never finite, a disk that is full, or a
            simulator that does not do as it is told.
    """
    # workers on other machines could not read a simulator's images
    if config.is_simulated and engine is not None and engine.engine != "local":
        raise FieldError(
            "expected local with a simulator, whose pictures lie on this machine", {"engine": engine.engine}
        )
    asked = plan_run(workspace, classifier, config)
    wanted = workspace.eval_dir / (config.run or name_run(config, classifier))
    # known before the work: pictures of another result must not be replaced either
    network = describe_network(classifier)["network_id"]
    run = Work("world evaluation", FRAMES.version, old_at=NOWHERE)
    key = run.key(config.record(), network, [[task.frame, task.weathers] for task in asked.tasks()])
    run_dir = find_run_dir(wanted, lacks_other_inputs(key))
    worlds_dir = workspace.eval_dir / "worlds"
    with hold_folder(worlds_dir), (engine or EngineConfig()).open(gpus=int(classifier.device != "cpu")) as workers:
        everything = config.keep or config.is_simulated
        kept = KeptFrames(run_dir / "frames", asked.stage, asked.places, asked.item.spec, everything)
        # a simulator's pictures are all shot before the network is asked
        renderer = None
        if config.is_simulated:
            shots = shoot_missing(Address.parse(config.renderer), asked.stage, asked.places, asked.tasks(), kept)
            asked, renderer = replace(asked, shots=shots), shots.renderer
        (places, answers), ran = ask_missing(
            asked, worlds_dir / "answers.jsonl", None if asked.shots else kept, workers
        )
    results = WorldResults(
        config, classifier, asked.item, asked.true_index, asked.stage, places=places, answers=answers, renderer=renderer
    )
    about = {INPUTS: key, "notes": explain_run_dir(wanted, run_dir)}
    return WorldRun(results, write_results(run_dir, results, kept, about), ran.made, ran.kept, ran.failed)


def plan_run(workspace: Workspace, classifier: Classifier, config: WorldEvalConfig) -> Asked:
    """Everything before the first picture: object, world, places and cameras; raises as `evaluate_world`."""
    # object, class and variants
    item = load_object(workspace.object_spec(config.object))
    true_index = classifier.class_index(item.spec.class_name)
    variants = dress_variants(workspace, item, config)
    # world and sky; a simulator draws its own sky, so the time of day cannot be set
    world = open_world(workspace, config.world, config.world_seed, config.scale)
    sky = make_sky(config.time, config.seed)
    if config.is_simulated:
        if config.time != WorldEvalConfig.model_fields["time"].default:
            raise FieldError("goes with {renderer} raycast: a simulator draws its own sky", {"time": config.time})
        sky = replace(sky, name="simulator's own")
    bare = scale_to_world(item.mesh, item.spec, config.length_m)
    # all variants stand in the same places, so the widest decides
    radius = max(find_radius(variant.mesh) for variant in variants.values())
    spots = choose_places(world, radius, config.places, config.seed, kinds=config.kinds)
    placed = tuple(place_object(bare, world, spot, sky) for spot in spots)
    # the camera's image is as large as the network's crop: no resizing takes place
    side = classifier.preprocessing.crop_px
    camera = Camera.from_fov(side, side, config.fov_deg)
    renderer = RAYCAST if config.is_simulated else config.renderer
    stage = Stage(world, sky, camera, config.seed, placed, variants, renderer)
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
