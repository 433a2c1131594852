"""How far to trust a retextured photograph: predicted from one true photograph, compared with another."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import permutations
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from toolkit.core.console import progress
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.imaging.colour import delta_e2000, lab_of_linear, srgb_to_linear
from toolkit.imaging.read import decode_image
from toolkit.models.network import Classifier
from toolkit.photos.prints.find import rectify_patch
from toolkit.photos.prints.fitted_photo import FittedPhoto, fit_photo, list_files, read_known
from toolkit.photos.prints.look import read_texels
from toolkit.photos.retexture import encode_like

RECTIFIED_PX = 400
BANDS = 4


@dataclass(frozen=True)
class Prediction:
    """One true photograph, predicted from another.

    Attributes:
        source, truth: names of the photographs; the same where its own patch was put back.
        delta_e: median ΔE00 of the texels' means.
        sharpness: root mean square of the luma's Laplacian over the patch, predicted over true.
        spectrum: the same for each octave of the straightened patch's luma, from fine to coarse.
        noise: deviation of what the finest octave holds within texels, predicted over true.
        answers: by network, the first answers on the predicted and on the true photograph.
    """

    source: str
    truth: str
    delta_e: float
    sharpness: float
    spectrum: tuple[float, ...]
    noise: float
    answers: dict[str, tuple[str, str]]


@dataclass(frozen=True)
class RetextureCheck:
    """Predictions of photographs that differ only in their patch, and of each from itself.

    Attributes:
        others: predicted from a photograph of another patch in the same place.
        own: the photograph's own patch, put back.
        two_true: by network, how often two true photographs of one patch at several places are answered alike.
        skipped: (path, reason) of photographs that could not be used.
    """

    others: tuple[Prediction, ...]
    own: tuple[Prediction, ...]
    two_true: dict[str, tuple[int, int]]
    skipped: tuple[tuple[str, str], ...]

    def to_json(self) -> dict[str, Any]:
        """All of it for a script."""
        return asdict(self) | {"summary": {"others": summarise(self.others), "own": summarise(self.own)}}


def summarise(rows: Sequence[Prediction]) -> dict[str, Any]:
    """Medians over predictions, and by network how many are answered alike, of how many."""
    if not rows:
        return {"n": 0}
    networks = rows[0].answers
    return {
        "n": len(rows),
        "delta_e_median": round(float(np.median([row.delta_e for row in rows])), 2),
        "delta_e_p90": round(float(np.percentile([row.delta_e for row in rows], 90)), 2),
        "sharpness": round(float(np.median([row.sharpness for row in rows])), 3),
        "noise": round(float(np.median([row.noise for row in rows])), 3),
        "spectrum": [round(float(x), 3) for x in np.median([row.spectrum for row in rows], axis=0)],
        "alike": {name: [sum(len(set(row.answers[name])) == 1 for row in rows), len(rows)] for name in networks},
    }


def check_retexture(
    workspace: Workspace, photos: Sequence[Path], found: Sequence[str], classifiers: Sequence[Classifier], seed: int = 0
) -> RetextureCheck:
    """Predict each photograph of a known patch from those of other patches in the same place, and compare.

    Photographs are of one place where their names differ only in the name of the patch: `bear1_3in_over.jpg` and
    `bear2_3in_over.jpg`.

    Args:
        workspace: where patches are known.
        photos: photographs, or folders of them.
        found: the patches' names or PNG files.
        classifiers: whose answers are compared.
        seed: of the noise.

    Raises:
        ToolkitError: no photograph shows one of the patches.
    """
    patches = [read_known(workspace, name) for name in found]
    fitted: dict[str, FittedPhoto] = {}
    skipped = []
    files = list_files(photos)
    with progress("fitting", len(files)) as bar:
        for file in files:
            named = [patch for patch in patches if patch.name in file.stem]
            try:
                fitted[file.stem] = fit_photo(file, named or patches)
            except ToolkitError as error:
                skipped.append((str(file), str(error).removeprefix(f"{file}: ")))
            bar.advance(note=file.name)
    if not fitted:
        raise ToolkitError(f"none of {len(files)} photographs could be used: {skipped[0][0]}: {skipped[0][1]}")
    answers = {stem: _ask(classifiers, one.image) for stem, one in fitted.items()}
    pairs = [(stem, stem) for stem in fitted]
    pairs += [(a, b) for a, b in permutations(fitted, 2) if _place(a, fitted[a]) == _place(b, fitted[b])]
    rows = []
    with progress("comparing", len(pairs)) as bar:
        for number, (source, truth) in enumerate(pairs):
            rows.append(_predict(source, truth, fitted, answers, classifiers, Draws(seed, number, "retexture check")))
            bar.advance()
    own = tuple(row for row in rows if row.source == row.truth)
    others = tuple(row for row in rows if row.source != row.truth)
    return RetextureCheck(others, own, _two_true(fitted, answers), tuple(skipped))


def _place(stem: str, one: FittedPhoto) -> str | None:
    """What a file's name says beside its patch's; where it does not name the patch, nothing else is of its place."""
    return stem.replace(one.patch.name, "", 1) if one.patch.name in stem else f"\0{stem}"


def _two_true(fitted: dict[str, FittedPhoto], answers: dict[str, dict[str, str]]) -> dict[str, tuple[int, int]]:
    pairs = [(a, b) for a, b in permutations(fitted, 2) if a < b and fitted[a].patch.name == fitted[b].patch.name]
    names = next(iter(answers.values()))
    return {name: (sum(answers[a][name] == answers[b][name] for a, b in pairs), len(pairs)) for name in names}


def _ask(classifiers: Sequence[Classifier], image: np.ndarray) -> dict[str, str]:
    """By network, its first answer."""
    import torch

    found = {}
    with torch.inference_mode():
        for network in classifiers:
            batch = network.preprocess(image)[None].to(network.device)
            found[network.name] = network.labels[int(network.logits(batch).argmax())]
    return found


def _predict(
    source: str, truth: str, fitted: dict[str, FittedPhoto], answers: dict[str, dict[str, str]],
    classifiers: Sequence[Classifier], draws: Draws,
) -> Prediction:  # fmt: skip
    one, other = fitted[source], fitted[truth]
    (picture,) = one.with_patches([other.patch], draws)
    predicted = decode_image(encode_like(one.photo, picture), one.photo.path)
    n = other.patch.pixels.shape[0]
    place = replace(one.sighting, warp=one.look.warp, agreement=np.ones_like(one.sighting.agreement))
    there = replace(other.sighting, warp=other.look.warp, agreement=np.ones_like(other.sighting.agreement))
    said, shows = read_texels(predicted, place, n)
    seen, also = read_texels(other.image, there, n)
    good = (shows > 0) & (also > 0)
    difference = delta_e2000(*(lab_of_linear(srgb_to_linear(values[good])) for values in (said, seen)))
    lumas = [
        cv2.cvtColor(rectify_patch(image, at, RECTIFIED_PX), cv2.COLOR_RGB2GRAY).astype(np.float32)
        for image, at in ((predicted, place), (other.image, there))
    ]
    spectra = [_octaves(luma) for luma in lumas]
    sharp = [float(np.sqrt((cv2.Laplacian(luma, cv2.CV_32F) ** 2).mean())) for luma in lumas]
    noise = [_within_texels(luma, n) for luma in lumas]
    asked = _ask(classifiers, predicted)
    return Prediction(
        source, truth, float(np.median(difference)), sharp[0] / max(sharp[1], 1e-6),
        tuple(a / max(b, 1e-6) for a, b in zip(*spectra, strict=True)), noise[0] / max(noise[1], 1e-6),
        {name: (asked[name], answers[truth][name]) for name in asked},
    )  # fmt: skip


def _octaves(luma: np.ndarray) -> list[float]:
    """Deviation of each octave, from fine to coarse (a Laplacian pyramid's)."""
    found = []
    for _ in range(BANDS):
        coarse = cv2.pyrDown(luma)
        found.append(float((luma - cv2.pyrUp(coarse, dstsize=luma.shape[::-1])).std()))
        luma = coarse
    return found


def _within_texels(luma: np.ndarray, n: int) -> float:
    """Median deviation of luma within the middle of a texel, codes."""
    side = max(luma.shape[0] // n, 4)
    wide = cv2.resize(luma, (side * n, side * n), interpolation=cv2.INTER_LINEAR)
    texels = wide.reshape(n, side, n, side).transpose(0, 2, 1, 3)
    inner = texels[:, :, side // 4 : side - side // 4, side // 4 : side - side // 4]
    return float(np.median(inner.std(axis=(2, 3))))
