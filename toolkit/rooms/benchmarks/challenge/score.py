"""Render, judge and score an entry; the score follows from `outcomes.csv` alone, so that everybody can recount it."""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from rich.table import Table

from toolkit import __version__
from toolkit.captures.capture import UNPATCHED, Capture
from toolkit.captures.read import POOLED, read_captures
from toolkit.captures.shoot import ShootSettings, index_images, shoot_plan
from toolkit.core.console import notice
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import (
    explain_validation,
    inside,
    read_bytes,
    read_json,
    sha256_bytes,
    sha256_file,
    write_bytes,
    write_json,
    write_text,
)
from toolkit.core.statistics import Interval, PairedOutcomes
from toolkit.core.tables import build_table, encode_csv, format_percent, format_points, format_points_interval
from toolkit.core.workspace import Workspace
from toolkit.corruptions.catalogue import COMMON, SEVERITIES
from toolkit.engine.units import Engine
from toolkit.evaluation.ground_truth import find_true_classes
from toolkit.evaluation.metrics import describe_change, estimate_difference
from toolkit.evaluation.predict import predict_once
from toolkit.evaluation.run_files import explain_run_dir, find_run_dir
from toolkit.imaging.colour import delta_e2000, lab_of_linear, srgb_to_linear
from toolkit.imaging.printer import score_print
from toolkit.imaging.read import decode_image, read_image
from toolkit.models.identity import KNOWN_TENSORS, hash_network_tensors
from toolkit.models.network import Classifier
from toolkit.objects.load import load_object
from toolkit.objects.mesh import cast_rays, make_ray_scene
from toolkit.rig.camera import pixel_rays
from toolkit.rig.plan import read_plan
from toolkit.rig.variants import CONTROLS_OF
from toolkit.rooms.benchmarks.challenge import DRAWN_SEED, JUDGES, NO_CONTROLS, POSES, VERSION
from toolkit.rooms.benchmarks.challenge.entry import (
    ENTRY,
    OUTCOMES,
    PICTURES,
    SCORE,
    SCORE_FILE,
    SCORE_FOLDER,
    ChallengeEntry,
    EntryRecord,
    check_entry,
    list_score_folders,
    open_space,
    read_entry,
)

CLEAR, FOG, CORRUPTED = "clear", "fog", "corrupted"
CONDITIONS = (CLEAR, FOG, CORRUPTED)
"""Clear; ImageNet-C's fog of severity 3; another of its 75 corruptions for each picture in turn."""
FOG_SEVERITY = 3
UNSEEN, SEEN = "unseen", "seen"
MOST_OUTCOMES_BYTES, MOST_PICTURE_BYTES = 256 << 20, 16 << 20
Answered = tuple[bool, bool, str, str]
"""Correct without and with the booster, the object, and the picture."""
SHOWN_POSE = 1
"""Number of the plan's pose from which each booster is shown on its object."""
LOOK_STRIDE = 4
"""Step of the pixels by which a change of looks is measured."""


class Judge(BaseModel):
    """A network that judges.

    Attributes:
        sha256: of its weights' file.
        preprocessing: in words.
        seen: whether the entry was trained on it, by its record's hashes.
        tensors_sha256: of its numbers; None in older scores.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: str
    sha256: str
    preprocessing: str
    seen: bool
    tensors_sha256: str | None = None

    def is_seen_by(self, record: EntryRecord) -> bool:
        """Whether an entry names it as a network of its training."""
        # by the records alone, so that everybody counts the same
        return any(
            network.sha256 == self.sha256
            or (self.tensors_sha256 or "") in (network.tensors_sha256, KNOWN_TENSORS.get(network.sha256))
            for network in record.networks
        )


class JudgedPicture(BaseModel):
    """A line of `outcomes.csv`: the answer of a judge to a picture.

    Attributes:
        picture_sha256: of the file, before it was corrupted.
        correct: whether the top-1 answer is right.
        delta_e: mean CIEDE2000 from the unmodified object; None but for the booster's own clear pictures.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    judge_sha256: str
    object: str
    pose: int
    variant: str
    condition: str
    corruption: str
    severity: int
    picture_sha256: str
    correct: bool
    delta_e: float | None = None


