"""Findings of an evaluation, the networks that boosters were trained on, and `summary.json`."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from toolkit import __version__
from toolkit.captures.capture import Capture
from toolkit.captures.read import POOLED
from toolkit.core.child import without_collector
from toolkit.core.text import join_words
from toolkit.core.workspace import Workspace
from toolkit.evaluation.agreement import RendererAgreement, compare_renderers, write_agreement
from toolkit.evaluation.ground_truth import describe_both
from toolkit.evaluation.metrics import (
    WRONG,
    Comparison,
    FlipList,
    Group,
    compare_controls,
    compare_unpatched,
    count_no_pairs,
    explain_unpaired,
    group_predictions,
    index_poses,
    list_flips,
    pair_with_unpatched,
)
from toolkit.evaluation.origin import Origin
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.sim_real import SimReal, compare_sim_real, explain_apart, write_sim_real
from toolkit.evaluation.summaries import Kind, begin_summary, list_reasons
from toolkit.evaluation.verdict import Verdict, write_headlines
from toolkit.models.identity import is_same_network
from toolkit.models.labels import plain_name
from toolkit.models.network import Classifier
from toolkit.objects.records import NetworkRecord
from toolkit.rig.applied.kinds import KINDS

MOST_NAMED = 3


@dataclass(frozen=True)
class Training:
    """Training of a booster on an object.

    Attributes:
        booster, booster_sha256: name and hash of the patch, texture or wrap, as in the manifest.
        seen: whether the evaluated network is among them, by the hash of its file or of its weights.
        class_name: class of the training, in the labels of these networks.
    """

    source: str
    object: str
    variant: str
    booster: str
    booster_sha256: str
    networks: tuple[NetworkRecord, ...]
    seen: bool
    class_name: str = ""

    def as_json(self) -> dict[str, Any]:
        """Return the fields of `summary.json`."""
        return vars(self) | {"networks": [network.model_dump() for network in self.networks]}


def find_training(
    captures: Sequence[Capture], workspace: Workspace, weights_sha256: str, tensors_sha256: str | None = None
) -> tuple[Training, ...]:
    """Return the training of every booster in the manifests that has a record in the workspace.

    Args:
        weights_sha256: hash of the evaluated network's file.
        tensors_sha256: hash of its weights, see `toolkit.models.identity`; None if it is not known.
    """
    # each booster once, whatever the number of its images
    worn = dict.fromkeys(
        (capture.source, capture.object, capture.variant, capture.booster_sha256)
        for capture in captures
        if capture.booster_sha256
    )
    if not worn:
        return ()
    stored = [training for kind in KINDS if kind.list_trainings for training in kind.list_trainings(workspace)]
    records = {training.sha256: training for training in stored}
    found = []
    for source, name, variant, sha256 in worn:
        if sha256 is not None and sha256 in records:
            _, booster, label, networks = records[sha256]
            own = workspace.classifiers_dir
            seen = any(is_same_network(network, weights_sha256, tensors_sha256, own) for network in networks)
            found.append(Training(source, name, variant, booster, sha256, tuple(networks), seen, label))
    return tuple(found)


def describe_other_classes(training: Sequence[Training], true_labels: Mapping[str, str]) -> list[str]:
    """Return a line for each booster that was trained for another class than the object's true label.

    An index in a spec means another class in another list of labels.
    """
    lines = []
    for booster in training:
        label = true_labels.get(booster.object, "")
        # a control with the patch of another class is meant to be wrong
        are_known = label and booster.class_name and booster.variant != WRONG
        if are_known and plain_name(label) != plain_name(booster.class_name):
            lines.append(
                f"{booster.source}: {booster.variant} ({booster.object}) was trained for '{booster.class_name}', and "
                f"is judged as '{label}'"
            )
    return lines


def mark_seen(training: Sequence[Training], source: str, name: str, variant: str) -> str:
    """Return `yes`, `no` or `partly` for a row of the table; empty if the training is not known."""
    asked = {
        booster.seen for booster in training
        if (booster.source, booster.variant) == (source, variant) and name in (booster.object, POOLED)
    }  # fmt: skip
    return "" if not asked else "partly" if len(asked) == 2 else "yes" if asked == {True} else "no"


def describe_unseen(network: str, training: Sequence[Training]) -> list[str]:
    """Return a line for each source and variant whose boosters were not trained on the network."""
    lines = []
    for source, variant in dict.fromkeys((booster.source, booster.variant) for booster in training if not booster.seen):
        key = (source, variant, False)
        some = [booster for booster in training if (booster.source, booster.variant, booster.seen) == key]
        names = dict.fromkeys(booster.object for booster in some)
        archs = dict.fromkeys(trained.arch for booster in some for trained in booster.networks)
        whose = ", ".join(names) if len(names) <= MOST_NAMED else f"{len(names)} objects"
        # networks of the same name with other weights are told apart
        on = join_words(archs) or "no network"
        if network in archs:
            on += " with other weights"
        lines.append(f"{source}: {variant} ({whose}) was trained on {on}; {network} was not seen in training")
    return lines


@dataclass(frozen=True)
class Findings:
    """Predictions and their statistics.

    Attributes:
        groups: accuracy by source, object and variant.
        pairs: each variant against `unpatched`.
        comparisons: boosters against their controls and each other.
        failed: (path, reason) of images and folders that could not be read.
        no_pairs: reasons why pairs were not formed, with counts.
        sim_real: rendered sources against photographs of the same poses.
        renderers: plans that several renderers shot.
        passed: findings without the photographs that failed a gate; None if none failed.
        training: training of the boosters with a record.
        origin: origin of the result; None if it was not read from captures.
    """

    predictions: tuple[Prediction, ...]
    groups: tuple[Group, ...]
    pairs: tuple[Comparison, ...]
    comparisons: tuple[Comparison, ...]
    headlines: tuple[Verdict, ...]
    flips: tuple[FlipList, FlipList]
    failed: tuple[tuple[str, str], ...]
    unpaired: tuple[tuple[str, str], ...]
    no_pairs: tuple[tuple[str, int], ...]
    sim_real: tuple[SimReal, ...]
    passed: "Findings | None"
    renderers: tuple[RendererAgreement, ...] = field(default=(), kw_only=True)
    training: tuple[Training, ...] = field(default=(), kw_only=True)
    origin: Origin | None = field(default=None, kw_only=True)

    @property
    def gated(self) -> list[Prediction]:
        """Predictions of photographs that failed a gate."""
        return [prediction for prediction in self.predictions if prediction.capture.failed_gates]

    @property
    def gate_lines(self) -> list[str]:
        """Effect of the failed photographs in words, for each source and variant."""
        counts = Counter(photo.capture.source for photo in self.gated)
        return describe_both(self.pairs, self.passed.pairs if self.passed else (), counts)


@without_collector()
def compare_predictions(
    network: str, predictions: Sequence[Prediction], refused_folders: Sequence[tuple[str, str]] = ()
) -> Findings:
    """Count, pair and test predictions, and describe the result of the network of that name."""
    poses = index_poses(predictions)
    groups, paired = group_predictions(predictions), pair_with_unpatched(poses)
    pairs, comparisons = compare_unpatched(paired), compare_controls(poses)
    # rendered sources and photographs of the same poses, if there are both
    sim_real = compare_sim_real(predictions)
    renderers = compare_renderers(predictions)
    headlines = write_headlines(network, groups, [*pairs, *comparisons]) + write_sim_real(network, sim_real)
    headlines += [verdict for agreement in renderers for verdict in write_agreement(network, agreement)]
    good = [prediction for prediction in predictions if not prediction.capture.failed_gates]
    unread = [(prediction.capture.path, prediction.status) for prediction in predictions if not prediction.is_read]
    return Findings(
        tuple(predictions), groups=tuple(groups), pairs=tuple(pairs), comparisons=tuple(comparisons),
        headlines=tuple(headlines), flips=list_flips(paired), failed=(*unread, *refused_folders),
        unpaired=(*explain_unpaired(predictions, poses, paired), *explain_apart(predictions)),
        no_pairs=tuple(count_no_pairs(poses)), sim_real=tuple(sim_real), renderers=tuple(renderers),
        # once more without the photographs that failed a gate
        passed=compare_predictions(network, good, refused_folders) if 0 < len(good) < len(predictions) else None,
    )  # fmt: skip


def summarise(classifier: Classifier, findings: Findings, notes: Sequence[str], kind: Kind = "eval") -> dict[str, Any]:
    """Return the content of `summary.json` of an evaluation or a sweep.

    - `rests_on`: see `toolkit.evaluation.origin.Origin`.
    - `controls`: `comparisons` of boosters with their controls, and of patch and texture, by object and pooled; and
      `answers` {source, question, tone, verdict, sentence}.
    - `boosters`: see `Training`.
    - `corrupted`: sources of corrupted images {source, corruption, severity}.
    - `sim_real`: for each pair of rendered source and photographs of the same poses, `rows` by object and variant (gap,
      interval, test, rank correlation), `gains` (poses that a booster gains), `wrong` (poses that the rig predicted
      wrongly) and images without a match.
    - `renderers`: for each plan that several renderers shot, `gains` (pairs of each renderer), `pairs` (of every two
      renderers: equal answers, Cohen's kappa, difference of colours) and `flips` (images that are correct in some
      renderers only).
    - `gates`: photographs that failed a gate, and groups and pairs without them.
    """
    # without photographs that failed a gate
    passed = findings.passed
    failed_gates = [{"path": item.capture.path, "gates": list(item.capture.failed_gates)} for item in findings.gated]
    return {
        **begin_summary(kind, classifier),
        "rests_on": findings.origin and findings.origin.as_json(),
        "groups": [group.as_json() for group in findings.groups],
        "pairs": [pair.as_pair() for pair in findings.pairs],
        "controls": {
            "comparisons": [row.as_json() for row in findings.comparisons],
            "answers": [headline.as_json() for headline in findings.headlines if headline.question],
        },
        "boosters": [booster.as_json() for booster in findings.training],
        "corrupted": list_corrupted(prediction.capture for prediction in findings.predictions),
        "sim_real": [comparison.as_json() for comparison in findings.sim_real],
        "renderers": [agreement.as_json() for agreement in findings.renderers],
        "gates": {
            "failed": failed_gates,
            "groups_without": [group.as_json() for group in passed.groups] if passed else [],
            "pairs_without": [pair.as_pair() for pair in passed.pairs] if passed else [],
        },
        "failed": list_reasons(findings.failed),
        "unpaired": list_reasons(findings.unpaired),
        "notes": list(notes),
        "toolkit_version": __version__,
    }


def list_corrupted(captures: Iterable[Capture]) -> list[dict[str, str | int]]:
    """Return source, corruption and severity of each corrupted source, sorted, as in `summary.json`."""
    found = sorted({(capture.source, *capture.corruption) for capture in captures if capture.corruption is not None})
    return [{"source": source, "corruption": name, "severity": severity} for source, name, severity in found]
