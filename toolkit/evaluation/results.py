"""Everything that follows from the predictions, whether boosters met the network that judges, and `summary.json`."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from toolkit import __version__
from toolkit.captures.capture import Capture
from toolkit.captures.read import POOLED
from toolkit.core.child import without_collector
from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json
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
)
from toolkit.evaluation.origin import Origin
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.sim_real import SimReal, compare_sim_real, explain_apart, write_sim_real
from toolkit.evaluation.summaries import Kind, begin_summary, list_reasons
from toolkit.evaluation.verdict import Verdict, write_headlines
from toolkit.models.identity import is_same_network
from toolkit.models.labels import plain_name
from toolkit.models.network import Classifier
from toolkit.objects.records import BoosterRecord, NetworkRecord, PatchRecord, TextureRecord
from toolkit.objects.wrap import RECORD_FILE, WrapRecord, hash_wrap

MOST_NAMED = 3


@dataclass(frozen=True)
class Training:
    """What is known of the training of what an object wears.

    Attributes:
        source, object, variant: the images that it is on.
        booster, booster_sha256: the name and the hash of the patch, texture or wrap, as a manifest has it.
        networks: that it was trained on.
        seen: whether the network that judges is among them, by its file's hash or that of its numbers.
        class_name: that it was trained for, in the labels of these networks.
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
        """The fields of `summary.json`."""
        return vars(self) | {"networks": [network.model_dump() for network in self.networks]}


def find_training(
    captures: Sequence[Capture], workspace: Workspace, weights_sha256: str, tensors_sha256: str | None = None
) -> tuple[Training, ...]:
    """The training of every booster that the manifests name and a record of the workspace describes.

    Args:
        captures: images; those without a manifest, and noise and grey as boosters, have no part in it.
        workspace: whose patches, sets of patches and textures are looked through, the package's own among them.
        weights_sha256: of the file of the network that judges.
        tensors_sha256: of its numbers, see `toolkit.models.identity`; None where they are not known.
    """
    worn = dict.fromkeys(
        (capture.source, capture.object, capture.variant, capture.booster_sha256)
        for capture in captures
        if capture.booster_sha256
    )
    if not worn:
        return ()
    records = {sha256: (booster, label, networks) for sha256, booster, label, networks in _read_records(workspace)}
    found = []
    for source, name, variant, sha256 in worn:
        if sha256 is not None and sha256 in records:
            booster, label, networks = records[sha256]
            seen = any(
                is_same_network(network, weights_sha256, tensors_sha256, workspace.classifiers_dir)
                for network in networks
            )
            found.append(Training(source, name, variant, booster, sha256, tuple(networks), seen, label))
    return tuple(found)


def describe_other_classes(training: Sequence[Training], true_labels: Mapping[str, str]) -> list[str]:
    """A line for each booster that was trained for another label than its object is judged by.

    A class that a spec gives by its index is another one in another list of labels.

    Args:
        training: see `find_training`; controls of a wrong class are left out.
        true_labels: by object, in the labels of the network that judges.
    """
    lines = []
    for booster in training:
        label = true_labels.get(booster.object, "")
        if (
            label
            and booster.class_name
            and booster.variant != WRONG
            and plain_name(label) != plain_name(booster.class_name)
        ):
            lines.append(
                f"{booster.source}: {booster.variant} ({booster.object}) was trained for '{booster.class_name}', and "
                f"is judged as '{label}'"
            )
    return lines


def _read_records(workspace: Workspace) -> Iterator[tuple[str, str, str, Sequence[NetworkRecord]]]:
    """Hash, name, class and networks of each booster; broken and absent records are refused where they are used."""
    pngs: list[tuple[Path, type[BoosterRecord]]] = [(png, TextureRecord) for png in workspace.textures().values()]
    for patch_set in (None, *workspace.patch_sets()):
        pngs += [(png, PatchRecord) for png in workspace.with_patches(patch_set).patches().values()]
    for png, kind in pngs:
        with suppress(ToolkitError):
            record = read_json(png.with_suffix(".json"), kind)
            yield record.png_sha256, record.name, record.class_name, record.networks
    for folder in workspace.wraps().values():
        with suppress(ToolkitError):
            wrap = read_json(folder / RECORD_FILE, WrapRecord)
            if wrap.booster is not None:
                yield hash_wrap(wrap), wrap.name, wrap.class_name or "", wrap.booster.networks


def mark_seen(training: Sequence[Training], source: str, name: str, variant: str) -> str:
    """`yes`, `no` or `partly` for a row of the table, pooled ones among them; empty where nothing is known."""
    asked = {
        booster.seen for booster in training
        if (booster.source, booster.variant) == (source, variant) and name in (booster.object, POOLED)
    }  # fmt: skip
    return "" if not asked else "partly" if len(asked) == 2 else "yes" if asked == {True} else "no"


def describe_unseen(network: str, training: Sequence[Training]) -> list[str]:
    """A line for each source and variant that was judged by a network which its boosters never saw."""
    lines = []
    for source, variant in dict.fromkeys((booster.source, booster.variant) for booster in training if not booster.seen):
        some = [
            booster
            for booster in training
            if (booster.source, booster.variant, booster.seen) == (source, variant, False)
        ]
        names, archs = ({one.object: 0 for one in some}, {net.arch: 0 for one in some for net in one.networks})
        whose = ", ".join(names) if len(names) <= MOST_NAMED else f"{len(names)} objects"
        on = " and ".join(archs) or "no network"
        if network in archs:
            on += " with other weights"
        lines.append(f"{source}: {variant} ({whose}) was trained on {on}; {network} was not seen in training")
    return lines