class ScoreRow(BaseModel):
    """Answers of a judge to the same pictures without and with the booster.

    Attributes:
        judge: its name, or `unseen` or `seen` for all of these together.
        object: its name, or `all` for all objects together.
        bare: number of correct answers without the booster, and `boosted` with it, to `n` pictures.
        mcnemar_p: of the pairs; None for several judges, which are no independent draws.
        gain: difference of the accuracies, and `gain_ci95` its interval over objects, see `_estimate`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    judge: str
    condition: str
    object: str
    variant: str
    n: int
    bare: int
    boosted: int
    gained: int
    lost: int
    mcnemar_p: float | None
    gain: float
    gain_ci95: Interval | None


class Score(BaseModel):
    """`score.json`.

    Attributes:
        is_official: whether the judges are exactly those of the closed division, and all pictures were judged.
        outcomes_sha256: of `outcomes.csv`, from which all else is counted.
        rank_gain: mean gain over the three conditions on unseen judges; None without any.
        rank_ci95: its interval over objects; entries are ranked by the lower end.
        delta_e: mean change of looks.
        non_printability: mean of the boosters' colours, see `toolkit.imaging.printer.PrintScores`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    schema_version: int = 1
    kind: str = "challenge"
    challenge_version: int = VERSION
    entry: EntryRecord
    is_official: bool
    judges: tuple[Judge, ...]
    outcomes_sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    rank_gain: float | None
    rank_ci95: Interval | None
    rows: tuple[ScoreRow, ...]
    delta_e: float | None
    non_printability: float
    toolkit_version: str = __version__

    @property
    def unseen(self) -> list[ScoreRow]:
        """Rows of the unseen judges for all objects together, by condition and variant."""
        return [row for row in self.rows if (row.judge, row.object) == (UNSEEN, POOLED)]

    @property
    def pooled(self) -> list[ScoreRow]:
        """Return the rows of `unseen` for the booster's own variant."""
        return [row for row in self.unseen if row.variant == self.entry.variant]

    @property
    def class_of(self) -> tuple[object, ...]:
        """Properties that comparable scores share."""
        judged = tuple(sorted((judge.sha256, judge.preprocessing) for judge in self.judges))
        return self.challenge_version, self.entry.division, self.entry.budget, self.is_official, judged

    def may_replace(self, folder: Path) -> bool:
        """Whether a folder has no readable score, or a score of the same judges and variants."""
        try:
            there = read_json(folder / SCORE_FILE, Score)
        except ToolkitError:
            return True
        mine, theirs = ((score.class_of, {row.variant for row in score.rows}) for score in (self, there))
        return mine == theirs


@dataclass(frozen=True)
class Judged:
    """An entry, the folder of a score in it, and the score with what it is counted from."""

    entry: ChallengeEntry
    folder: Path
    score: Score
    outcomes: tuple[JudgedPicture, ...]


def describe_judge(record: EntryRecord, judge: Classifier) -> Judge:
    """Describe a judge, and whether the entry was trained on its weights."""
    named = Judge(
        name=judge.name, sha256=judge.weights.sha256, preprocessing=judge.preprocessing.describe(), seen=False,
        tensors_sha256=hash_network_tensors(judge),
    )  # fmt: skip
    return named.model_copy(update={"seen": named.is_seen_by(record)})


def write_score(
    entry: ChallengeEntry, judges: Sequence[Judge], outcomes: Sequence[JudgedPicture],
    pictures: Mapping[str, bytes] | None = None,
) -> Judged:  # fmt: skip
    """Count the judges' answers, and write the board's pictures (PNG by object), `outcomes.csv` and `score.json`.

    The folder is `score`, or `score-2`, … if that holds the score of other judges.

    Raises:
        ToolkitError: as `count_score`, or the disk is full.
    """
    # booleans are written as 0 and 1
    cells = ([int(value) if isinstance(value, bool) else value for _, value in outcome] for outcome in outcomes)
    text = encode_csv(list(JudgedPicture.model_fields), cells)
    # the score of the text as it is written; scores of other judges stay
    score = count_score(entry, judges, outcomes, sha256_bytes(text.encode()))
    folder = find_run_dir(entry.folder / SCORE, score.may_replace)
    for note in explain_run_dir(entry.folder / SCORE, folder):
        notice(note)
    # the score file comes last: where it is, all else is there
    for name, content in (pictures or {}).items():
        write_bytes(folder / PICTURES / f"{name}.png", content, entry.folder)
    write_text(folder / OUTCOMES, text, entry.folder)
    write_json(folder / SCORE_FILE, score.model_dump(mode="json"), entry.folder)
    return Judged(entry, folder, score, tuple(outcomes))


