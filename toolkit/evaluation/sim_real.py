"""Compare the rig with photographs, pose by pose: the gap in accuracy, and the ranks of the poses."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePosixPath
from typing import Any

from toolkit.captures.capture import UNPATCHED
from toolkit.captures.read import POOLED
from toolkit.core.statistics import SIGNIFICANT, PairedOutcomes, wilson_interval
from toolkit.core.tables import (
    format_count,
    format_kappa,
    format_points,
    format_points_interval,
    format_rank,
    format_test,
)
from toolkit.evaluation.metrics import OWNERS, Comparison, Pair, gather, name_booster, rank_row, rank_variant
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.summaries import list_reasons
from toolkit.evaluation.verdict import Verdict

Reasons = tuple[tuple[str, str], ...]
"""(path, reason) of each image."""
Key = tuple[str, str, int]
"""Object, variant and pose."""
Poses = dict[Key, list[Prediction]]
ELSEWHERE = "has its camera elsewhere"
LIKE = "sim-like-"
"""Start of names of sources with the cameras of photographs."""


@dataclass(frozen=True)
class GainForecast:
    """Whether the rig predicts the poses that a booster gains, over poses with all four images.

    Attributes:
        outcomes: whether a pose is gained: first in the rig, second in photographs.
        sim_lost, real_lost: number of poses that are lost.
    """

    object: str
    variant: str
    outcomes: PairedOutcomes
    sim_lost: int
    real_lost: int

    @property
    def sim_gain(self) -> float:
        """Change of accuracy in the rig."""
        return (self.outcomes.n_first - self.sim_lost) / self.outcomes.n

    @property
    def real_gain(self) -> float:
        """Change of accuracy in photographs."""
        return (self.outcomes.n_second - self.real_lost) / self.outcomes.n

    def as_json(self) -> dict[str, Any]:
        """Return the fields of `summary.json`."""
        found = self.outcomes
        return {
            "object": self.object, "variant": self.variant, "n": found.n, "both": found.both,
            "sim_only": found.only_first, "real_only": found.only_second, "neither": found.neither,
            "sim_lost": self.sim_lost, "real_lost": self.real_lost, "sim_gain": self.sim_gain,
            "real_gain": self.real_gain, "kappa": found.kappa, "agreement": (found.both + found.neither) / found.n,
        }  # fmt: skip


@dataclass(frozen=True)
class SimReal:
    """A rendered source against a source of photographs.

    Attributes:
        pairs: images of the same object, variant and pose: first the rig's, second the photograph.
    """

    sim: str
    real: str
    pairs: tuple[Pair, ...]
    unmatched_sim: Reasons
    unmatched_real: Reasons

    @cached_property
    def rows(self) -> tuple[Comparison, ...]:
        """Comparisons by object (`all` last) and variant: first the rig, second the photograph."""
        members = gather(self.pairs, lambda pair: [(name, place_of(pair)[1]) for name in (place_of(pair)[0], POOLED)])
        order = sorted(members, key=lambda key: rank_row(self.real, *key))
        return tuple(Comparison(self.real, *key, key[1], tuple(members[key])) for key in order)

    @cached_property
    def forecasts(self) -> tuple[GainForecast, ...]:
        """Forecasts by object (`all` last) and variant, without `unpatched`."""
        first: dict[tuple[str, str, int | None], Pair] = {}
        for pair in self.pairs:
            first.setdefault(place_of(pair), pair)
        # before and after in the rig, and before and after in photographs, each with the same camera
        both = []
        for (name, variant, pose_id), after in first.items():
            before = first.get((name, UNPATCHED, pose_id)) if variant != UNPATCHED else None
            if before is not None:
                sim, real = Pair(before.first, after.first), Pair(before.second, after.second)
                if sim.has_one_camera and real.has_one_camera:
                    both.append((sim, real))
        # gains in the rig and in photographs, pose by pose, by object and pooled
        members = gather(both, lambda pair: [(name, place_of(pair[1])[1]) for name in (place_of(pair[1])[0], POOLED)])
        forecasts = []
        for key in sorted(members, key=lambda key: rank_row("", *key)):
            gained = PairedOutcomes.count((sim.is_gained, real.is_gained) for sim, real in members[key])
            lost = [sum(pair.is_lost for pair in pairs) for pairs in zip(*members[key], strict=True)]
            forecasts.append(GainForecast(*key, gained, *lost))
        return tuple(forecasts)

    @cached_property
    def wrong(self) -> tuple[Pair, ...]:
        """Pairs with a single correct image: the rig predicted these poses wrongly."""
        return tuple(pair for pair in self.pairs if pair.is_gained or pair.is_lost)

    def as_json(self) -> dict[str, Any]:
        """Return an entry of `sim_real` in `summary.json`."""
        return {
            "sim": self.sim, "real": self.real, "n": len(self.pairs),
            "rows": [_describe_gap(row) for row in self.rows],
            "gains": [forecast.as_json() for forecast in self.forecasts],
            "wrong": [_pair_json(pair) for pair in self.wrong],
            "unmatched_sim": list_reasons(self.unmatched_sim),
            "unmatched_real": list_reasons(self.unmatched_real),
        }  # fmt: skip


def place_of(pair: Pair) -> tuple[str, str, int | None]:
    """Return object, variant and pose of a pair."""
    return pair.second.capture.object, pair.second.capture.variant, pair.second.capture.pose_id


def _describe_gap(row: Comparison) -> dict[str, Any]:
    found, rank = row.outcomes, row.rank
    return {
        "object": row.object, "variant": row.second, "n": found.n,
        "sim_top1": found.n_first / found.n, "sim_top1_ci95": list(wilson_interval(found.n_first, found.n)),
        "real_top1": found.n_second / found.n, "real_top1_ci95": list(wilson_interval(found.n_second, found.n)),
        "both": found.both, "sim_only": found.only_first, "real_only": found.only_second, "gap": found.gain,
        "gap_ci95": list(found.gain_ci95), "mcnemar_p": found.mcnemar_p, "rank_correlation": rank.rho,
        "rank_correlation_ci95": list(rank.ci95) if rank.ci95 else None, "rank_correlation_note": rank.why or None,
    }  # fmt: skip


def _pair_json(pair: Pair) -> dict[str, Any]:
    name, variant, pose_id = place_of(pair)
    fields: dict[str, Any] = {"object": name, "variant": variant, "pose_id": pose_id}
    for key, prediction in (("sim", pair.first), ("real", pair.second)):
        fields |= {
            f"{key}_path": prediction.capture.path, f"{key}_right": prediction.correct_top1,
            f"{key}_says": prediction.top1_label, f"{key}_true_prob": prediction.true_prob,
        }  # fmt: skip
    return fields


def compare_sim_real(predictions: Sequence[Prediction]) -> list[SimReal]:
    """Compare every rendered source with every source of photographs that shares objects, variants and poses.

    A source is rendered by its manifest, or if its name is `sim` or starts with `sim-`. A source with the cameras of
    photographs (`sim-like-real`) is compared only with these photographs. Sources must have the same corruption. See
    `pair_sources`.
    """
    return [match for match in _match_sources(predictions) if match.pairs]


def explain_apart(predictions: Sequence[Prediction]) -> Reasons:
    """Return photographs without a comparison because the rig's cameras are elsewhere at the same poses."""
    found = _match_sources(predictions)
    compared = {match.real for match in found if match.pairs}
    alone = [reason for match in found if match.real not in compared for reason in match.unmatched_real]
    return tuple((path, reason) for path, reason in alone if ELSEWHERE in reason)


