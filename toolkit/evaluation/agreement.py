"""Compare several renderers on the same images: the gain in each, equal predictions, and differences of colour."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from toolkit.captures.capture import OF_RENDERER, RENDERER_VERSION, UNPATCHED, Capture, find_difference
from toolkit.captures.read import POOLED
from toolkit.captures.truth import outline_captures
from toolkit.core.errors import ToolkitError
from toolkit.core.statistics import PairedOutcomes
from toolkit.core.tables import format_kappa, format_p, format_points, format_test
from toolkit.core.text import count_of, join_words
from toolkit.core.workspace import Workspace
from toolkit.evaluation.metrics import OWNERS, Comparison, Pair, describe_change, name_booster, rank_variant
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.read_pixels import read_pixels
from toolkit.evaluation.verdict import Verdict
from toolkit.imaging.colour import delta_e2000, lab_of_linear, srgb_to_linear
from toolkit.rig.renderers import RENDERERS

MOST_COLOURS = 36
"""Number of pairs of images, evenly chosen, whose colours are compared."""
Key = tuple[str, str, int]
"""Object, variant and pose."""
Images = dict[Key, Prediction]


@dataclass(frozen=True)
class ColourGap:
    """Difference of an object's colours between two renderers.

    Attributes:
        n: number of pairs of images.
        median, p90: median and 90th percentile of CIEDE2000 over the object's pixels.
        lighter: mean L* of the second renderer minus mean L* of the first.
        dark, bright: median CIEDE2000 of the darkest and of the brightest quarter of the pixels in the first.
    """

    n: int
    median: float
    p90: float
    lighter: float
    dark: float
    bright: float

    def describe(self) -> str:
        """Return the numbers in a sentence."""
        where = "dark" if self.dark > self.bright else "bright"
        return (
            f"colour of the object's pixels in {count_of(self.n, 'pair')} of images: median ΔE00 {self.median:.1f}, "
            f"90 % below {self.p90:.1f}; {'lighter' if self.lighter > 0 else 'darker'} by {abs(self.lighter):.1f} L*; "
            f"more in {where} pixels (darkest quarter {self.dark:.1f}, brightest {self.bright:.1f})"
        )


@dataclass(frozen=True)
class RendererPair:
    """Predictions of two renderers' images of the same objects and poses.

    Attributes:
        first, second: sources of the two renderers' images.
        rows: one comparison for each variant, `unpatched` first; each pair is the first's and the second's image.
        colour: difference of colours; None without masks or readable files.
    """

    first: str
    second: str
    rows: tuple[Comparison, ...]
    colour: ColourGap | None = None


@dataclass(frozen=True)
class RendererAgreement:
    """A plan that several renderers shot.

    Attributes:
        sources: sources of the images, the ray caster's first.
        renderers: name and version of each source's renderer.
        images: images of each source that all sources have.
        colours: difference of colours of every two sources; empty before `add_colours`.
    """

    sources: tuple[str, ...]
    renderers: tuple[str, ...]
    images: tuple[Images, ...]
    colours: tuple[ColourGap | None, ...] = ()

    @cached_property
    def names(self) -> dict[str, str]:
        """Renderer of each source; with its version if two sources have the same renderer."""
        return dict(zip(self.sources, shorten_names(self.renderers), strict=True))

    @cached_property
    def gains(self) -> tuple[Comparison, ...]:
        """Return, for each booster and source, the pairs of images without and with the booster; no controls."""
        keys = [key for key in self.images[0] if key[1] != UNPATCHED and key[1] not in OWNERS]
        rows = []
        for variant in sorted({key[1] for key in keys}, key=rank_variant):
            pairs = [self._pair_all(key) for key in keys if key[1] == variant]
            # a pose counts in all renderers or in none
            whole = [own for own in pairs if own]
            for at, source in enumerate(self.sources if whole else ()):
                rows.append(Comparison(source, POOLED, UNPATCHED, variant, tuple(own[at] for own in whole)))
        return tuple(rows)

    def _pair_all(self, key: Key) -> list[Pair]:
        """Return each renderer's pair of images without and with the booster; nothing if a renderer lacks one."""
        bare = (key[0], UNPATCHED, key[2])
        if bare not in self.images[0]:
            return []
        pairs = [Pair(own[bare], own[key]) for own in self.images]
        return pairs if all(pair.is_alike for pair in pairs) else []

    @cached_property
    def pairs(self) -> tuple[RendererPair, ...]:
        """Return a comparison of every two renderers."""
        # the bare object first, then boosters, then controls
        variants = sorted({key[1] for key in self.images[0]}, key=lambda name: (name != UNPATCHED, rank_variant(name)))
        found = []
        for at, (one, other) in enumerate(combinations(range(len(self.sources)), 2)):
            rows = tuple(
                Comparison(self.sources[other], POOLED, name, name, tuple(self._across(one, other, name)))
                for name in variants
            )
            colour = self.colours[at] if self.colours else None
            found.append(RendererPair(self.sources[one], self.sources[other], rows, colour))
        return tuple(found)

    def _across(self, one: int, other: int, variant: str) -> Iterator[Pair]:
        return (Pair(self.images[one][key], self.images[other][key]) for key in self.images[one] if key[1] == variant)

    @cached_property
    def flips(self) -> tuple[tuple[Key, tuple[bool, ...]], ...]:
        """Images that are not correct in every renderer or in none, with a bool for each source: correct or not."""
        found = [(key, tuple(own[key].correct_top1 for own in self.images)) for key in self.images[0]]
        return tuple((key, right) for key, right in found if len(set(right)) > 1)

    def as_json(self) -> dict[str, Any]:
        """Return an entry of `renderers` in `summary.json`."""
        return {
            "sources": list(self.sources), "renderers": list(self.renderers), "n": len(self.images[0]),
            "gains": [row.as_pair() for row in self.gains],
            "pairs": [
                {
                    "first": pair.first, "second": pair.second,
                    "rows": [_describe_answers(row) for row in pair.rows],
                    "colour": pair.colour and vars(pair.colour),
                }
                for pair in self.pairs
            ],
            "flips": [
                {"object": name, "variant": variant, "pose_id": pose_id, "right": list(right)}
                for (name, variant, pose_id), right in self.flips
            ],
        }  # fmt: skip