def count_score(
    entry: ChallengeEntry, judges: Sequence[Judge], outcomes: Sequence[JudgedPicture], sha256: str
) -> Score:
    """Count a score from its outcomes; a missing judge or half of a pair is a `ToolkitError`."""
    by_sha = {judge.sha256: judge for judge in judges}
    if unknown := next((outcome for outcome in outcomes if outcome.judge_sha256 not in by_sha), None):
        raise ToolkitError(f"{OUTCOMES}: a judge {unknown.judge_sha256[:12]} that {SCORE_FILE} does not name")
    # each judge alone, then all unseen and all seen judges together
    groups = {judge.name: [judge] for judge in judges}
    groups |= {name: [judge for judge in judges if judge.seen == (name == SEEN)] for name in (UNSEEN, SEEN)}
    table = _Table(outcomes)
    names = tuple(dict.fromkeys(outcome.object for outcome in outcomes))
    rows = [
        table.count(who, [judge.sha256 for judge in members], condition, variant, name)
        for who, members in groups.items() if members
        for condition in CONDITIONS
        for variant in table.variants(condition)
        for name in ((*names, POOLED) if variant == entry.record.variant else (POOLED,))
    ]  # fmt: skip
    # the rank counts unseen judges alone
    unseen = [judge.sha256 for judge in groups[UNSEEN]]
    gain, ci95 = table.rank(unseen, entry.record.variant) if unseen else (None, None)
    # how much the booster changes the picture, and how far its colours are from printable colours
    changes = {(outcome.object, outcome.pose): outcome.delta_e for outcome in outcomes if outcome.delta_e is not None}
    inks = [score_print(entry.read_booster(name).pixels).non_printability for name in entry.objects]
    # official: exactly the division's judges, by the digits of their hashes, and every pose of every object
    known = {judge.name: judge.sha256[: len(JUDGES.get(judge.name, ""))] for judge in judges}
    is_whole = set(table.pictures) == set(product(entry.objects, range(1, 2 * POSES + 1)))
    return Score(
        entry=entry.record, is_official=known == JUDGES and is_whole, judges=tuple(judges),
        outcomes_sha256=sha256, rank_gain=gain, rank_ci95=ci95, rows=tuple(rows),
        delta_e=round(float(np.mean(list(changes.values()))), 3) if changes else None,
        non_printability=round(float(np.mean(inks)), 5),
    )  # fmt: skip


class _Table:
    """Outcomes by judge, condition, object, pose and variant."""

    def __init__(self, outcomes: Sequence[JudgedPicture]) -> None:
        self.right = {
            (outcome.judge_sha256, outcome.condition, outcome.object, outcome.pose, outcome.variant): outcome.correct
            for outcome in outcomes
        }
        self.pictures = sorted({(outcome.object, outcome.pose) for outcome in outcomes})
        if len(self.right) < len(outcomes):
            raise ToolkitError(f"{OUTCOMES}: a judge has two answers for a picture: expected a single answer")

    def variants(self, condition: str) -> list[str]:
        """Variants in a condition, without `unpatched`."""
        return list(dict.fromkeys(key[4] for key in self.right if key[1] == condition and key[4] != UNPATCHED))

    def pairs(self, judges: Sequence[str], condition: str, variant: str, name: str) -> list[Answered]:
        """Answers of each judge to each picture, without and with the booster."""
        found = []
        for judge, (item, pose) in product(judges, self.pictures):
            if name in (item, POOLED):
                both = [self.right.get((judge, condition, item, pose, shown)) for shown in (UNPATCHED, variant)]
                if None in both:
                    expected = f"expected answers to {UNPATCHED} and {variant}"
                    raise ToolkitError(f"{OUTCOMES}: {item}, pose {pose}, {condition}: {expected}")
                found.append((bool(both[0]), bool(both[1]), item, f"{item} {pose}"))
        return found

    def count(self, who: str, judges: Sequence[str], condition: str, variant: str, name: str) -> ScoreRow:
        """One row of the score."""
        pairs = self.pairs(judges, condition, variant, name)
        found = PairedOutcomes.count((bare, boosted) for bare, boosted, *_ in pairs)
        gain, ci95 = _estimate(pairs)
        change = describe_change(found)
        if len(judges) > 1:
            change["mcnemar_p"] = None
        return ScoreRow(
            judge=who, condition=condition, object=name, variant=variant, n=found.n, bare=found.n_first,
            boosted=found.n_second, gain=gain, gain_ci95=ci95, **change,
        )  # fmt: skip

    def rank(self, judges: Sequence[str], variant: str) -> tuple[float, Interval | None]:
        """Mean gain over all conditions, which have as many pictures each."""
        return _estimate([pair for condition in CONDITIONS for pair in self.pairs(judges, condition, variant, POOLED)])