def _match_sources(predictions: Sequence[Prediction]) -> list[SimReal]:
    """Match every rendered source with every source of photographs that shares a pose, even without a pair."""
    by_source: dict[str, list[Prediction]] = defaultdict(list)
    for prediction in predictions:
        by_source[prediction.capture.source].append(prediction)
    rendered = [
        name for name, members in by_source.items()
        if f"{name}-".startswith("sim-") or any(prediction.capture.is_rendered for prediction in members)
    ]  # fmt: skip
    if len(rendered) in (0, len(by_source)):  # only renders, or only photographs
        return []
    rank = {name: at for at, name in enumerate(rendered)}
    # by pose, and by the photographs with the same cameras: sources without a common pose are never compared
    showing: dict[tuple[str | None, object, Key], list[str]] = defaultdict(list)
    for sim in rendered:
        # renders that were made for photographs are compared with these alone
        shot_for = sim.removeprefix(LIKE) if sim.startswith(LIKE) else None
        for key in _index_images(by_source[sim]):
            showing[shot_for, by_source[sim][0].capture.corruption, key].append(sim)
    made = []
    for real, members in by_source.items():
        if real in rank:
            continue
        # renders of a plan, and renders for these very photographs
        places = [(own, members[0].capture.corruption, key) for key in _index_images(members) for own in (None, real)]
        beside = {sim for place in places for sim in showing.get(place, ())}
        made += [
            SimReal(sim, real, *pair_sources(by_source[sim], members)) for sim in sorted(beside, key=rank.__getitem__)
        ]
    return made


