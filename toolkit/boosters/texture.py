"""Train a texture from request to files: what `toolkit train-texture` runs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from toolkit.boosters.data import choose_files as choose_photographs
from toolkit.boosters.data import load_files
from toolkit.boosters.patch_config import name_files
from toolkit.boosters.patch_finish import quantise_patch, write_preview
from toolkit.boosters.patch_steps import Target, draw_first_patch
from toolkit.boosters.texture_config import Optimiser, TextureRequest, hash_inputs
from toolkit.boosters.texture_finish import (
    RECENT,
    Checkpoint,
    TextureFiles,
    WeatherValidation,
    draw_turntable,
    plan_turntable,
    read_checkpoint,
    validate_texture,
    write_checkpoint,
    write_finished,
)
from toolkit.boosters.texture_objects import Wearers, choose_class, dress_objects
from toolkit.boosters.texture_recipes import list_settings
from toolkit.boosters.texture_steps import Step, dilate, train_steps
from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.objects.records import Texture, read_texture
from toolkit.rig.views import ViewStream
from toolkit.training.checkpoint import forget_run, say_start

CHECKPOINT_EVERY_S = 10.0
"""How much work a kill may cost, and how often the turntable is drawn."""
MAX_BACKGROUNDS = 256


@dataclass(frozen=True)
class TrainedTexture:
    """What a run made.

    Attributes:
        texture: pixels and record.
        files: where it lies.
        validations: per network, on held-out views; empty when the texture was finished before.
        skipped: (path, reason) of background photographs that could not be used.
        resumed_from: steps that an earlier run had made; all of them when the texture was finished before.
        was_finished: whether there was nothing left to do.
    """

    texture: Texture
    files: TextureFiles
    validations: list[WeatherValidation]
    skipped: tuple[tuple[str, str], ...]
    resumed_from: int
    was_finished: bool


@dataclass(frozen=True)
class Backgrounds:
    """Photographs to stand behind the object: (k, s, s, 3) uint8 sRGB, what was skipped, and their record."""

    images: np.ndarray
    skipped: tuple[tuple[str, str], ...] = ()
    record: dict[str, Any] | None = None


def choose_files(workspace: Workspace, out: Path | None, name: str) -> TextureFiles:
    """The workspace's own folder, or below `out`."""
    folder = workspace.textures_dir if out is None else Path(out)
    return TextureFiles(folder / f"{name}.png", folder / "previews" / f"{name}.png", folder / ".training" / name)


def train_texture(
    request: TextureRequest,
    classifiers: list,
    workspace: Workspace,
    out: Path | None = None,
    restart: bool = False,
    quiet: bool = False,
    say: Callable[[str], None] = lambda line: None,
    workers: int | None = None,
    checkpoint_every_s: float = CHECKPOINT_EVERY_S,
) -> TrainedTexture:
    """Train a texture, or take it up where an interrupted run of the same request left it.

    Args:
        request: what to train.
        classifiers: the networks, at least one; the first one's labels and preprocessing lead.
        workspace: whose folders and objects are used.
        out: folder for the texture instead of the workspace's.
        restart: forget what an earlier run left.
        quiet: no progress bars.
        say: told what the user should know along the way.
        workers: processes that render; None: one for each core but one; 0: none, this process renders.
        checkpoint_every_s: how much work a kill may cost.

    Raises:
        ToolkitError: the request, an object, the photographs or a checkpoint cannot be used, or the disk is full.
    """
    wearers = dress_objects(workspace, request)
    label = choose_class(request, wearers.items)
    targets = [Target(classifier, classifier.class_index(label)) for classifier in classifiers]
    name = _name_texture(request, classifiers[0].labels[targets[0].class_index], targets[0].class_index)
    files = choose_files(workspace, out, name)
    backgrounds = _load_backgrounds(request, classifiers[0], quiet)
    key = hash_inputs(request, name, targets, wearers.sha256 + sha256_bytes(backgrounds.images.tobytes()))
    checkpoint_file = files.training / f"{key[:16]}.safetensors"
    if restart:
        checkpoint_file.unlink(missing_ok=True)
    elif (finished := _find_finished(files, wearers, key)) is not None:
        forget_run(files.training, key)
        return TrainedTexture(finished, files, [], backgrounds.skipped, request.descent.steps, True)

    for line in list_settings(request, wearers, label, [one.name for one in classifiers]):
        say(line)
    state = read_checkpoint(checkpoint_file, key, request.optimiser)
    resumed_from = 0 if state is None else state.done
    say_start(say, resumed_from, request.descent.steps, files.training)
    with ViewStream(wearers.subjects(), request.views, request.descent.seed, request.groups, workers) as stream:
        run = _Run(request, wearers, targets, files, checkpoint_file, key, checkpoint_every_s, quiet)
        state = run.make_steps(stream, state, backgrounds.images)
        pixels = quantise_patch(state.texture.reshape(3, -1)[:, wearers.source].reshape(state.texture.shape))
        with progress("Validating", 1, quiet) as bar:
            validations = validate_texture(pixels, stream.held_out(request.held_out), targets, request.descent.seed)
            bar.advance()
    texture = write_finished(request, wearers, targets, state, pixels, files, validations, backgrounds.record)
    forget_run(files.training, key)
    return TrainedTexture(texture, files, validations, backgrounds.skipped, resumed_from, False)


