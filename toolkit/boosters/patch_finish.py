"""From the last step to files: round the patch as it will be printed, validate that, draw it, record it."""

from dataclasses import asdict, dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from toolkit import __version__
from toolkit.boosters.data import TrainingData, cut_centres, stack_on_device
from toolkit.boosters.mounted import MountedViews, validate_mounted
from toolkit.boosters.parts.base import Appearance, show_patch
from toolkit.boosters.patch_config import PatchRequest
from toolkit.boosters.patch_loop import RECENT, Checkpoint
from toolkit.boosters.patch_steps import Target
from toolkit.boosters.validation import Validation, count_placements, validate_patch
from toolkit.core.console import progress
from toolkit.core.draws import Draws
from toolkit.core.files import write_bytes
from toolkit.imaging.printer import score_print
from toolkit.objects.records import Network, Patch, write_patch

if TYPE_CHECKING:
    import torch

COLUMNS, ROWS = 4, 4
CELL_PX, GAP_PX, CAPTION_PX, HEADER_PX = 224, 12, 26, 176
PAPER, INK, FAINT, RIGHT, WRONG = (255, 255, 255), (28, 30, 34), (110, 115, 122), (22, 130, 62), (190, 42, 36)


def draw_preview(
    patch: "torch.Tensor",
    images: "torch.Tensor",
    target: Target,
    appearance: Appearance,
    seed: int,
    image_px: int,
    title: str,
    lines: list[str],
) -> np.ndarray:
    """Draw sixteen images with the patch and the patch itself; (h, w, 3) uint8 sRGB.

    Args:
        patch: (3, n, n) in [0, 1].
        images: (k, 3, s, s) uint8 sRGB; they repeat, in other placements, when k is below sixteen.
        target: the network that labels them.
        appearance: as in training, drawn anew.
        seed: of the run.
        image_px: side of what the network sees.
        title: above, beside the patch.
        lines: smaller, below the title.
    """
    import torch

    which = torch.arange(COLUMNS * ROWS, device=images.device) % len(images)
    with torch.inference_mode():
        photos = show_patch(patch, cut_centres(images, image_px)[which], appearance, Draws(seed, 0, "preview"))
        chances = target.classifier.logits(photos).float().softmax(1).cpu()
    width = COLUMNS * (CELL_PX + GAP_PX) + GAP_PX
    sheet = Image.new("RGB", (width, HEADER_PX + ROWS * (CELL_PX + CAPTION_PX + GAP_PX) + GAP_PX), PAPER)
    _draw_header(sheet, _to_image(patch), title, lines)
    for k, (photo, chance) in enumerate(zip(photos, chances, strict=True)):
        row, column = divmod(k, COLUMNS)
        corner = (GAP_PX + column * (CELL_PX + GAP_PX), HEADER_PX + row * (CELL_PX + CAPTION_PX + GAP_PX))
        sheet.paste(_to_image(photo).resize((CELL_PX, CELL_PX), Image.Resampling.LANCZOS), corner)
        best = int(chance.argmax())
        colour = RIGHT if best == target.class_index else WRONG
        write_caption(sheet, corner, target.classifier.labels[best], float(chance[best]), colour)
    return np.asarray(sheet)


def _to_image(pixels: "torch.Tensor") -> Image.Image:
    return Image.fromarray((pixels.permute(1, 2, 0).cpu().numpy() * 255).round().astype(np.uint8))


def _font(size: int) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(size)


def _draw_header(sheet: Image.Image, patch: Image.Image, title: str, lines: list[str]) -> None:
    side = HEADER_PX - 2 * GAP_PX
    sheet.paste(patch.resize((side, side), Image.Resampling.NEAREST), (GAP_PX, GAP_PX))
    pen = ImageDraw.Draw(sheet)
    left = side + 2 * GAP_PX + 6
    pen.text((left, GAP_PX), title, INK, _font(30))
    for k, line in enumerate(lines):
        pen.text((left, GAP_PX + 46 + 26 * k), line, FAINT, _font(18))


def write_caption(
    sheet: Image.Image, corner: tuple[int, int], label: str, chance: float, colour, cell_px: int = CELL_PX
) -> None:
    """Write what a network says under the picture at `corner`, shortened to its width."""
    pen, font = ImageDraw.Draw(sheet), _font(17)
    percent = f" {chance:.0%}"
    text = label
    while pen.textlength(text + percent, font) > cell_px and len(text) > 4:
        text = text.removesuffix("...")[:-1].rstrip() + "..."
    pen.text((corner[0], corner[1] + cell_px + 3), text + percent, colour, font)


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
