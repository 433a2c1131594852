"""Train boosters on all networks but one, shoot the plan, and test the left-out network; then the next.

Every step resumes: training by its checkpoints, captures by their manifest, answers by the hash of their inputs. So the
command may be stopped at any time, and several may run at once, with different `left_out`.
"""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ConfigDict

from toolkit.boosters import texture_config
from toolkit.boosters.detectors import DetectorNetwork, refuse_for_detectors
from toolkit.boosters.texture import train_texture
from toolkit.boosters.train import train_for_object
from toolkit.captures.capture import UNPATCHED
from toolkit.captures.manifest import MANIFEST
from toolkit.captures.read import POOLED
from toolkit.captures.shoot import ShootSettings, StoredImage, index_images, shoot_plan
from toolkit.core.console import notice
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import read_json, sha256_file, write_json, write_text
from toolkit.core.statistics import wilson_interval
from toolkit.core.tables import format_interval, format_p
from toolkit.core.work import NOWHERE, Work
from toolkit.core.workspace import Workspace, copy_objects
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.detect import DetectionRun, evaluate_detector
from toolkit.evaluation.evaluate import Evaluation, evaluate_captures
from toolkit.evaluation.metrics import describe_change
from toolkit.evaluation.run_files import explain_run_dir, find_run_dir
from toolkit.evaluation.summaries import SCHEMA_VERSION
from toolkit.models.network import Classifier
from toolkit.objects.load import load_object
from toolkit.objects.spec import names_with_mesh
from toolkit.rig.plan import CapturePlan, hash_pose, open_plan, write_plan
from toolkit.rig.variants import NOUNS
from toolkit.rooms.benchmarks.transfer import FOR_CLASSIFIERS, Kind, TransferConfig

BOOSTED = {variant: noun for variant, noun in NOUNS.items() if noun in get_args(Kind)}
SOURCE = "sim"
JUDGED = Work("judged rows", old_at=NOWHERE)
Judge = Classifier | DetectorNetwork


class JudgedRow(BaseModel):
    """Answers of a network, the judge, to an object, or `all`, with a booster.

    Attributes:
        left_out: the network that the boosters were not trained on, or `classifiers` or `detectors`.
        seen: whether the boosters were trained on the judge.
        source: `sim`, or `sim-fog-3` and the like for corrupted captures.
        kind: patch or texture.
        n: number of poses shown both ways.
        bare: number of correct answers without the booster, and `boosted` with it. A detector is correct if a box of
            the object's class overlaps it by half.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    left_out: str
    trained_on: list[str]
    judge: str
    judge_sha256: str
    seen: bool
    source: str
    object: str
    kind: str
    n: int
    bare: int
    boosted: int
    gained: int
    lost: int
    mcnemar_p: float


class JudgedCell(BaseModel):
    """Answers of a network to the boosters that were trained without a network, by source, object and kind.

    Attributes:
        key: hash of all inputs.
        settings_sha256: key of the settings, poses, objects and networks of the run; empty in older files.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    key: str
    settings_sha256: str = ""
    rows: list[JudgedRow]


def collect_rows(done: Evaluation | DetectionRun, left_out: str, trained_on: Sequence[str]) -> list[JudgedRow]:
    """The pairs against `unpatched` of an evaluation."""
    judge, sha256 = done.summary["model"]["name"], done.summary["model"]["sha256"]
    rows = []
    # only pairs against the unmodified object, in variants that are boosted
    for pair in done.pairs:
        if pair.first != UNPATCHED or pair.second not in BOOSTED:
            continue
        found = pair.outcomes
        rows.append(JudgedRow(
            left_out=left_out, trained_on=list(trained_on), judge=judge, judge_sha256=sha256, seen=judge in trained_on,
            source=pair.source, object=pair.object, kind=BOOSTED[pair.second], n=found.n, bare=found.n_first,
            boosted=found.n_second, **describe_change(found),
        ))  # fmt: skip
    return rows


def write_matrix(folder: Path, rows: Sequence[JudgedRow], about: dict[str, Any]) -> tuple[Path, Path]:
    """Write `matrix.json` and `matrix.md`."""
    head = {"schema_version": SCHEMA_VERSION, "kind": "transfer", **about}
    content = head | {"rows": [row.model_dump() for row in rows]}
    text = "\n\n".join(["\n".join(_as_markdown(rows, seen)) for seen in (False, True)]) + "\n"
    return write_json(folder / "matrix.json", content), write_text(folder / "matrix.md", text)


