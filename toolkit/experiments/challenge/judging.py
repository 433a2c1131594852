"""An entry rendered and shown to the judges: what `toolkit challenge run` does before it counts."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from toolkit.captures.read import UNPATCHED, Capture, read_captures
from toolkit.captures.shoot import ShootSettings, index_images, shoot_plan
from toolkit.core.console import notice
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import sha256_file, write_bytes
from toolkit.core.severities import SEVERITIES
from toolkit.core.workspace import Workspace
from toolkit.corruptions.catalogue import COMMON
from toolkit.engine.units import Engine
from toolkit.evaluation.ground_truth import find_true_classes
from toolkit.evaluation.predict import predict_once
from toolkit.experiments.challenge.entry import ChallengeEntry, check_entry, open_space
from toolkit.experiments.challenge.rules import DRAWN_SEED
from toolkit.experiments.challenge.score import (
    CLEAR,
    CORRUPTED,
    FOG,
    FOG_SEVERITY,
    PICTURES,
    SCORE,
    SHOWN_POSE,
    Judged,
    JudgedPicture,
    describe_judge,
    write_score,
)
from toolkit.imaging.colour import delta_e2000, lab_of_linear, srgb_to_linear
from toolkit.imaging.read import read_image
from toolkit.models.network import Classifier
from toolkit.objects.load import load_object
from toolkit.objects.mesh import cast_rays, make_ray_scene
from toolkit.rig.camera import pixel_rays
from toolkit.rig.plan import read_plan
from toolkit.rig.variants import CONTROLS_OF

LOOK_STRIDE = 4
"""Each fourth pixel each way says enough of how much the looks change."""


def run_entry(
    entry: ChallengeEntry, judges: Sequence[Classifier], workspace: Workspace, engine: Engine | None = None,
    *, with_controls: bool = True,
) -> Judged:  # fmt: skip
    """Render an entry, let the judges say what they see, and write `score/` in its folder.

    Pictures and answers are kept in `eval/challenge/` of the workspace: a run that was stopped goes on, and bare
    pictures serve all entries.

    Raises:
        ToolkitError: the entry breaks a rule, no judges, two of the same weights, or the disk is full.
    """
    faults = check_entry(entry.folder)
    if faults:
        more = f" (and {len(faults) - 1} more: 'toolkit challenge check {entry.folder}')" if len(faults) > 1 else ""
        raise ToolkitError(f"{entry.folder}: {faults[0]}{more}")
    if len({one.weights.sha256 for one in judges}) < max(1, len(judges)):
        raise FieldError("expected at least one network, each once", {"judge": [one.name for one in judges]})
    home = workspace.eval_dir / "challenge"
    captures = _shoot(entry, home, engine, with_controls)
    looks = dict(_measure_looks(entry, captures, home))
    outcomes: list[JudgedPicture] = []
    for judge in judges:
        notice(f"{judge.name} judges")
        outcomes += _ask(entry, judge, captures, home, looks)
    folder = entry.folder / SCORE
    for one in captures:
        if (one.variant, one.pose_id) == (entry.record.variant, SHOWN_POSE):
            write_bytes(folder / PICTURES / f"{one.object}.png", one.file.read_bytes(), entry.folder)
    return write_score(entry, [describe_judge(entry.record, one) for one in judges], outcomes)


def _shoot(entry: ChallengeEntry, home: Path, engine: Engine | None, with_controls: bool) -> list[Capture]:
    """The pictures of an entry; those that any entry before has alike are copied: bare, and with noise or grey."""
    space = open_space(entry, home / entry.record.name)
    controls = CONTROLS_OF.get(entry.record.variant, ()) if with_controls else ()
    if "wrong-patch" in controls and len(entry.objects) < 2:
        controls = tuple(name for name in controls if name != "wrong-patch")
    variants = (UNPATCHED, entry.record.variant, *controls)
    sources = sorted(home.glob(f"*/{space.captures_dir.name}/sim"))
    stored = {key: image for source in sources for key, image in index_images(source).items()}
    settings, plan = ShootSettings(image_format="png"), read_plan(space.plan_file)
    done = shoot_plan(space, plan, entry.objects, variants, settings, stored=stored, engine=engine)
    if done.failed:
        raise ToolkitError(f"{done.failed[0][0]}: {done.failed[0][1]}: a score needs all pictures: run it again")
    wanted = {f"{name}/{variant}" for name in entry.objects for variant in variants}
    found = read_captures(done.source_dir).captures
    return [one for one in found if one.path_in_source.rpartition("/")[0] in wanted]


def _measure_looks(
    entry: ChallengeEntry, captures: Sequence[Capture], home: Path
) -> Iterator[tuple[tuple[str, int], float]]:
    """By object and pose, CIEDE2000 between the bare and the boosted picture, mean over the object's pixels."""
    space_root = home / entry.record.name
    plan = read_plan(space_root / "rig" / "plan.json")
    by_key = {(one.object, one.variant, one.pose_id): one for one in captures}
    for name in entry.objects:
        scene = make_ray_scene(load_object(Workspace(space_root).object_spec(name)).mesh)
        camera = plan.camera
        x, y = np.meshgrid(*(np.arange(0, side, LOOK_STRIDE) for side in (camera.width, camera.height)))
        pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
        for pose in plan.objects[name]:
            rays = pixel_rays(camera, pose.matrix(), (pixels + 0.5).astype(np.float32))
            own = pixels[np.isfinite(cast_rays(scene, rays))]
            pair = (by_key[name, variant, pose.id] for variant in (UNPATCHED, entry.record.variant))
            bare, boosted = (read_image(one.file)[own[:, 1], own[:, 0]] / 255 for one in pair)
            change = delta_e2000(*(lab_of_linear(srgb_to_linear(one)) for one in (bare, boosted)))
            yield (name, pose.id), round(float(change.mean()), 4)


