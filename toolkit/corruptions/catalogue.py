"""The corruptions of ImageNet-C and CIFAR-10-C, and their parameters at each severity.

Source: Hendrycks and Dietterich, "Benchmarking Neural Network Robustness to Common Corruptions and Perturbations", ICLR
2019, and its scripts (hendrycks/robustness). Lengths are in pixels of an image of 224² and of 32².
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from toolkit.core.errors import ToolkitError, one_of

if TYPE_CHECKING:
    import torch

    from toolkit.core.draws import RandomStreams

IMAGENET, CIFAR = "imagenet", "cifar"
MAX_CIFAR_SIDE_PX = 64
SEVERITIES = (1, 2, 3, 4, 5)
"""From slight to severe."""
SEVERITY_WORDS = re.compile(r"([1-5])(?:-([1-5]))?")
FAMILIES = ("noise", "blur", "weather", "digital", "extra")
Parameters = float | tuple[float, ...]
"""Parameters of a corruption at a severity."""
ELASTIC_PX = 244  # so published, for an image of 224


@dataclass(frozen=True)
class Corruption:
    """A way of corrupting images.

    Attributes:
        name: name in the published folders.
        family: noise, blur, weather or digital for the benchmark's fifteen, extra for four more.
        work: `module.function` in this package; loaded when it is called, so that the list needs no torch.
        parameters: five, by severity, for `imagenet` and for `cifar`.
        note: difference from the published corruption, if any.
    """

    name: str
    family: str
    work: str
    parameters: dict[str, tuple[Parameters, ...]]
    note: str = ""

    def apply(self, images: "torch.Tensor", given: Parameters, draws: "RandomStreams") -> "torch.Tensor":
        """Images (b, 3, h, w) float32 in [0, 1] to the same shape, not yet clipped."""
        from toolkit.corruptions import blur, digital, noise, weather

        module, _, function = self.work.partition(".")
        home = {"blur": blur, "digital": digital, "noise": noise, "weather": weather}[module]
        made: torch.Tensor = getattr(home, function)(images, given, draws)
        return made


def _corruption(
    name: str, family: str, work: str, imagenet: Sequence[Parameters], cifar: Sequence[Parameters], note: str = ""
) -> Corruption:
    return Corruption(name, family, work, {IMAGENET: tuple(imagenet), CIFAR: tuple(cifar)}, note)


def _scaled(length_px: float, *shares: tuple[float, ...]) -> list[tuple[float, ...]]:
    return [tuple(share * length_px for share in row) for row in shares]


# severities 1 to 5 in `make_imagenet_c.py`, then in `make_cifar_c.py`
ALL = (
    _corruption("gaussian_noise", "noise", "noise.add_gaussian_noise",
                (0.08, 0.12, 0.18, 0.26, 0.38), (0.04, 0.06, 0.08, 0.09, 0.10)),
    _corruption("shot_noise", "noise", "noise.add_shot_noise",
                (60, 25, 12, 5, 3), (500, 250, 100, 75, 50)),
    _corruption("impulse_noise", "noise", "noise.add_impulse_noise",
                (0.03, 0.06, 0.09, 0.17, 0.27), (0.01, 0.02, 0.03, 0.05, 0.07)),
    _corruption("defocus_blur", "blur", "blur.blur_by_defocus",
                ((3, 0.1), (4, 0.5), (6, 0.5), (8, 0.5), (10, 0.5)),
                ((0.3, 0.4), (0.4, 0.5), (0.5, 0.6), (1, 0.2), (1.5, 0.1))),
    _corruption("glass_blur", "blur", "blur.blur_by_glass",
                ((0.7, 1, 2), (0.9, 2, 1), (1, 2, 3), (1.1, 3, 2), (1.5, 4, 2)),
                ((0.05, 1, 1), (0.25, 1, 1), (0.4, 1, 1), (0.25, 1, 2), (0.4, 1, 2))),
    _corruption("motion_blur", "blur", "blur.blur_by_motion",
                ((10, 3), (15, 5), (15, 8), (15, 12), (20, 15)), ((6, 1), (6, 1.5), (6, 2), (8, 2), (9, 2.5))),
    _corruption("zoom_blur", "blur", "blur.blur_by_zoom",
                ((1.11, 0.01), (1.16, 0.01), (1.21, 0.02), (1.26, 0.02), (1.31, 0.03)),
                ((1.06, 0.01), (1.11, 0.01), (1.16, 0.01), (1.21, 0.01), (1.26, 0.01))),
    _corruption("snow", "weather", "weather.add_snow",
                ((0.1, 0.3, 3, 0.5, 10, 4, 0.8), (0.2, 0.3, 2, 0.5, 12, 4, 0.7),
                 (0.55, 0.3, 4, 0.9, 12, 8, 0.7), (0.55, 0.3, 4.5, 0.85, 12, 8, 0.65),
                 (0.55, 0.3, 2.5, 0.85, 12, 12, 0.55)),
                ((0.1, 0.2, 1, 0.6, 8, 3, 0.95), (0.1, 0.2, 1, 0.5, 10, 4, 0.9),
                 (0.15, 0.3, 1.75, 0.55, 10, 4, 0.9), (0.25, 0.3, 2.25, 0.6, 12, 6, 0.85),
                 (0.3, 0.3, 1.25, 0.65, 14, 12, 0.8))),
    _corruption("frost", "weather", "weather.add_frost",
                ((1, 0.4, 1), (0.8, 0.6, 1), (0.7, 0.7, 1), (0.65, 0.7, 1), (0.6, 0.75, 1)),
                ((1, 0.2, 0.2), (1, 0.3, 0.2), (0.9, 0.4, 0.2), (0.85, 0.4, 0.2), (0.75, 0.45, 0.2)),
                note="own texture: drawn frost instead of the published photographs"),
    _corruption("fog", "weather", "weather.add_fog",
                ((1.5, 2), (2, 2), (2.5, 1.7), (2.5, 1.5), (3, 1.4)),
                ((0.2, 3), (0.5, 3), (0.75, 2.5), (1, 2), (1.5, 1.75))),
    _corruption("brightness", "weather", "weather.brighten",
                (0.1, 0.2, 0.3, 0.4, 0.5), (0.05, 0.1, 0.15, 0.2, 0.3)),
    _corruption("contrast", "digital", "digital.reduce_contrast",
                (0.4, 0.3, 0.2, 0.1, 0.05), (0.75, 0.5, 0.4, 0.3, 0.15)),
    _corruption("elastic_transform", "digital", "digital.bend",
                _scaled(ELASTIC_PX, (2, 0.7, 0.1), (2, 0.08, 0.2), (0.05, 0.01, 0.02), (0.07, 0.01, 0.02),
                        (0.12, 0.01, 0.02)),
                _scaled(32, (0, 0, 0.08), (0.05, 0.2, 0.07), (0.08, 0.06, 0.06), (0.1, 0.04, 0.05), (0.1, 0.03, 0.03))),
    _corruption("pixelate", "digital", "digital.pixelate",
                (0.6, 0.5, 0.4, 0.3, 0.25), (0.95, 0.9, 0.85, 0.75, 0.65)),
    _corruption("jpeg_compression", "digital", "digital.compress_jpeg",
                (25, 18, 15, 10, 7), (80, 65, 58, 50, 40)),
    _corruption("speckle_noise", "extra", "noise.add_speckle_noise",
                (0.15, 0.2, 0.35, 0.45, 0.6), (0.06, 0.1, 0.12, 0.16, 0.2)),
    _corruption("gaussian_blur", "extra", "blur.blur_by_gaussian",
                (1, 2, 3, 4, 6), (0.4, 0.6, 0.7, 0.8, 1)),
    _corruption("spatter", "extra", "weather.add_spatter",
                ((0.65, 0.3, 4, 0.69, 0.6, 0), (0.65, 0.3, 3, 0.68, 0.6, 0),
                 (0.65, 0.3, 2, 0.68, 0.5, 0), (0.65, 0.3, 1, 0.65, 1.5, 1),
                 (0.67, 0.4, 1, 0.65, 1.5, 1)),
                ((0.62, 0.1, 0.7, 0.7, 0.5, 0), (0.65, 0.1, 0.8, 0.7, 0.5, 0),
                 (0.65, 0.3, 1, 0.69, 0.5, 0), (0.65, 0.1, 0.7, 0.69, 0.6, 1),
                 (0.65, 0.1, 0.5, 0.68, 0.6, 1))),
    _corruption("saturate", "extra", "digital.saturate",
                ((0.3, 0), (0.1, 0), (2, 0), (5, 0.1), (20, 0.2)),
                ((0.3, 0), (0.1, 0), (1.5, 0), (2, 0.1), (2.5, 0.2))),
)  # fmt: skip
CORRUPTIONS: dict[str, Corruption] = {corruption.name: corruption for corruption in ALL}
COMMON = tuple(name for name, corruption in CORRUPTIONS.items() if corruption.family != "extra")
"""The fifteen in the benchmark's mean."""


