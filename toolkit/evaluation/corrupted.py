"""The images of a capture folder once more, corrupted as ImageNet-C's are: sources of their own in one evaluation."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from toolkit.captures.corrupted import SEED, Corruption, name_source
from toolkit.captures.read import Capture, CaptureFolder


def add_corrupted(folder: CaptureFolder, corruptions: Sequence[Corruption]) -> CaptureFolder:
    """The folder with each source once more under each corruption: `sim` in fog of severity 3 is source `sim-fog-3`.

    Nothing is read here: an image is corrupted whenever it is read, see `corrupt_crops`. A source of the folder that
    has the name already keeps it, and the other gets a `+`. Files that are corrupted already, by the manifest, are not
    corrupted again; a note says so.

    Args:
        folder: what is evaluated.
        corruptions: (name, severity) of each.
    """
    if not corruptions:
        return folder
    from toolkit.corruptions.sources import find_note

    clean = [one for one in folder.captures if one.corruption is None]
    taken = {one.source for one in folder.captures}
    spoilt = sorted(taken - {one.source for one in clean})
    made: list[Capture] = []
    for source in dict.fromkeys(one.source for one in clean):
        for corruption in corruptions:
            name = name_source(source, corruption)
            while name in taken:
                name += "+"
            taken.add(name)
            made += [
                replace(one, source=name, path=f"{name}/{_below_source(one)}", corruption=corruption)
                for one in clean
                if one.source == source
            ]
    notes = [f"corrupted already, and not once more: {', '.join(spoilt)}"] if spoilt else []
    notes += [note] if (note := find_note(list(dict.fromkeys(name for name, _ in corruptions)))) else []
    captures = sorted((*folder.captures, *made), key=lambda one: (one.source, one.object, one.variant, one.path))
    return replace(folder, captures=tuple(captures), notes=(*folder.notes, *notes))


def laid_on(capture: Capture) -> Corruption | None:
    """The corruption that an image gets whenever it is read: none that its file has already."""
    return None if capture.cut_px is not None else capture.corruption


def corrupt_crops(captures: Sequence[Capture], crops: Sequence[np.ndarray], device: str) -> list[np.ndarray]:
    """What a network sees of images, corrupted: after they were resized and cut, before they are normalised.

    As ImageNet-C's own images, the result is rounded to 8 bits. An image's seed is its path below the source, so that
    neither its place nor its batch matters, and `sim` and `real` get the same fog at the same path.

    Args:
        captures: all alike in what is `laid_on` them.
        crops: (s, s, 3) uint8 sRGB of each.
        device: cpu or cuda; the same but for float rounding.
    """
    from toolkit.corruptions import corrupt, image_seed
    from toolkit.corruptions.digital import from_bytes, to_bytes

    corruption = laid_on(captures[0]) if captures else None
    if corruption is None:
        return list(crops)
    seeds = [image_seed(SEED, _below_source(one)) for one in captures]
    return list(to_bytes(corrupt(from_bytes(np.stack(crops), device), *corruption, seeds)))


def list_corrupted(captures: Iterable[Capture]) -> list[dict[str, Any]]:
    """Source, corruption and severity of each source that is corrupted, sorted, as `summary.json` has them."""
    found = sorted({(one.source, *one.corruption) for one in captures if one.corruption is not None})
    return [{"source": source, "corruption": name, "severity": severity} for source, name, severity in found]


def _below_source(capture: Capture) -> str:
    return capture.path.split("/", 1)[1]