def choose_corruptions(pictures: Iterable[tuple[str, int]]) -> dict[tuple[str, int], tuple[str, int]]:
    """One of the 75 corruptions for each (object, pose), each about as often; the version draws their order."""
    every = list(product(COMMON, SEVERITIES))
    order = np.random.default_rng(DRAWN_SEED).permutation(len(every))
    return {key: every[order[k % len(every)]] for k, key in enumerate(sorted(set(pictures)))}


def _ask(
    entry: ChallengeEntry,
    judge: Classifier,
    captures: Sequence[Capture],
    home: Path,
    looks: Mapping[tuple[str, int], float],
) -> Iterator[JudgedPicture]:
    space = Workspace(home / entry.record.name)
    classes = find_true_classes(read_captures(space.captures_dir), space, judge)
    chosen = choose_corruptions((one.object, one.pose_id or 0) for one in captures)
    paired = [one for one in captures if one.variant in (UNPATCHED, entry.record.variant)]
    asked: list[tuple[str, Capture]] = [(CLEAR, one) for one in captures]
    asked += [(FOG, replace(one, corruption=(FOG, FOG_SEVERITY))) for one in paired]
    asked += [(CORRUPTED, replace(one, corruption=chosen[one.object, one.pose_id or 0])) for one in paired]
    said, _ = predict_once([one for _, one in asked], classes, judge, home / "answers.jsonl")
    hashes = {one.path: sha256_file(one.file) for one in captures}
    for (condition, capture), one in zip(asked, said, strict=True):
        corruption, severity = capture.corruption or ("", 0)
        is_own = condition == CLEAR and capture.variant == entry.record.variant
        yield JudgedPicture(
            judge_sha256=judge.weights.sha256, object=capture.object, pose=capture.pose_id or 0,
            variant=capture.variant, condition=condition, corruption=corruption, severity=severity,
            picture_sha256=hashes[capture.path], correct=one.correct_top1,
            delta_e=looks[capture.object, capture.pose_id or 0] if is_own else None,
        )  # fmt: skip