def find_corruption(name: str, severity: int) -> Corruption:
    """Return the corruption called `name`; a `ToolkitError` if it is unknown, or `severity` is not 1 to 5."""
    if name not in CORRUPTIONS:
        raise one_of("corruption", name, list(CORRUPTIONS))
    if severity not in SEVERITIES:
        raise ToolkitError(f"severity {severity} of {name}: there are five, 1 (slight) to 5 (severe): choose one")
    return CORRUPTIONS[name]


def choose_parameters(height: int, width: int) -> str:
    """Return `cifar` for images with a short side of at most 64 px, else `imagenet`."""
    return CIFAR if min(height, width) <= MAX_CIFAR_SIDE_PX else IMAGENET


def choose_names(names: list[str]) -> list[str]:
    """Return names of corruptions from names, families, `common` (fifteen) and `all`; a `ToolkitError` for others."""
    chosen: list[str] = []
    for name in names:
        if name == "all":
            chosen += CORRUPTIONS
        elif name == "common":
            chosen += COMMON
        elif name in FAMILIES:
            chosen += [known for known, corruption in CORRUPTIONS.items() if corruption.family == name]
        else:
            chosen.append(find_corruption(name, 1).name)
    return list(dict.fromkeys(chosen))


def find_note(names: list[str]) -> str | None:
    """Describe how corruptions of `names` differ from the published; None if none does."""
    notes = [f"{name}: {CORRUPTIONS[name].note}" for name in names if CORRUPTIONS[name].note]
    return "; ".join(notes) or None