def tabulate(rows: Sequence[JudgedRow], seen: bool) -> list[tuple[str, ...]]:
    """Cells of a table: each object for left-out networks, pooled rows for the others."""
    cells: list[tuple[str, ...]] = []
    several = len({row.object for row in rows} - {POOLED}) > 1
    # left-out networks object by object; for networks that were trained on, the pooled row is enough
    for row in rows:
        is_pooled = row.object == POOLED
        if row.seen is not seen or (is_pooled and not several) or (seen and several != is_pooled):
            continue
        low_high = format_interval(wilson_interval(row.boosted, row.n))
        cells.append((
            row.left_out, row.judge, row.kind, row.source, row.object, f"{row.bare} of {row.n}",
            f"{row.boosted} of {row.n} ({low_high})", str(row.gained), str(row.lost), format_p(row.mcnemar_p),
        ))  # fmt: skip
    return cells


HEADS = ("left out", "judged by", "booster", "source", "object", "unmodified", "boosted (95 %)", "gained", "lost", "p")


def _as_markdown(rows: Sequence[JudgedRow], seen: bool) -> list[str]:
    title = "Judged by the networks that it was trained on" if seen else "Judged by the network that was left out"
    table = [HEADS, ("---",) * len(HEADS), *tabulate(rows, seen)]
    return [f"{title}:", "", *(f"| {' | '.join(cells)} |" for cells in table)]


@dataclass(frozen=True)
class TransferResult:
    """Rows of every network that this run, or an earlier run of the same settings, left out, and their files."""

    rows: tuple[JudgedRow, ...]
    json_file: Path
    markdown_file: Path


def leave_one_out(workspace: Workspace, config: TransferConfig, networks: Sequence[Judge]) -> TransferResult:
    """Train without each network in turn, and let all of them judge.

    Boosters without the network NAME lie in a workspace `eval/transfer/RUN/without-NAME`, the matrix in
    `eval/transfer/RUN/matrix.json` and `.md`. A run of other settings writes to `RUN-2`. With both classifiers and
    detectors, each kind is left out as a whole, and judges boosters of the other kind.

    Args:
        workspace: has objects and plan, and gets the results.
        config: settings of training and judging.
        networks: at least two, of different names.

    Raises:
        ToolkitError: too few networks, a network that cannot train, an unknown object or network, or an error of
            training, shooting or judging.
    """
    trained_on = _choose_networks(config, networks)
    # objects and poses are the same without each network
    objects = list(config.objects) or names_with_mesh(workspace)
    plan = open_plan(workspace, objects)
    shown = _describe_objects(workspace, plan, objects)
    # the files of the matrix's cells, and the keys of their settings
    cells = {
        _name_cell(left_out, judge): _hash_settings(config, judge, others, shown)
        for left_out, others in trained_on.items()
        for judge in networks
    }
    # a run of the same settings resumes in its folder
    wanted = workspace.eval_dir / "transfer" / config.run
    folder = find_run_dir(wanted, lambda folder: _lacks_other_cells(folder, cells))
    for note in explain_run_dir(wanted, folder):
        notice(note)
    for left_out in config.left_out or trained_on:
        notice(f"without {left_out}")
        others = trained_on[left_out]
        # a separate workspace: boosters have the same names without another network
        space = copy_objects(workspace, folder / f"without-{name_folder(left_out)}")
        write_plan(space.plan_file, plan)
        # train, shoot, and let every network judge
        for name in objects:
            for kind in config.kinds:
                _train(space, kind, name, others, config)
        _shoot(space, plan, objects, config, folder)
        for judge in networks:
            _judge(space, judge, left_out, others, config, cells[_name_cell(left_out, judge)])
    # also of networks that an earlier run left out
    files = [folder / name for name in cells]
    rows = [row for file in files if file.is_file() for row in read_json(file, JudgedCell).rows]
    about = {"run": config.run, "settings": config.record(), "networks": {
        network.name: {"arch": network.arch, "weights": network.weights.name, "sha256": network.weights.sha256}
        | ({"kind": "detector"} if isinstance(network, DetectorNetwork) else {})
        for network in networks
    }}  # fmt: skip
    return TransferResult(tuple(rows), *write_matrix(folder, rows, about))


def _choose_networks(config: TransferConfig, networks: Sequence[Judge]) -> dict[str, list[Judge]]:
    """Return `group_networks`, of networks that go together and with the settings; a `ToolkitError` if they do not."""
    # two networks of the same name would share a folder
    names = [network.name for network in networks]
    if len(set(names)) < max(2, len(names)):
        raise FieldError("expected at least two networks, each once", {"model": names})
    if any(isinstance(network, DetectorNetwork) for network in networks):
        refuse_for_detectors([name for name in FOR_CLASSIFIERS if getattr(config, name) is not None])
    trained_on = group_networks(networks)
    for name in config.left_out:
        if name not in trained_on:
            raise one_of("network", name, list(trained_on))
    return trained_on


