"""The run behind every booster: its files, its training loop, its record and its preview."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

from toolkit import __version__
from toolkit.boosters.detectors import describe_targets
from toolkit.boosters.pixel_config import PixelConfig
from toolkit.boosters.pixels import PixelTask, Target, record_network
from toolkit.boosters.validation import MOST_NAMED, Validation, list_shares
from toolkit.core.config import align_rows
from toolkit.core.console import is_verbose
from toolkit.core.files import write_bytes
from toolkit.core.text import list_some
from toolkit.core.work import INPUTS, WorkResult, find_made
from toolkit.imaging.read import encode_image
from toolkit.models.predict import predict
from toolkit.objects.records import Patch, Texture
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.loop import History, fit

Booster = TypeVar("Booster", Patch, Texture)
Trained = TypeVar("Trained", bound="TrainedBooster")


@dataclass(frozen=True)
class BoosterFiles:
    """Files of a run.

    Attributes:
        png: the booster, of several pictures their record; what else it needs lies beside it.
        preview: the picture of it in use.
        training: folder for checkpoints, until the run is finished.
    """

    png: Path
    preview: Path
    training: Path


@dataclass(frozen=True, kw_only=True)
class TrainedBooster(WorkResult):
    """Result of a run, beside the booster itself, whose files lie in `files`."""

    files: BoosterFiles


class BoosterTask(PixelTask[Trained]):
    """Training of a booster that has files."""

    def __init__(
        self, config: PixelConfig, size_px: int, targets: list[Target], files: BoosterFiles,
        optimiser: str = "sign",
    ) -> None:  # fmt: skip
        """Begin with random pixels.

        Args:
            config: with its steps counted.
            size_px: side of the booster.
            targets: the networks and their classes.
            files: where to write.
            optimiser: by which rule its pixels are moved.
        """
        super().__init__(config, size_px, targets, optimiser)
        self.files = files
        self.fit_config = config.fit_config(optimiser)

    def record(
        self, history: History, data: dict[str, Any], settings: dict[str, Any], figures: Mapping[str, float],
        shares: Mapping[str, Sequence[Validation]],
    ) -> dict[str, Any]:  # fmt: skip
        """The fields of `BoosterRecord` that every booster has, but its size and hash.

        Args:
            history: of the loss.
            data: what it was trained on.
            settings: every hyper-parameter.
            figures: for `final`, after the last losses.
            shares: what the networks said, by where they were asked, for `final` as well.
        """
        # losses are averaged over the last steps, as a single step is noisy
        final = history.recent(self.recent) | dict(figures)
        for where, validations in shares.items():
            final |= list_shares(list(validations), where)
        return {
            "name": self.files.png.stem, "class_name": self.targets[0].label,
            "class_index": self.targets[0].class_index,
            "networks": [record_network(target.classifier) for target in self.targets],
            "data": data, "seed": self.fit_config.seed,
            "settings": settings | {INPUTS: self.key}, "final": final,
            "toolkit_version": __version__,
        }  # fmt: skip


def introduce(
    kind: str, config: PixelConfig, size_px: int, targets: Sequence[Target], more: Sequence[tuple[str, str]] = ()
) -> list[str]:
    """Return what is trained, and the recipe with its changes; if the console is verbose, also every setting.

    Args:
        kind: `patch`, `texture` or `wrap`.
        config: with its steps counted.
        size_px: side of the booster.
        targets: the networks and their classes.
        more: (name, value) of what is known beside the settings.
    """
    names, plain = describe_targets(targets), [target.classifier.name for target in targets]
    # networks with a part of their own come first, so that they are named
    # `__contains__` is true for a plain name, and true sorts last
    names.sort(key=plain.__contains__)
    line = (
        f"training a {kind} for class {targets[0].label}: {size_px} × {size_px} px, {config.steps} steps of "
        f"{config.batch} images, on {list_some(names, MOST_NAMED)}"
    )
    recipe = f"recipe: {config.recipe}{config.changes and f', with {config.changes}'}"
    if not is_verbose():
        return [line, recipe]
    weather = [] if config.weather is None else config.weather.lines()
    return [line, recipe, *align_rows([("networks", ", ".join(names)), *more, *config.rows()]), *weather]


def train_booster(
    task: BoosterTask[Trained], *, restart: bool, checkpoint_every_s: float, shared: Sequence[str] = ()
) -> Trained:
    """Train, or resume an interrupted run of the same inputs.

    Args:
        task: the booster.
        restart: forget what an earlier run left.
        checkpoint_every_s: how much work a kill may cost.
        shared: files beside the checkpoints that other runs may need.

    Raises:
        ToolkitError: a checkpoint cannot be used, the loss is not finite, or the disk is full.
    """
    checkpoint = Checkpoint(task.files.training, task.key, restart, checkpoint_every_s, tuple(shared))
    # the fit returns what the task made, or what an earlier run left
    fitted = fit(task, task.fit_config, checkpoint)
    return replace(fitted.made, resumed_from=fitted.resumed_from, was_finished=fitted.was_finished)


def read_finished(
    read: Callable[[Path], Booster], files: BoosterFiles, key: str, others: Iterable[Path] = ()
) -> Booster | None:
    """The booster, where its files and what else it needs are whole and of this key."""
    needed = (files.png, files.preview, *others)
    return find_made(key, lambda: read(files.png), lambda made: made.record.settings.get(INPUTS), *needed)


COLUMNS, ROWS = 4, 4
PHOTO_PX, GAP_PX, CAPTION_PX, HEADER_PX = 224, 12, 26, 176
PAPER, INK, FAINT, RIGHT, WRONG = (255, 255, 255), (28, 30, 34), (110, 115, 122), (22, 130, 62), (190, 42, 36)


def draw_patch_preview(
    patch: np.ndarray, photos: torch.Tensor, target: Target, title: str, lines: list[str]
) -> np.ndarray:
    """Draw sixteen photographs with the patch and the patch itself; (h, w, 3) uint8 sRGB.

    Args:
        patch: (n, n, 3) uint8 sRGB.
        photos: (16, 3, m, m) sRGB-encoded in [0, 1].
        target: the network that labels them.
        title: above, beside the patch.
        lines: smaller, below the title.
    """
    width = COLUMNS * (PHOTO_PX + GAP_PX) + GAP_PX
    sheet = Image.new("RGB", (width, HEADER_PX + ROWS * (PHOTO_PX + CAPTION_PX + GAP_PX) + GAP_PX), PAPER)
    _draw_header(sheet, Image.fromarray(patch), title, lines)
    _draw_photos(sheet, photos, target, HEADER_PX, GAP_PX, PHOTO_PX)
    return np.asarray(sheet)


TURNTABLE_GAP_PX = 8


def draw_turntable(photos: torch.Tensor, target: Target) -> np.ndarray:
    """(h, w, 3) uint8 sRGB: views (k, 3, s, s) sRGB-encoded in [0, 1] of the objects, as large as they are."""
    side, gap = photos.shape[-1], TURNTABLE_GAP_PX
    rows = -(-len(photos) // COLUMNS)
    size = (COLUMNS * (side + gap) + gap, rows * (side + CAPTION_PX + gap) + gap)
    sheet = Image.new("RGB", size, PAPER)
    _draw_photos(sheet, photos, target, gap, gap, side)
    return np.asarray(sheet)


def write_preview(file: Path, sheet: np.ndarray) -> None:
    """Write a picture (h, w, 3) uint8 sRGB as PNG."""
    # without the slow search for the smallest file that a patch is worth
    write_bytes(file, encode_image(sheet, "PNG"))


def _draw_photos(
    sheet: Image.Image, photos: torch.Tensor, target: Target, top_px: int, gap_px: int, side_px: int
) -> None:
    # the network sees what the reader sees
    chances = predict(photos, target.classifier).softmax(1)
    for k, (photo, chance) in enumerate(zip(photos, chances, strict=True)):
        row, column = divmod(k, COLUMNS)
        corner = (gap_px + column * (side_px + gap_px), top_px + row * (side_px + CAPTION_PX + gap_px))
        picture = Image.fromarray((photo.permute(1, 2, 0).cpu().numpy() * 255).round().astype(np.uint8))
        if picture.width != side_px:
            picture = picture.resize((side_px, side_px), Image.Resampling.LANCZOS)
        sheet.paste(picture, corner)
        # green for the class, red for any other answer
        best = int(chance.argmax())
        colour = RIGHT if best == target.class_index else WRONG
        caption = _shorten(target.classifier.labels[best], f" {float(chance[best]):.0%}", side_px)
        ImageDraw.Draw(sheet).text((corner[0], corner[1] + side_px + 3), caption, colour, _font(17))


def _shorten(label: str, percent: str, width_px: int) -> str:
    pen, font = ImageDraw.Draw(Image.new("RGB", (1, 1))), _font(17)
    text = label
    # the percentage stays whole; the label is what may be cut
    while pen.textlength(text + percent, font) > width_px and len(text) > 4:
        text = text.removesuffix("...")[:-1].rstrip() + "..."
    return text + percent


def _font(size: int) -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(size)


def _draw_header(sheet: Image.Image, patch: Image.Image, title: str, lines: list[str]) -> None:
    side = HEADER_PX - 2 * GAP_PX
    # nearest: texels are shown as they are printed, with sharp edges
    sheet.paste(patch.resize((side, side), Image.Resampling.NEAREST), (GAP_PX, GAP_PX))
    pen = ImageDraw.Draw(sheet)
    left = side + 2 * GAP_PX + 6
    pen.text((left, GAP_PX), title, INK, _font(30))
    for k, line in enumerate(lines):
        pen.text((left, GAP_PX + 46 + 26 * k), line, FAINT, _font(18))
