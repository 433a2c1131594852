"""What an evaluation found, before it is written."""

from collections.abc import Sequence
from dataclasses import dataclass

from toolkit.evaluation.controls import Comparison, compare_controls
from toolkit.evaluation.flips import FlipList, list_flips
from toolkit.evaluation.headline import write_headlines
from toolkit.evaluation.metrics import Group, Pair, compare_variants, group_predictions, match_pairs
from toolkit.evaluation.predict import Prediction
from toolkit.evaluation.say import Headline
from toolkit.evaluation.sim_real import SimReal, compare_sim_real
from toolkit.evaluation.sim_real_say import write_sim_real


@dataclass(frozen=True)
class Findings:
    """Everything that follows from the predictions.

    Attributes:
        predictions: one per image.
        groups, pairs: rows of the tables.
        comparisons: the boosters against their controls and each other.
        headlines: the result in words.
        flips: pairs gained, and lost.
        failed: (path, reason) of what could not be read.
        unpaired: (path, reason) of images without a partner.
        sim_real: rendered sources against photographs of the same poses.
    """

    predictions: tuple[Prediction, ...]
    groups: tuple[Group, ...]
    pairs: tuple[Pair, ...]
    comparisons: tuple[Comparison, ...]
    headlines: tuple[Headline, ...]
    flips: tuple[FlipList, FlipList]
    failed: tuple[tuple[str, str], ...]
    unpaired: tuple[tuple[str, str], ...]
    sim_real: tuple[SimReal, ...] = ()


def find_results(
    arch: str, predictions: Sequence[Prediction], refused_folders: Sequence[tuple[str, str]] = ()
) -> Findings:
    """Count, pair, test and put into words."""
    groups = group_predictions(predictions)
    matches, unpaired = match_pairs(predictions)
    pairs = compare_variants(matches)
    comparisons = compare_controls(predictions)
    sim_real = compare_sim_real(predictions)
    return Findings(
        tuple(predictions),
        tuple(groups),
        tuple(pairs),
        tuple(comparisons),
        (*write_headlines(arch, groups, pairs, comparisons), *write_sim_real(arch, sim_real)),
        list_flips(matches),
        (*((one.capture.path, one.status) for one in predictions if not one.is_read), *refused_folders),
        tuple(unpaired),
        tuple(sim_real),
    )