def _estimate(pairs: Sequence[Answered]) -> tuple[float, Interval | None]:
    """Mean gain and its interval over objects, or over pictures for a single object, or if all gain alike."""
    bare, boosted = (np.array([pair[k] for pair in pairs], float) for k in (0, 1))
    # clusters of the bootstrap: objects, else pictures
    for cluster in (2, 3):
        _, member = np.unique([pair[cluster] for pair in pairs], return_inverse=True)
        gain, ci95 = estimate_difference(boosted, bare, member)
        if ci95 is not None:
            return round(gain, 9), (round(ci95[0], 9), round(ci95[1], 9))
    return round(gain, 9), None


def build_score_table(score: Score) -> Table:
    """A line for each condition and variant, of all unseen and all seen judges."""
    shown = [row for row in score.rows if row.judge in (UNSEEN, SEEN) and row.object == POOLED]
    # the pooled rows: each object's own rows are in the file
    cells = [
        [
            row.judge, f"{row.condition} {FOG_SEVERITY}" if row.condition == FOG else row.condition, row.variant,
            str(row.n), format_percent(row.bare / row.n), format_percent(row.boosted / row.n), format_points(row.gain),
            format_points_interval(row.gain_ci95), str(row.gained), str(row.lost),
        ]
        for row in shown
    ]  # fmt: skip
    heads = ("n", "unmodified %", "boosted %", "points", "95 %", "gained", "lost")
    return build_table(
        f"{score.entry.name}, {len(score.judges)} judges", ("judges", "condition", "variant"), heads, cells
    )


def read_judged(folder: Path) -> Judged:
    """Read an entry with its score; `folder` is the entry's, or that of a score in it.

    Raises:
        ToolkitError: no entry, no score, or a damaged score.
    """
    # the folder of a score, or of an entry with a score
    name = Path(folder).name
    is_score = SCORE_FOLDER.fullmatch(name) is not None and not (Path(folder) / ENTRY).exists()
    entry = read_entry(Path(folder).parent if is_score else folder)
    place = entry.folder / (name if is_score else SCORE)
    files = [place / name for name in (SCORE_FILE, OUTCOMES)]
    for file in files:
        if not file.is_file() or file.is_symlink():
            raise ToolkitError(f"{file} is missing: 'toolkit challenge run {entry.folder}' makes it")
    return Judged(entry, place, read_json(files[0], Score), tuple(_read_outcomes(files[1])))


def _read_outcomes(file: Path) -> list[JudgedPicture]:
    text = read_bytes(file, MOST_OUTCOMES_BYTES).decode("utf-8", "replace")
    try:
        rows = csv.DictReader(io.StringIO(text, newline=""))
        cells = [{name: value or None if name == "delta_e" else value for name, value in row.items()} for row in rows]
        outcomes = TypeAdapter(list[JudgedPicture]).validate_python(cells)
    except (csv.Error, ValidationError) as error:
        why = explain_validation(error) if isinstance(error, ValidationError) else error
        raise ToolkitError(f"{file} is damaged ({why}): run the entry again") from None
    if not outcomes:
        raise ToolkitError(f"{file} holds no answer: run the entry again")
    return outcomes


def read_picture(judged: Judged, name: str) -> np.ndarray:
    """Read the picture (h, w, 3) uint8 sRGB of the booster on an object, with the hash in `outcomes.csv`."""
    file = inside(judged.entry.folder, f"{judged.folder.name}/{PICTURES}/{name}.png")
    content = read_bytes(file, MOST_PICTURE_BYTES)
    wanted = (name, SHOWN_POSE, judged.entry.record.variant)
    lines = (line for line in judged.outcomes if (line.object, line.pose, line.variant) == wanted)
    if {line.picture_sha256 for line in lines} != {sha256_bytes(content)}:
        raise ToolkitError(f"{file}: is not the picture that was judged: run the entry again")
    return decode_image(content, file)


def check_scores(folder: Path) -> list[str]:
    """List why scores of an entry cannot be read, a line each."""
    faults = []
    for place in list_score_folders(folder):
        if not any((place / name).exists() for name in (SCORE_FILE, OUTCOMES)):
            continue  # not finished yet
        try:
            judged = read_judged(place)
            for name in judged.entry.objects:
                read_picture(judged, name)
        except ToolkitError as error:
            faults.append(str(error))
    return faults