class _Run:
    """The training loop on disk: it shows how it goes and can be killed at any moment."""

    def __init__(
        self, request: TextureRequest, wearers: Wearers, targets: list[Target], files: TextureFiles,
        checkpoint_file: Path, key: str, every_s: float, quiet: bool,
    ) -> None:  # fmt: skip
        import torch

        self._request, self._targets, self._files = request, targets, files
        self._file, self._key, self._every_s, self._quiet = checkpoint_file, key, every_s, quiet
        device = targets[0].classifier.device
        self._source = torch.from_numpy(wearers.source).to(device)
        side = targets[0].classifier.preprocessing.crop_px
        self._turntable = [plan_turntable(subject, side, device) for subject in wearers.subjects()]

    def make_steps(self, stream: ViewStream, state: Checkpoint | None, backgrounds: np.ndarray) -> Checkpoint:
        """Make the steps that are left; a checkpoint and a turntable every few seconds, on Ctrl-C, and at the end."""
        import torch

        request, device = self._request, self._source.device
        if state is None:
            start = draw_first_patch(request.size_px, request.descent.seed, request.descent.start_contrast).numpy()
            state = Checkpoint(self._key, start, np.zeros(0), np.zeros(0))
        texture = torch.from_numpy(np.array(state.texture)).to(device)
        optimiser = Optimiser(request.optimiser, texture, state.done, state.optimiser)
        losses, accuracies = list(state.losses), list(state.accuracies)
        last = Step(state.done, state.texture, state.optimiser, 0.0, 0.0)

        def snapshot() -> Checkpoint:
            done = last.done
            return Checkpoint(
                self._key, last.texture, np.array(losses[:done]), np.array(accuracies[:done]), last.optimiser
            )

        written = monotonic()
        steps = train_steps(texture, self._source, state.done, optimiser, self._targets, stream, request, backgrounds)
        title = f"Training {self._files.png.stem}"
        with progress(title, request.descent.steps, self._quiet, done=last.done) as bar:
            bar.advance(0, note="rendering the first views")
            try:
                for step in steps:
                    losses.append(step.loss)
                    accuracies.append(step.accuracy)
                    last = step
                    bar.advance(
                        note=f"loss {np.mean(losses[RECENT]):.3f}  recognised {np.mean(accuracies[RECENT]):.0%}"
                    )
                    if monotonic() - written >= self._every_s:
                        write_checkpoint(self._file, snapshot())
                        self._draw(last.texture)
                        written = monotonic()
            finally:
                # also when stopped or failed: what is done is kept, and a step that was cut short is not counted
                if last.done > state.done:
                    write_checkpoint(self._file, snapshot())
        self._draw(last.texture)
        return snapshot()

    def _draw(self, texture: np.ndarray) -> None:
        import torch

        shown = dilate(torch.from_numpy(texture).to(self._source.device), self._source)
        write_preview(self._files.preview, draw_turntable(shown, self._turntable, self._targets[0]))


def _name_texture(request: TextureRequest, label: str, index: int) -> str:
    if request.name is None and len(request.objects) == 1:
        return request.objects[0]
    return name_files(request.name, label, index)


def _load_backgrounds(request: TextureRequest, classifier, quiet: bool) -> Backgrounds:
    side = classifier.preprocessing.resize_px
    if not request.background_share or request.backgrounds is None:
        return Backgrounds(np.zeros((0, side, side, 3), np.uint8))
    choice = choose_photographs(request.backgrounds, frozenset(), "all", "--backgrounds")
    count = min(MAX_BACKGROUNDS, len(choice.files))
    with progress("Reading backgrounds", count, quiet) as bar:
        rng = np.random.default_rng([request.descent.seed, 0xBAC])
        loaded = load_files(choice, count, rng, classifier.preprocessing, bar.advance)
    return Backgrounds(loaded.images, loaded.skipped, loaded.record)


def _find_finished(files: TextureFiles, wearers: Wearers, key: str) -> Texture | None:
    needed = (files.png, files.preview, *(files.glb(item.name) for item in wearers.items))
    if not all(file.is_file() for file in needed):
        return None
    try:
        texture = read_texture(files.png)
    except ToolkitError:
        return None  # a kill between picture and record leaves a pair that does not match; it is written again
    return texture if texture.record.settings.get("inputs_sha256") == key else None