def group_networks(networks: Sequence[Judge]) -> dict[str, list[Judge]]:
    """Networks that train, by the left-out network, or kind if there are both."""
    detectors = [network for network in networks if isinstance(network, DetectorNetwork)]
    classifiers = [network for network in networks if not isinstance(network, DetectorNetwork)]
    if detectors and classifiers:
        return {"detectors": [*classifiers], "classifiers": [*detectors]}
    return {left_out.name: [network for network in networks if network is not left_out] for left_out in networks}


def _train(space: Workspace, kind: Kind, name: str, networks: list[Judge], config: TransferConfig) -> None:
    """Train or resume a booster, unless it is finished."""
    if kind == "texture":
        settings = texture_config.make_config("default", {**config.overrides(kind), "objects": (name,)})
        train_texture(settings, networks, space)
        return
    train_for_object(space, name, networks, config.overrides(kind), config.seed)


def _shoot(space: Workspace, plan: CapturePlan, objects: Sequence[str], config: TransferConfig, folder: Path) -> None:
    """Shoot the plan; pictures without boosters are copied from other left-out networks."""
    stored: dict[str, StoredImage] = {}
    for other in sorted(folder.glob(f"without-*/captures/{SOURCE}")):
        stored |= index_images(other)
    variants = ("unpatched", *(variant for variant, kind in BOOSTED.items() if kind in config.kinds))
    shoot_plan(space, plan, objects, variants, ShootSettings(config.seed), SOURCE, stored=stored)


def _describe_objects(workspace: Workspace, plan: CapturePlan, objects: Sequence[str]) -> list[Any]:
    """Each object's name, spec, mesh and poses, as JSON has them."""
    items = [load_object(workspace.object_spec(name)) for name in objects]
    return [
        [item.name, item.spec.model_dump(mode="json"), item.mesh_sha256]
        + [hash_pose(plan.camera, pose) for pose in plan.objects[item.name]]
        for item in items
    ]


def _hash_settings(config: TransferConfig, judge: Judge, others: Sequence[Judge], shown: list[Any]) -> str:
    """Key of the inputs of a cell's rows, so that rows of an earlier run count only for the same inputs."""
    settings = {name: value for name, value in config.record().items() if name not in ("run", "left_out")}
    every = (judge, *others)
    networks = [(network.name, network.weights.sha256, network.preprocessing.describe()) for network in every]
    return Work("transfer settings", JUDGED.version, old_at=NOWHERE).key(settings, networks, shown)


def _judge(
    space: Workspace, judge: Judge, left_out: str, others: Sequence[Judge], config: TransferConfig,
    settings_sha256: str,
) -> None:  # fmt: skip
    """Ask a network, unless it answered the same captures before."""
    captures = space.captures_dir / SOURCE
    seen = [network.name for network in others]
    # the manifest's hash stands for all images: it holds theirs
    key = JUDGED.key(
        sha256_file(captures / MANIFEST), judge.weights.sha256, judge.preprocessing.describe(), seen, config.kinds,
        config.objects, config.corruptions,
    )  # fmt: skip
    file = space.root.parent / _name_cell(left_out, judge)
    with suppress(ToolkitError):  # none yet, or damaged
        if read_json(file, JudgedCell).key == key:
            return
    settings = EvalConfig(
        run=name_folder(judge.name), replace=True, saliency=False, objects=config.objects,
        corruptions=config.corruptions,
    )  # fmt: skip
    # classifiers and detectors are judged by their own evaluation, and give the same rows
    if isinstance(judge, DetectorNetwork):
        rows = collect_rows(evaluate_detector(captures, space, judge.detector, settings), left_out, seen)
    else:
        rows = collect_rows(evaluate_captures(captures, space, judge, settings), left_out, seen)
    write_json(file, JudgedCell(key=key, settings_sha256=settings_sha256, rows=rows).model_dump())


def name_folder(network: str) -> str:
    """Turn a network's name into a folder's, such as `timm-tf_efficientnet_lite0`."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", network).strip("-.")


def _name_cell(left_out: str, judge: Judge) -> str:
    return f"without-{name_folder(left_out)}/judged-by-{name_folder(judge.name)}.json"


def _lacks_other_cells(folder: Path, cells: Mapping[str, str]) -> bool:
    """Whether all cells in a folder are those of a run, by the keys of its settings."""
    for file in folder.glob("without-*/judged-by-*.json"):
        with suppress(ToolkitError):  # damaged: it is judged again
            if read_json(file, JudgedCell).settings_sha256 != cells.get(file.relative_to(folder).as_posix()):
                return False
    return True