def pair_sources(sims: Sequence[Prediction], reals: Sequence[Prediction]) -> tuple[tuple[Pair, ...], Reasons, Reasons]:
    """Pair the images of two sources by object, variant and pose.

    Images with different boosters or cameras, by their manifests, are no pair. If a pose has several
    images, images of the same name are paired, each once, else the first that fit.

    Returns:
        The pairs by object, variant and pose; and the readable images of either source that are in no pair.
    """
    sim_poses, real_poses = _index_images(sims), _index_images(reals)
    pairs: list[Pair] = []
    for key in sorted(sim_poses.keys() & real_poses.keys(), key=lambda key: (key[0], rank_variant(key[1]), key[2])):
        # images of the same pose that may be compared: same booster, same camera
        fitting = [Pair(first, other) for first in sim_poses[key] for other in real_poses[key] if _fits(first, other)]
        pairs += _pair_by_name(fitting) or fitting[:1]
    used = {id(prediction) for pair in pairs for prediction in (pair.first, pair.second)}
    return tuple(pairs), _explain(sims, used, reals, real_poses), _explain(reals, used, sims, sim_poses)


def _index_images(members: Iterable[Prediction]) -> Poses:
    poses: Poses = defaultdict(list)
    for prediction in members:
        capture = prediction.capture
        if prediction.is_read and capture.pose_id is not None:
            poses[(capture.object, capture.variant, capture.pose_id)].append(prediction)
    return poses


def _same_booster(first: Prediction, other: Prediction) -> bool:
    # a photograph without a hash in its manifest may have either booster
    known = {first.capture.booster_sha256, other.capture.booster_sha256} - {None}
    return len(known) < 2


def _fits(first: Prediction, other: Prediction) -> bool:
    return _same_booster(first, other) and Pair(first, other).has_one_camera


def _pair_by_name(candidates: Iterable[Pair]) -> list[Pair]:
    """Return the pairs with matching file names, each image once."""
    taken: set[int] = set()
    chosen = []
    # pose_01.heic.jpg belongs to pose_01.heic, even if there is a pose_01.jpg
    for kind in ("name", "stem"):
        for pair in candidates:
            sim, real = PurePosixPath(pair.first.capture.path), PurePosixPath(pair.second.capture.path)
            ids = {id(pair.first), id(pair.second)}
            if sim.stem == getattr(real, kind) and not ids & taken:
                taken |= ids
                chosen.append(pair)
    return chosen


