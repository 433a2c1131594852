"""From an axis to `eval/sweeps/AXIS`: shoot every value as a separate source, evaluate all, write the results."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from toolkit.captures.read import CaptureFolder, Selection, read_captures
from toolkit.captures.shoot import ShootSettings, StoredImage, index_images, shoot_plan
from toolkit.core.console import progress, quietly
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.engine import EngineConfig
from toolkit.engine.units import Engine
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.evaluate import Evaluation, write_evaluation
from toolkit.evaluation.ground_truth import class_of_spec, find_true_classes
from toolkit.evaluation.origin import find_origin
from toolkit.evaluation.predict import predict_once
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.results import compare_predictions
from toolkit.models.network import Classifier
from toolkit.rig.applied.tag import parse_tag
from toolkit.rig.plan import open_plan
from toolkit.rig.renderers import RAYCAST
from toolkit.rooms.benchmarks.sweeps import SweepConfig
from toolkit.rooms.benchmarks.sweeps.axes import ShootSetup, SweepPoint, plan_units
from toolkit.rooms.benchmarks.sweeps.read_tags import read_tags
from toolkit.rooms.benchmarks.sweeps.sweep_rows import Sweep, draw_sweep, write_sweep


@dataclass(frozen=True)
class SweepResult:
    """Rows and files of a sweep.

    Attributes:
        evaluation: the report over all values, each a source.
        shot, kept: numbers of new images, and of images that were there before or serve several values.
        classified: number of images that the network classified now.
    """

    sweep: Sweep
    json_file: Path
    csv_file: Path
    figure_file: Path
    evaluation: Evaluation
    shot: int
    kept: int
    classified: int


def run_sweep(
    workspace: Workspace, config: SweepConfig, classifier: Classifier, base: ShootSetup | None = None,
    engine: EngineConfig | None = None, apart: str = "",
) -> SweepResult:  # fmt: skip
    """Vary a quantity and keep the rest.

    Images lie in `eval/sweeps/AXIS/captures/VALUE/OBJECT/VARIANT`, the report in `eval/sweeps/AXIS/MODEL`, and the rows
    in `sweep-MODEL.json` and `.csv`, drawn in `.png`. Earlier images and answers from the same inputs are reused, also
    from other axes and from `captures/sim`.

    Args:
        workspace: has objects and patches, and gets the results.
        config: the axis. Its `run` stands for MODEL.
        classifier: from `load_classifier`.
        base: fixed settings: by default the workspace's plan, and the rig's settings with the seed of `config`.
        engine: shoots the images; by default this process.
        apart: name of the changes in `base`, by which its captures and results lie apart.

    Raises:
        ToolkitError: an unknown object or variant, no patch, an object without a class of the network, or nothing that
            can be shot.
    """
    axis, values = config.parse()
    base = base or base_setup(workspace, config)
    specs = {name: workspace.object_spec(name) for name in config.objects or base.plan.objects}
    _check_classes(list(specs.values()), classifier)
    variants = config.shown()
    units = plan_units(workspace, axis, values, base, objects=list(specs), variants=variants, trained=config.trained)
    # values that cannot be shot are listed, and the others are shot
    possible = [unit for unit in units if unit.refused is None]
    if not possible:
        raise ToolkitError(f"no value of the sweep can be shot: {units[0].label}: {units[0].refused}")
    folder = workspace.eval_dir / "sweeps" / axis.name
    # the folder's name holds what differs besides the axis
    patches = "trained" if config.trained else workspace.patch_set
    renderer = None if base.settings.renderer == RAYCAST else base.settings.renderer
    name = "-".join(filter(None, (config.run or classifier.name, apart)))
    if config.run is None:
        name = "-".join(dict.fromkeys(filter(None, (classifier.name, patches, renderer, apart))))
    # two sets of patches or two renderers in the same folder would be shot again each time
    captures_dir = folder / "-".join(filter(None, ("captures", patches, renderer, apart)))
    # shoot, judge and compare, then write the report and the rows
    with (engine or EngineConfig()).open() as workers:
        shot, kept, stale, unshot = _shoot_units(workspace, possible, variants, captures_dir, workers)
    captures = _read_units(captures_dir, possible, variants, stale)
    predictions, classified = _judge(workspace, captures, classifier)
    findings = compare_predictions(classifier.name, predictions, (*captures.refused_folders, *unshot))
    findings = replace(findings, origin=find_origin(captures, findings.no_pairs, classifier))
    settings = EvalConfig(saliency=False)
    evaluation = write_evaluation(folder / name, classifier, findings, captures.notes, settings, kind="sweep")
    # another sweep of this name keeps its files
    name = evaluation.run_dir.name
    model = {key: evaluation.summary["model"][key] for key in ("name", "arch", "weights", "sha256")}
    sweep = Sweep(axis, base.settings, model, tuple(units), variants, findings)
    json_file, csv_file = write_sweep(folder, name, sweep)
    figure_file = draw_sweep(folder / f"sweep-{name}.png", sweep)
    return SweepResult(sweep, json_file, csv_file, figure_file, evaluation, shot=shot, kept=kept, classified=classified)


def _judge(workspace: Workspace, captures: CaptureFolder, classifier: Classifier) -> tuple[list[Prediction], int]:
    """Return predictions in the order of the captures, tags by their reader, and how many the network made now."""
    classes = find_true_classes(captures, workspace, classifier)
    cache_file = workspace.eval_dir / "sweeps" / "predictions.jsonl"
    seen = [capture for capture in captures.captures if parse_tag(capture.variant) is None]
    predictions, classified = predict_once(seen, classes, classifier, cache_file)
    tags = [capture for capture in captures.captures if parse_tag(capture.variant) is not None]
    predictions += read_tags(tags, classes, classifier.labels)
    order = {capture: at for at, capture in enumerate(captures.captures)}
    return sorted(predictions, key=lambda prediction: order[prediction.capture]), classified


def base_setup(workspace: Workspace, config: SweepConfig) -> ShootSetup:
    """Default settings of a sweep: the workspace's plan, and the rig's settings with the seed."""
    plan = open_plan(workspace, list(config.objects) or None)
    return ShootSetup(plan, ShootSettings(config.seed, renderer=config.renderer))


def _check_classes(spec_files: Sequence[Path], classifier: Classifier) -> None:
    """Find objects without a class of the network before the work."""
    for spec_file in spec_files:
        try:
            class_of_spec(spec_file, classifier)
        except ToolkitError as error:
            others = "; or sweep the other objects, each by its name" if len(spec_files) > 1 else ""
            raise ToolkitError(f"{error}{others}") from None


def _shoot_units(
    workspace: Workspace, units: Sequence[SweepPoint], variants: Sequence[str], captures_dir: Path, engine: Engine
) -> tuple[int, int, set[str], list[tuple[str, str]]]:
    """Numbers of shot and kept images, paths of images of other units, and (what, reason) of failed images."""
    # images of `capture-sim` and of other sweeps, by the hash of their inputs
    stored = dict(_find_stored(workspace))
    shot = kept = 0
    stale: set[str] = set()
    failed: list[tuple[str, str]] = []
    images = sum(len(unit.setup.plan.objects[unit.object]) for unit in units) * len(variants)
    # a single progress bar for all values
    with progress("shooting", images) as bar, quietly():
        for unit in units:
            # with trained sets, each value has patches of its own
            space = workspace if unit.patch_set is None else workspace.with_patches(unit.patch_set)
            result = shoot_plan(
                space, unit.setup.plan, [unit.object], variants, unit.setup.settings, source=unit.label,
                captures_dir=captures_dir, patch_mm=unit.setup.patch_mm, stored=stored, engine=engine, bar=bar,
            )  # fmt: skip
            bar.advance(result.kept)
            shot, kept = shot + result.shot, kept + result.kept
            stale |= {f"{unit.label}/{path}" for path in result.stale}
            failed += [(f"{unit.label} {what}", reason) for what, reason in result.failed]
            # the images of a value may serve the next
            stored |= index_images(result.source_dir)
    return shot, kept, stale, failed


def _find_stored(workspace: Workspace) -> Iterator[tuple[str, StoredImage]]:
    sources = [workspace.captures_dir / "sim", *sorted(workspace.eval_dir.glob("sweeps/*/captures*/*"))]
    for source_dir in sources:
        # only a store: unreadable images are shot again
        with contextlib.suppress(ToolkitError, OSError):
            yield from index_images(source_dir).items()


def _read_units(
    captures_dir: Path, units: Sequence[SweepPoint], variants: Sequence[str], stale: set[str]
) -> CaptureFolder:
    """Read the images of these units alone, value by value."""
    folder = read_captures(captures_dir, Selection(tuple(dict.fromkeys(unit.label for unit in units)), (), ()))
    wanted = {(unit.label, unit.object) for unit in units}
    corruption = {unit.label: unit.setup.corruption for unit in units}
    captures = [
        replace(capture, corruption=corruption[capture.source])
        for capture in folder.captures
        if (capture.source, capture.object) in wanted and capture.variant in variants and capture.path not in stale
    ]
    return replace(folder, captures=tuple(captures))