def count_same(row: Comparison) -> int:
    """Return the number of pairs with the same prediction, correct or not."""
    return sum(pair.first.top1_index == pair.second.top1_index for pair in row.pairs)


def _describe_answers(row: Comparison) -> dict[str, Any]:
    found = row.outcomes
    return {
        "variant": row.second, "n": found.n, "n_first": found.n_first, "n_second": found.n_second,
        "same_answer": count_same(row), "kappa": found.kappa,
        **{f"{name}_over_first": value for name, value in describe_change(found).items() if name != "mcnemar_p"},
    }  # fmt: skip


def compare_renderers(predictions: Sequence[Prediction]) -> list[RendererAgreement]:
    """Find sources with the same images by different renderers, from their manifests.

    Images are the same if object, variant, pose, camera, booster and all settings but those of the renderer agree.
    Sources are compared under the same corruption alone.
    """
    # images by what they show: object, variant and pose
    by_source: dict[str, Images] = defaultdict(dict)
    for prediction in predictions:
        capture = prediction.capture
        if prediction.is_read and capture.pose_id is not None and "renderer" in capture.settings:
            key = capture.object, capture.variant, capture.pose_id
            by_source[capture.source].setdefault(key, prediction)
    renderers = {source: _name_renderer(images) for source, images in by_source.items()}
    # of one renderer alone, as in most evaluations, there is nothing to compare
    known = [source for source, names in renderers.items() if len(names) == 1]
    if len({renderers[source][0] for source in known}) < 2:
        return []
    # the default renderer leads its family; a family has a source of each renderer
    order = sorted(known, key=lambda source: (_rank(by_source[source]), source))
    found, placed = [], set[str]()
    for base in order:
        if base in placed:
            continue
        # a source joins if its renderer is new to the family and an image is the same by its manifest
        family = [base]
        for other in order:
            if all(renderers[other] != renderers[one] for one in family) and any(
                _is_same(by_source[base][key], by_source[other][key])
                for key in by_source[base].keys() & by_source[other].keys()
            ):
                family.append(other)
        placed.update(family[1:])
        images = _keep_common([by_source[source] for source in family])
        if len(family) > 1 and images[0]:
            names = tuple(renderers[source][0] for source in family)
            found.append(RendererAgreement(tuple(family), names, tuple(images)))
    return found