def parse_corruptions(words: Sequence[str], severities: Sequence[int] = SEVERITIES) -> tuple[tuple[str, int], ...]:
    """Return each (name, severity) of words such as `fog:3`, `noise:1-3` and `common`, in their order, each once.

    Args:
        words: a corruption, a family, `common` (the fifteen) or `all`, with `:SEVERITY` or `:FIRST-LAST`.
        severities: severities of a word without any.

    Raises:
        ToolkitError: there is no such corruption or severity.
    """
    pairs = [
        (name, severity)
        for word in words
        for name in choose_names([word.partition(":")[0]])
        for severity in parse_severities("corruption", word, severities)
    ]
    return tuple(dict.fromkeys(pairs))


def name_corruptions(pairs: Sequence[tuple[str, int]]) -> str:
    """Return the words for (name, severity) pairs that `parse_corruptions` takes, such as `common:1-5`."""
    levels: dict[str, set[int]] = {}
    for name, severity in pairs:
        levels.setdefault(name, set()).add(severity)
    alike: dict[frozenset[int], list[str]] = {}
    for name, found in levels.items():
        alike.setdefault(frozenset(found), []).append(name)
    said = []
    for severities, names in alike.items():
        whole = [word for word in ("all", "common", *FAMILIES) if set(choose_names([word])) == set(names)]
        said += [f"{name}:{span}" for name in whole[:1] or names for span in list_spans(severities)]
    return ", ".join(said)


def parse_severities(kind: str, word: str, default: Sequence[int] = SEVERITIES) -> Sequence[int]:
    """Return the severities in a word such as `fog:3` or `fog:1-3`; `default` for a word without any.

    Raises:
        ToolkitError: there is no severity behind the colon; names the `kind` of the word.
    """
    _, colon, after = word.partition(":")
    if not colon:
        return default
    match = SEVERITY_WORDS.fullmatch(after)
    # a word that does not match becomes an empty range
    first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
    if first > last:
        raise ToolkitError(f"{kind} '{word}': severity '{after}': expected one of 1 (slight) to 5 (severe), or a range")
    return range(first, last + 1)


def list_spans(numbers: Iterable[int]) -> list[str]:
    """Join consecutive numbers: `1-3`, `7`."""
    spans: list[list[int]] = []
    for number in sorted(numbers):
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return [str(first) if first == last else f"{first}-{last}" for first, last in spans]
