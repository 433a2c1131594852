"""From the last step to files: round the patch as it will be printed, validate that, draw it, record it."""

from dataclasses import asdict, dataclass, replace
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from toolkit import __version__
from toolkit.boosters.batches import stack_on_device
from toolkit.boosters.checkpoint import Checkpoint
from toolkit.boosters.data import TrainingData
from toolkit.boosters.mounted import MountedViews, validate_mounted
from toolkit.boosters.preview import draw_preview
from toolkit.boosters.request import PatchRequest
from toolkit.boosters.resumable import RECENT
from toolkit.boosters.training import Target
from toolkit.boosters.validation import Validation, count_placements, validate_patch
from toolkit.console import progress
from toolkit.files import write_bytes
from toolkit.patches import Patch, write_patch
from toolkit.print_scores import score_print
from toolkit.recorded import Network


@dataclass(frozen=True)
class PatchFiles:
    """Where a run writes.

    Attributes:
        png: the patch; its record lies beside it.
        preview: the picture of it on training images.
        training: folder for checkpoints, until the run is finished.
    """

    png: Path
    preview: Path
    training: Path


def quantise_patch(patch: np.ndarray) -> np.ndarray:
    """(3, n, n) float in [0, 1] to (n, n, 3) uint8, rounded."""
    return np.round(patch.transpose(1, 2, 0) * 255).astype(np.uint8)


def finish_patch(
    request: PatchRequest,
    targets: list[Target],
    data: TrainingData,
    state: Checkpoint,
    files: PatchFiles,
    quiet: bool,
    views: MountedViews | None = None,
) -> tuple[Patch, list[Validation], list[Validation]]:
    """Validate the rounded patch, draw the preview, and last, as the mark that all is done, write patch and record.

    Returns the patch, what the networks say of held-out images, and of held-out `views` of the object, if any. What
    they say of those images under the corruptions that it was trained with stands in the record alone.
    """
    import torch

    first, pixels = targets[0].classifier, quantise_patch(state.patch)
    printed = torch.from_numpy(pixels.transpose(2, 0, 1).copy()).float().div(255).to(first.device)
    held_out = stack_on_device(data.held_out, first.device)
    appearance, seed, image_px = request.appearance(), request.descent.seed, first.preprocessing.crop_px
    clear = replace(request, corrupted=None).appearance()
    with progress("Validating", count_placements(len(held_out)), quiet) as bar:
        validations = validate_patch(printed, held_out, targets, clear, seed, image_px, advance=bar.advance)
    spoilt: list[Validation] = []
    if request.corrupted is not None:
        always = replace(request.corrupted, probability=1)
        spoilt = validate_patch(printed, held_out, targets, clear, seed, image_px, corrupted=always)
    on_object = [] if views is None else validate_mounted(printed, views, targets, image_px)
    examples = stack_on_device(data.train[:16], first.device)
    label = first.labels[targets[0].class_index]
    lines = _describe(request, data, validations)
    sheet = draw_preview(printed, examples, targets[0], appearance, seed, image_px, label, lines)
    write_preview(files.preview, sheet)
    patch = write_patch(
        files.png.parent,
        pixels,
        {
            "name": files.png.stem,
            "class_name": label,
            "class_index": targets[0].class_index,
            "networks": [name_network(target.classifier) for target in targets],
            "data": data.record
            | {"backgrounds": request.data.backgrounds, "seed": request.data.seed}
            | ({} if views is None else {"mounted_views_sha256": views.sha256}),
            "seed": seed,
            "settings": request.settings() | {"image_px": image_px, "inputs_sha256": state.inputs_sha256},
            "final": _summarise(state)
            | asdict(score_print(pixels))
            | list_shares(validations, "held_out")
            | list_shares(on_object, "mounted")
            | list_shares(spoilt, "corrupted"),
            "toolkit_version": __version__,
        },
    )
    return patch, validations, on_object


def write_preview(file: Path, sheet: np.ndarray) -> None:
    """Write a picture (h, w, 3) uint8 sRGB as PNG."""
    buffer = BytesIO()
    Image.fromarray(sheet).save(buffer, "PNG")  # without the slow search for the smallest file that a patch is worth
    write_bytes(file, buffer.getvalue())


def name_network(classifier) -> Network:
    """A classifier as records name it."""
    return Network(arch=classifier.arch, weights=classifier.weights.name, sha256=classifier.weights.sha256)


def _describe(request: PatchRequest, data: TrainingData, validations: list[Validation]) -> list[str]:
    where = "held-out" if data.is_held_out else "training"
    answers = [
        f"{a.network}, {where} images: {a.patched.value:.0%} with patch, {a.bare.value:.0%} bare" for a in validations
    ]
    size = f"{request.size_px} x {request.size_px} px, {request.descent.steps} steps, seed {request.descent.seed}"
    return [size, *answers[:3], "Below: training images, new placements, the network's first answer"]


def _summarise(state: Checkpoint) -> dict[str, float]:
    return {"loss": float(state.losses[RECENT].mean()), "accuracy": float(state.accuracies[RECENT].mean())}


def list_shares(validations: list[Validation], where: str) -> dict[str, float]:
    """Each network's shares, intervals and counts, as a record's `final` holds them."""
    final: dict[str, float] = {}
    names = [answer.network for answer in validations]
    for k, answer in enumerate(validations):
        network = answer.network if names.index(answer.network) == k else f"{answer.network}_{k + 1}"
        for what, share in (("patched", answer.patched), ("bare", answer.bare)):
            low, high = share.ci95
            numbers = {"top1": share.value, "low": low, "high": high, "n": float(share.n)}
            final |= {f"{network}_{where}_{what}_{name}": value for name, value in numbers.items()}
    return final