def _keep_common(images: Sequence[Images]) -> list[Images]:
    """Return the images that all sources have, of the same object and camera, in the same order."""
    keys = [
        key for key, shown in images[0].items() if all(key in own and _is_same(shown, own[key]) for own in images[1:])
    ]
    return [{key: own[key] for key in keys} for own in images]


def _name_renderer(images: Images) -> list[str]:
    settings = [image.capture.settings for image in images.values()]
    return sorted({str(one.get(RENDERER_VERSION) or one["renderer"]) for one in settings})


def _rank(images: Images) -> int:
    name = next(iter(images.values())).capture.settings["renderer"]
    return [*RENDERERS].index(name) if name in RENDERERS else len(RENDERERS)


def _is_same(one: Prediction, other: Prediction) -> bool:
    first, second = one.capture, other.capture
    return (
        first.booster_sha256 == second.booster_sha256
        and first.corruption == second.corruption
        and first.compare_cameras(second) is None
        and find_difference(first.settings, second.settings, but=OF_RENDERER) is None
    )


def add_colours(found: RendererAgreement, workspace: Workspace) -> RendererAgreement:
    """Return the same agreement with colours of object pixels compared; corrupted images are left out."""
    # corrupted images differ in more than the renderer
    keys = [key for key, image in found.images[0].items() if image.capture.corruption is None]
    # boosters may be dark or bright: the unmodified object compares renderers best
    bare = [key for key in keys if key[1] == UNPATCHED] or keys
    # images spread evenly over the list
    chosen = (
        [bare[at] for at in np.unique(np.linspace(0, len(bare) - 1, MOST_COLOURS).round().astype(int))] if bare else []
    )
    shown = [found.images[0][key].capture for key in chosen]
    try:
        masks, _ = outline_captures(shown, workspace)
    except ToolkitError:
        masks = {}  # objects whose shape is gone, which answers do not need
    # only the object's pixels: its outline comes from mesh and camera
    outlined = [(key, masks[one.path].mask) for key, one in zip(chosen, shown, strict=True) if one.path in masks]
    labs = [[_read_lab(own[key].capture, mask) for key, mask in outlined] for own in found.images]
    return replace(found, colours=tuple(_compare_colours(one, other) for one, other in combinations(labs, 2)))


def _read_lab(capture: Capture, mask: np.ndarray) -> np.ndarray | None:
    """Return (n, 3) L*a*b* of the object's pixels; None if the file is unreadable or has another size."""
    pixels = read_pixels(capture, None)
    if isinstance(pixels, str) or pixels.shape[:2] != mask.shape:
        return None
    return lab_of_linear(srgb_to_linear(pixels[mask] / 255))


def _compare_colours(one: Sequence[np.ndarray | None], other: Sequence[np.ndarray | None]) -> ColourGap | None:
    # an image counts only where both renderers showed the object
    both = [(a, b) for a, b in zip(one, other, strict=True) if a is not None and b is not None]
    if not both:
        return None
    first, second = (np.concatenate(side) for side in zip(*both, strict=True))
    gap = delta_e2000(first, second)
    # by lightness of the first: the darkest and the lightest quarter
    low, high = np.quantile(first[:, 0], (0.25, 0.75))
    numbers = (
        np.median(gap), np.quantile(gap, 0.9), (second[:, 0] - first[:, 0]).mean(),
        np.median(gap[first[:, 0] <= low]), np.median(gap[first[:, 0] >= high]),
    )  # fmt: skip
    return ColourGap(len(both), *(round(float(number), 3) for number in numbers))