def rescore(folder: Path) -> list[str]:
    """List parts of a score that do not follow from its files, a line each; `folder` as in `read_judged`."""
    try:
        judged = read_judged(folder)
        # count again, also which judges are seen
        sha256 = sha256_file(judged.folder / OUTCOMES)
        record = judged.entry.record
        judges = [judge.model_copy(update={"seen": judge.is_seen_by(record)}) for judge in judged.score.judges]
        again = count_score(judged.entry, judges, judged.outcomes, sha256)
        for name in judged.entry.objects:
            read_picture(judged, name)
            judged.entry.check_hash(name)
    except ToolkitError as error:
        return [str(error)]
    # compared field by field
    said, found = (score.model_dump(mode="json", exclude={"toolkit_version"}) for score in (judged.score, again))
    return [
        f"{judged.folder.name}/{SCORE_FILE}: {name}: is not what {OUTCOMES} and {ENTRY} give: run the entry again"
        for name in found
        if said[name] != found[name]
    ]


def describe_rank(score: Score) -> dict[str, Any]:
    """Numbers of a score for a leaderboard, as JSON and CSV have them."""
    rows = {row.condition: row for row in score.pooled}
    return {
        "entry": score.entry.name, "authors": "; ".join(score.entry.authors), "link": score.entry.link,
        "division": score.entry.division, "budget": score.entry.budget, "is_official": score.is_official,
        "rank_gain": score.rank_gain, "rank_low": score.rank_ci95[0] if score.rank_ci95 else None,
        "rank_high": score.rank_ci95[1] if score.rank_ci95 else None,
        **{f"gain_{name}": rows[name].gain if name in rows else None for name in CONDITIONS},
        "delta_e": score.delta_e, "non_printability": score.non_printability,
        "networks": len(score.entry.networks), "unseen_judges": sum(not judge.seen for judge in score.judges),
    }  # fmt: skip


def run_entry(
    entry: ChallengeEntry, judges: Sequence[Classifier], workspace: Workspace, engine: Engine | None = None,
    *, with_controls: bool = True,
) -> Judged:  # fmt: skip
    """Render an entry, ask the judges, and write `score/` in its folder, see `write_score`.

    Pictures and answers are kept in `eval/challenge/` of the workspace. Interrupted runs resume, and pictures without
    boosters serve all entries.

    Raises:
        ToolkitError: the entry breaks a rule, no judges, two of the same weights, or the disk is full.
    """
    faults = check_entry(entry.folder)
    if faults:
        more = f" (and {len(faults) - 1} more: 'toolkit challenge check {entry.folder}')" if len(faults) > 1 else ""
        raise ToolkitError(f"{entry.folder}: {faults[0]}{more}")
    # two networks of the same weights would count twice
    if len({judge.weights.sha256 for judge in judges}) < max(1, len(judges)):
        raise FieldError("expected networks, each once", {"judge": [judge.name for judge in judges]})
    home = workspace.eval_dir / "challenge"
    # each judge answers the same captures; the entry's own are compared with the unmodified object
    captures = _shoot(entry, home, engine, with_controls)
    looks = dict(_measure_looks(entry, captures, home))
    outcomes: list[JudgedPicture] = []
    for judge in judges:
        notice(f"{judge.name} judges")
        outcomes += _ask(entry, judge, captures, home, looks)
    # the board shows a picture of each object
    own = [capture for capture in captures if (capture.variant, capture.pose_id) == (entry.record.variant, SHOWN_POSE)]
    pictures = {capture.object: capture.file.read_bytes() for capture in own}
    return write_score(entry, [describe_judge(entry.record, judge) for judge in judges], outcomes, pictures)


def _shoot(entry: ChallengeEntry, home: Path, engine: Engine | None, with_controls: bool) -> list[Capture]:
    """Shoot the pictures of an entry; equal pictures of other entries are copied: without a booster, and controls."""
    space = open_space(entry, home / entry.record.name)
    # of a single object no patch is of another class
    left_out = {*NO_CONTROLS, *(["wrong-patch"] if len(entry.objects) < 2 else [])}
    controls = [name for name in CONTROLS_OF.get(entry.record.variant, ()) if with_controls and name not in left_out]
    variants = (UNPATCHED, entry.record.variant, *controls)
    # images of all entries serve as a store
    sources = sorted(home.glob(f"*/{space.captures_dir.name}/sim"))
    stored = {key: image for source in sources for key, image in index_images(source).items()}
    settings, plan = ShootSettings(image_format="png"), read_plan(space.plan_file)
    done = shoot_plan(space, plan, entry.objects, variants, settings, stored=stored, engine=engine)
    if done.failed:
        raise ToolkitError(f"{done.failed[0][0]}: {done.failed[0][1]}: a score needs all pictures: run it again")
    wanted = {f"{name}/{variant}" for name in entry.objects for variant in variants}
    found = read_captures(done.source_dir).captures
    return [capture for capture in found if capture.path_in_source.rpartition("/")[0] in wanted]