@dataclass(frozen=True)
class Findings:
    """Everything that follows from the predictions.

    Attributes:
        predictions: one per image.
        groups: accuracy by source, object and variant.
        pairs: each variant against `unpatched`.
        comparisons: the boosters against their controls and each other.
        headlines: the result in words.
        flips: pairs gained, and lost.
        failed: (path, reason) of what could not be read.
        unpaired: (path, reason) of images without a partner.
        no_pairs: why pairs were not formed, and how many of each.
        sim_real: rendered sources against photographs of the same poses.
        renderers: plans that several renderers shot.
        passed: the same without the photographs that failed a gate; None where none did.
        training: of the boosters, where their records are known.
        origin: what the result rests on; None for what was not read from captures.
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
        """The predictions of photographs that failed a gate."""
        return [prediction for prediction in self.predictions if prediction.capture.failed_gates]

    @property
    def gate_lines(self) -> list[str]:
        """What the failed photographs change, in words, for each source and variant."""
        counts = Counter(photo.capture.source for photo in self.gated)
        return describe_both(self.pairs, self.passed.pairs if self.passed else (), counts)


@without_collector()
def compare_predictions(
    network: str, predictions: Sequence[Prediction], refused_folders: Sequence[tuple[str, str]] = ()
) -> Findings:
    """Count, pair, test and put into words what the network of that name said."""
    poses = index_poses(predictions)
    groups = group_predictions(predictions)
    pairs, comparisons = compare_unpatched(poses), compare_controls(poses)
    sim_real = compare_sim_real(predictions)
    renderers = compare_renderers(predictions)
    headlines = write_headlines(network, groups, [*pairs, *comparisons]) + write_sim_real(network, sim_real)
    headlines += [verdict for agreement in renderers for verdict in write_agreement(network, agreement)]
    good = [prediction for prediction in predictions if not prediction.capture.failed_gates]
    unread = [(prediction.capture.path, prediction.status) for prediction in predictions if not prediction.is_read]
    return Findings(
        tuple(predictions),
        groups=tuple(groups),
        pairs=tuple(pairs),
        comparisons=tuple(comparisons),
        headlines=tuple(headlines),
        flips=list_flips(poses),
        failed=(*unread, *refused_folders),
        unpaired=(*explain_unpaired(predictions, poses), *explain_apart(predictions)),
        no_pairs=tuple(count_no_pairs(poses)),
        sim_real=tuple(sim_real),
        renderers=tuple(renderers),
        passed=compare_predictions(network, good, refused_folders) if 0 < len(good) < len(predictions) else None,
    )


def summarise(classifier: Classifier, findings: Findings, notes: Sequence[str], kind: Kind = "eval") -> dict[str, Any]:
    """What `summary.json` of an evaluation, or of a sweep's, holds.

    `controls` has `comparisons` (the fields of `Comparison` and both intervals: each booster against those of its
    controls that were shot, and patch against texture, on the same poses, by object and pooled) and `answers` {source,
    question, tone, verdict, sentence}. Both are empty without controls and with one booster.

    `rests_on` holds the fields of `toolkit.evaluation.origin.Origin`: images counted and set aside, and how they were
    made.

    `gates` lists the photographs that failed one, and has `groups` and `pairs` once more without them.

    `boosters` lists what is known of the training of each patch and texture that the manifests name {source, object,
    variant, booster, booster_sha256, networks, seen}: whether it was trained on the network that judges.

    `corrupted` names the sources whose images are corrupted {source, corruption, severity}.

    `sim_real` has an entry for each rendered source and source of photographs of the same poses: `rows` by object and
    variant (the gap, its interval and test, the rank correlation), `gains` (which poses a booster gains), `wrong` (the
    poses that the rig predicted wrongly) and what was not compared. It is empty without both kinds of sources.

    `renderers` has an entry for each plan that several renderers shot: `gains` (each renderer's own pairs), `pairs` (of
    every two renderers how many answers agree, Cohen's kappa and the difference of colours) and `flips` (the images
    that only some renderers' networks get right).
    """
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
            "failed": [
                {"path": photo.capture.path, "gates": list(photo.capture.failed_gates)} for photo in findings.gated
            ],
            "groups_without": [group.as_json() for group in findings.passed.groups] if findings.passed else [],
            "pairs_without": [pair.as_pair() for pair in findings.passed.pairs] if findings.passed else [],
        },
        "failed": list_reasons(findings.failed),
        "unpaired": list_reasons(findings.unpaired),
        "notes": list(notes),
        "toolkit_version": __version__,
    }


def list_corrupted(captures: Iterable[Capture]) -> list[dict[str, str | int]]:
    """Source, corruption and severity of each source that is corrupted, sorted, as `summary.json` has them."""
    found = sorted({(capture.source, *capture.corruption) for capture in captures if capture.corruption is not None})
    return [{"source": source, "corruption": name, "severity": severity} for source, name, severity in found]