def write_agreement(network: str, found: RendererAgreement) -> list[Verdict]:
    """Return a verdict for each booster: whether its gain is significant in every renderer."""
    verdicts = []
    for variant in dict.fromkeys(row.second for row in found.gains):
        rows = [row for row in found.gains if row.second == variant]
        names = found.names
        tone, where = say_where({names[row.source]: row.outcomes for row in rows})
        verdict = f"The gain of {name_booster(variant)} {where}"
        counts = "; ".join(f"{names[row.source]} {describe_gain(row)}" for row in rows)
        sentence = f"Correct answers of {network}, without → with {name_booster(variant)}, on the same poses: {counts}."
        verdicts.append(Verdict(tone, sentence, verdict, join_words(found.sources), variant))
    return verdicts


def shorten_names(renderers: Sequence[str]) -> list[str]:
    """Return renderers without their versions; with them if two are versions of the same renderer."""
    short = [name.partition(" ")[0] for name in renderers]
    return short if len(set(short)) == len(short) else list(renderers)


def say_where(outcomes: Mapping[str, PairedOutcomes]) -> tuple[str, str]:
    """Return tone and words, `holds in all 3 renderers`, of a gain with these outcomes by renderer."""
    holds = [name for name, found in outcomes.items() if found.second_is_better]
    harms = [name for name, found in outcomes.items() if found.first_is_better]
    # open until it holds in all of them
    tone = "open"
    if len(holds) == len(outcomes):
        tone, words = "good", f"holds in {'both' if len(holds) == 2 else f'all {len(holds)}'} renderers"
    else:
        start = f"holds in {join_words(holds)}, and is" if holds else "is"
        words = f"{start} not shown in {join_words([name for name in outcomes if name not in holds])}"
    # harm in any renderer outweighs the gains in others
    if harms:
        tone, words = "bad", f"{words}; it does harm in {join_words(harms)}"
    return tone, words


def describe_gain(row: Comparison) -> str:
    """Return `42 → 62 of 72 (20 gained, 0 lost, exact McNemar p < 0.0001)`."""
    found = row.outcomes
    changed = f"{found.only_second} gained, {found.only_first} lost, {format_test(found.mcnemar_p)}"
    return f"{found.n_first} → {found.n_second} of {found.n} ({changed})"


GAIN_HEADS = ("variant", "renderer", "n", "without", "with", "gained", "lost", "points", "p")
ANSWER_HEADS = (
    "variant", "renderers", "n", "same prediction", "only the first is correct", "only the second is correct", "kappa",
)  # fmt: skip


def list_gains(found: RendererAgreement) -> list[list[str]]:
    """Return the cells of `GAIN_HEADS`, a row for each booster and renderer."""
    names = dict(zip(found.sources, found.renderers, strict=True))
    rows = []
    for row in found.gains:
        own = row.outcomes
        counts = [str(n) for n in (own.n, own.n_first, own.n_second, own.only_second, own.only_first)]
        rows.append([row.second, names[row.source], *counts, format_points(own.gain), format_p(own.mcnemar_p)])
    return rows


def list_answers(found: RendererAgreement) -> list[list[str]]:
    """Return the cells of `ANSWER_HEADS`, a row for each variant and every two renderers."""
    names = found.names
    return [
        [
            row.second, f"{names[pair.first]}, {names[pair.second]}", str(row.outcomes.n), str(count_same(row)),
            str(row.outcomes.only_first), str(row.outcomes.only_second), format_kappa(row.outcomes.kappa),
        ]
        for pair in found.pairs for row in pair.rows
    ]  # fmt: skip


def list_flips(found: RendererAgreement) -> list[str]:
    """Return lines like `racer patched: 3 (raycast), 7 (mitsuba)`: poses, and renderers with a correct prediction."""
    lines: dict[str, list[str]] = {}
    for (name, variant, pose_id), right in found.flips:
        where = ", ".join(renderer for renderer, is_right in zip(found.names.values(), right, strict=True) if is_right)
        lines.setdefault(f"{name} {variant}", []).append(f"{pose_id} ({where})")
    return [f"{who}: {', '.join(poses)}" for who, poses in lines.items()]


def list_colours(found: RendererAgreement) -> list[str]:
    """Return a line for every two renderers whose colours were compared."""
    names = found.names
    return [
        f"{names[pair.second]} against {names[pair.first]}, {pair.colour.describe()}"
        for pair in found.pairs if pair.colour is not None
    ]  # fmt: skip