def _explain(members: Sequence[Prediction], used: set[int], others: Sequence[Prediction], poses: Poses) -> Reasons:
    """Return the readable images of a source that are in no pair."""
    other, left = others[0].capture.source if others else "the other", []
    for prediction in members:
        capture = prediction.capture
        if id(prediction) in used or not prediction.is_read:
            continue
        if capture.pose_id is None:
            left.append((capture.path, "no pose number in its name"))
            continue
        # the most specific reason wins: no image, another booster, another camera
        partners = poses.get((capture.object, capture.variant, capture.pose_id), [])
        reason = f"another image of pose {capture.pose_id} is compared"
        if not partners:
            reason = f"{other} has no image of {capture.object}, {capture.variant}, pose {capture.pose_id}"
        elif not any(_same_booster(prediction, partner) for partner in partners):
            reason = f"{other} has another patch or texture there, by the manifests' SHA-256"
        elif not any(_fits(prediction, partner) for partner in partners):
            gap = next(filter(None, (capture.compare_cameras(partner.capture) for partner in partners)))
            reason = f"{other} {ELSEWHERE} ({gap}): render the photographs' own cameras with capture-sim --like"
        left.append((capture.path, reason))
    return tuple(left)


def write_sim_real(network: str, comparisons: Sequence[SimReal]) -> list[Verdict]:
    """Return a headline for each rendered source against photographs: of its first booster, else of `unpatched`."""
    return [_judge_rig(network, matched) for matched in comparisons]


def _judge_rig(network: str, matched: SimReal) -> Verdict:
    rows = {row.second: row for row in matched.rows if row.object == POOLED}
    # the booster's row decides, if it was shot; else the unmodified object's
    row = rows[next((name for name in rows if name != UNPATCHED and name not in OWNERS), next(iter(rows)))]
    found = row.outcomes
    # the interval's lower end: only a significant correlation counts
    low_rank = row.rank.ci95[0] if row.rank.ci95 else 0.0
    if found.mcnemar_p < SIGNIFICANT:
        tone, verdict = "bad", "The rig promises too " + ("much" if found.gain < 0 else "little")
    elif low_rank > 0:
        tone, verdict = "good", "The rig ranks the poses as the photographs do, and no gap is shown"
    else:
        tone, verdict = "open", "Too few pairs to tell whether rig and photographs differ"
    if found.mcnemar_p < SIGNIFICANT and low_rank > 0:
        tone, verdict = "open", f"{verdict}, but ranks the poses as the photographs do"
    what = "without a booster" if row.second == UNPATCHED else f"with {name_booster(row.second)}"
    # gap, test and ranks in words
    sentence = (
        f"On {found.n} poses {what} {network} is correct on {format_count(found.n_first, found.n)} in {matched.sim} "
        f"and on {format_count(found.n_second, found.n)} in {matched.real}: a gap of {format_points(found.gain)} "
        f"points (95 % interval {format_points_interval(found.gain_ci95)}, {format_test(found.mcnemar_p)}). Predicted "
        f"wrongly: {found.only_first + found.only_second} of {found.n}. Rank correlation over poses of the true "
        f"class's probability: {format_rank(row.rank)}."
    )
    forecast = next((own for own in matched.forecasts if (own.object, own.variant) == (POOLED, row.second)), None)
    if forecast is not None:
        sentence += f" {_describe_forecast(forecast)}"
    return Verdict(tone, sentence, verdict, f"{matched.sim} and {matched.real}", row.second)


def _describe_forecast(forecast: GainForecast) -> str:
    found = forecast.outcomes
    kappa = "" if found.kappa is None else f" (Cohen's kappa {format_kappa(found.kappa)})"
    # poses gained in the rig (`first`), which predicts, and in photographs (`second`)
    if found.n_second:
        wrong = f"; it predicted {found.only_first} more that were not gained" if found.only_first else ""
        gained = f"The rig predicted {found.both} of the {found.n_second} poses gained in the photographs{wrong}"
    else:
        gained = f"No pose was gained in the photographs, and the rig predicted {found.only_first or 'none'}"
    return (
        f"{name_booster(forecast.variant).capitalize()} adds {format_points(forecast.sim_gain)} points in the rig and "
        f"{format_points(forecast.real_gain)} in photographs. {gained}{kappa}."
    )