def _measure_looks(
    entry: ChallengeEntry, captures: Sequence[Capture], home: Path
) -> Iterator[tuple[tuple[str, int], float]]:
    """Mean CIEDE2000 between the pictures without and with the booster, by object and pose."""
    space_root = home / entry.record.name
    plan = read_plan(space_root / "rig" / "plan.json")
    # the pair of each pose, with and without the booster
    by_key = {(capture.object, capture.variant, capture.pose_id): capture for capture in captures}
    for name in entry.objects:
        # only the object is compared, not the table and room around it
        scene = make_ray_scene(load_object(Workspace(space_root).object_spec(name)).mesh)
        camera = plan.camera
        # pixels whose rays meet the object
        x, y = np.meshgrid(*(np.arange(0, side, LOOK_STRIDE) for side in (camera.width, camera.height)))
        pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
        for pose in plan.objects[name]:
            rays = pixel_rays(camera, pose.matrix(), (pixels + 0.5).astype(np.float32))
            own = pixels[np.isfinite(cast_rays(scene, rays))]
            pair = (by_key[name, variant, pose.id] for variant in (UNPATCHED, entry.record.variant))
            bare, boosted = (read_image(capture.file)[own[:, 1], own[:, 0]] / 255 for capture in pair)
            change = delta_e2000(*(lab_of_linear(srgb_to_linear(colours)) for colours in (bare, boosted)))
            yield (name, pose.id), round(float(change.mean()), 4)


def choose_corruptions(pictures: Iterable[tuple[str, int]]) -> dict[tuple[str, int], tuple[str, int]]:
    """One of the 75 corruptions for each (object, pose), each about as often; the version draws their order."""
    every = list(product(COMMON, SEVERITIES))
    order = np.random.default_rng(DRAWN_SEED).permutation(len(every))
    return {key: every[order[k % len(every)]] for k, key in enumerate(sorted(set(pictures)))}


def _ask(
    entry: ChallengeEntry, judge: Classifier, captures: Sequence[Capture], home: Path,
    looks: Mapping[tuple[str, int], float],
) -> Iterator[JudgedPicture]:  # fmt: skip
    space = Workspace(home / entry.record.name)
    # the judge's own class of each object
    classes = find_true_classes(read_captures(space.captures_dir), space, judge)
    chosen = choose_corruptions((capture.object, capture.pose_id or 0) for capture in captures)
    paired = [capture for capture in captures if capture.variant in (UNPATCHED, entry.record.variant)]
    # clear: all variants with the controls; in fog and corrupted: only the pairs
    asked: list[tuple[str, Capture]] = [(CLEAR, capture) for capture in captures]
    asked += [(FOG, replace(capture, corruption=(FOG, FOG_SEVERITY))) for capture in paired]
    drawn = [chosen[capture.object, capture.pose_id or 0] for capture in paired]
    # a corruption drawn for each object and pose, the same with and without the booster
    asked += [(CORRUPTED, replace(capture, corruption=own)) for capture, own in zip(paired, drawn, strict=True)]
    said, _ = predict_once([capture for _, capture in asked], classes, judge, home / "answers.jsonl")
    # answers are for the very bytes of an image
    hashes = {capture.path: sha256_file(capture.file) for capture in captures}
    for (condition, capture), answer in zip(asked, said, strict=True):
        corruption, severity = capture.corruption or ("", 0)
        # how much the booster changes the look: stated once, with the entry's own clear images
        is_own = condition == CLEAR and capture.variant == entry.record.variant
        yield JudgedPicture(
            judge_sha256=judge.weights.sha256, object=capture.object, pose=capture.pose_id or 0,
            variant=capture.variant, condition=condition, corruption=corruption, severity=severity,
            picture_sha256=hashes[capture.path], correct=answer.correct_top1,
            delta_e=looks[capture.object, capture.pose_id or 0] if is_own else None,
        )  # fmt: skip
