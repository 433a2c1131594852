"""`toolkit landing train`: a network learns where the pad is, from given weights, by the shared training loop."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from torch import nn

from toolkit import __version__
from toolkit.core.console import notice, progress
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import read_json, sha256_bytes, sha256_file, write_bytes, write_json
from toolkit.core.work import INPUTS, Work, find_made
from toolkit.core.workspace import Workspace
from toolkit.models.load import bundled_file, read_bundled
from toolkit.models.network import choose_device
from toolkit.models.weights import WeightsFile, find_local, find_weights, open_weights, read_state_dict
from toolkit.rooms.landing.config import LandingTrainConfig, Pool
from toolkit.rooms.landing.dataset import LoadedSet, SampleSet, join_samples, read_sets
from toolkit.rooms.landing.regressor import (
    SUFFIX,
    ErrorRow,
    Regressor,
    RegressorRecord,
    as_batch,
    build_module,
    freeze,
    regressors_dir,
    run_network,
    summarise_errors,
)
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.classifier_task import load_tensors
from toolkit.training.loop import History, TrainingTask, fit

RIDGE = 0.05
"""Penalty of the ridge regression, per frame, on standardised features."""
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
CHECKPOINT_EVERY_S = 20.0
CALIBRATION_SHARE = 0.1
LEAST_HEIGHT_M = 0.5
PROBE_BATCH = 64


def find_start(arch: str, init: Path | None) -> WeightsFile:
    """The weights to start from: those that are named, ImageNet's, or where there are none the bundled network's."""
    if init is not None:
        return find_weights(arch, init)
    bundled, record = bundled_file(), read_bundled()
    if find_local(arch) is None and bundled is not None and record is not None and record.arch == arch:
        notice(f"no weights of {arch} on this machine: starting from the bundled network {record.name}")
        return open_weights(bundled, record.name)
    return find_weights(arch)


def start_module(arch: str, outputs: int, pool: Pool, *, image_px: int, init: WeightsFile, seed: int) -> nn.Module:
    """A network with weights, all but the last layer's, which is drawn by the seed.

    Raises:
        ToolkitError: the weights are of another network.
    """
    # what finds no weights stays random, drawn by the seed; the caller's generator is left alone
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        module = build_module(arch, outputs, pool, image_px)
    own, given = module.state_dict(), read_state_dict(init)
    # tensors of the same name and shape: the last layer usually has another number of outputs
    fitting = {name: value for name, value in given.items() if name in own and value.shape == own[name].shape}
    # the last layer may differ, and the counters of batch normalisation, but nothing else
    missing = {name.rpartition(".")[0] for name in own if name not in fitting and not name.endswith("tracked")}
    if len(missing) > 1:
        raise FieldError(f"holds no weights of {arch}: {len(missing)} layers differ", {"init": init.path})
    load_tensors(
        module, {name: value.float() if value.is_floating_point() else value for name, value in fitting.items()}, False
    )
    return module


def fit_ridge(features: np.ndarray, offsets: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Weighted ridge regression on standardised features, in closed form.

    Args:
        features: (n, d).
        offsets: (n, 2) metres.
        weight: (n,) on the error of each row.

    Returns:
        (d, 2) weights and (2,) bias of the features as they are, and the root of the mean square of what is left.
    """
    # standardised, so that the penalty means the same for every feature
    mean, spread = features.mean(axis=0), features.std(axis=0) + 1e-6
    rows = np.column_stack([(features - mean) / spread, np.ones(len(features))]).astype(np.float64) * weight[:, None]
    wanted = offsets * weight[:, None]
    # the normal equations; the bias is as good as free of the penalty
    penalty = np.full(rows.shape[1], RIDGE * len(rows))
    penalty[-1] = 1e-9
    found = np.linalg.solve(rows.T @ rows + np.diag(penalty), rows.T @ wanted)
    residual = float(np.sqrt(np.square((rows @ found - wanted) / weight[:, None]).mean()))
    # back from standardised features to the features as they are
    weights = found[:-1] / spread[:, None]
    return weights, found[-1] - mean @ weights, residual


@dataclass(frozen=True)
class TrainedRegressor:
    """Results of a training run."""

    file: Path  # file, regressor: the weights, and them loaded
    regressor: Regressor
    resumed_from: int  # steps that an earlier run had made
    was_finished: bool  # whether there was nothing left to do


def train_regressor(
    space: Workspace, datasets: str | Sequence[str], config: LandingTrainConfig, *, seed: int = 0, device: str = "auto",
    restart: bool = False,
) -> TrainedRegressor:  # fmt: skip
    """Train a regressor on landing data sets, or take it up where an interrupted run of the same inputs left it.

    Args:
        space: the workspace; `rig/regressors` is written.
        datasets: names of sets below captures/landing, or their folders; of the same camera and pad.
        device: `auto`, `cpu` or `cuda`.

    Raises:
        ToolkitError: data, weights or checkpoint cannot be used.
    """
    device = choose_device(device)
    words = [datasets] if isinstance(datasets, str) else datasets
    sets = read_sets([find_dataset(space, word) for word in words], config.frames)
    init = find_start(config.arch, config.init)
    name = config.name or "-".join(loaded.name for loaded in sets)
    file = regressors_dir(space) / f"{name}{SUFFIX}"
    task = RegressorTask(config, sets, init, seed=seed, file=file, device=device)
    checkpoint = Checkpoint(file.parent / ".training" / name, task.key, restart, CHECKPOINT_EVERY_S)
    fitted = fit(task, config.fit_config(len(task.chosen), seed), checkpoint)
    return TrainedRegressor(file, fitted.made, fitted.resumed_from, fitted.was_finished)


def find_dataset(space: Workspace, word: str) -> Path:
    """The folder of a landing data set."""
    own = space.captures_dir / "landing" / word
    folder = own if own.is_dir() or not Path(word).is_dir() else Path(word)
    if not folder.is_dir():
        raise ToolkitError(
            f"no landing data set called '{word}' in {own.parent}: make one with 'toolkit landing collect'"
        )
    return folder


class RegressorTask(TrainingTask[Regressor]):
    """A network goes down the squared error of the pad's (x, y)."""

    work = Work("landing-regressor", 1, old_at=4)
    recent = 20

    def __init__(
        self, config: LandingTrainConfig, sets: Sequence[LoadedSet], init: WeightsFile, *, seed: int, file: Path,
        device: str,
    ) -> None:  # fmt: skip
        self.config, self.sets, self.init = config, sets, init
        self.train = train = join_samples([loaded.train for loaded in sets])
        self.seed, self.file, self.device = seed, file, device
        self.title = f"Training {file.stem}"
        # frames for calibrating the deviation are set aside before training
        numbers = np.random.default_rng([seed, 63]).permutation(len(train.truths))
        aside = round(CALIBRATION_SHARE * len(numbers)) if config.uncertainty else 0
        self.calibration, self.chosen = np.sort(numbers[:aside]), np.sort(numbers[aside:])
        if len(self.chosen) < 2:
            raise ToolkitError("too few frames to train on: collect more")
        # x and y, and the logarithm of the deviation if it is wanted
        outputs, image_px = 3 if config.uncertainty else 2, train.images.shape[1]
        module = start_module(config.arch, outputs, config.pool, image_px=image_px, init=init, seed=seed)
        self.module = module.to(device=device, memory_format=torch.channels_last)  # type: ignore[call-overload]

    def list_inputs(self) -> list[Any]:
        """The frames, the weights that it begins with, and every setting."""
        digests = [shard.sha256 for loaded in self.sets for shard in loaded.about.shards]
        return [digests, self.init.sha256, self.seed, self.file.stem, self.config.record()]

    def parameters(self) -> dict[str, torch.Tensor]:
        """Weights and biases."""
        return dict(self.module.named_parameters())

    def buffers(self) -> dict[str, torch.Tensor]:
        """Statistics of batch normalisation."""
        return dict(self.module.named_buffers())

    def find_finished(self) -> Regressor | None:
        """The regressor, where its file is whole and of the same inputs."""
        file = self.file.with_suffix(".json")
        record = find_made(
            self.key, lambda: read_json(file, RegressorRecord), lambda made: made.inputs_sha256, self.file, file
        )
        if record is None or record.sha256 != sha256_file(self.file):
            return None
        load_tensors(self.module, read_state_dict(WeightsFile(self.file, record.sha256, self.file.name)))
        return Regressor(record, freeze(self.module, self.device), self.device)

    def begin(self) -> None:
        """Start the last layer where it is best for the features as they are."""
        if self.config.probe:
            self._probe()

    def _probe(self) -> None:
        last = self.module.get_submodule("fc")
        if not isinstance(last, torch.nn.Linear):
            raise FieldError(f"{self.config.arch} has no last layer called fc: leave it out", {"probe": True})
        # every quarter turn of a frame is another sample, and its offset turns with it
        turns = 4 if self.config.augment else 1
        known = self.train.offsets[self.chosen]
        offsets = np.concatenate([turn_offsets(known, np.full(len(known), k)) for k in range(turns)])
        heights = np.tile(np.maximum(self.train.heights[self.chosen], LEAST_HEIGHT_M), turns)
        # relative errors: a mistake counts by its share of the height
        weight = 1 / heights if self.config.loss == "relative" else np.ones_like(heights)
        found, bias, residual = fit_ridge(self._find_features(turns), offsets, weight)
        # the solution becomes the last layer; training goes on from it
        with torch.no_grad():
            last.weight.zero_()
            last.weight[:2], last.bias[:2] = torch.from_numpy(found.T).float(), torch.from_numpy(bias).float()
            # the deviation starts at what the closed form leaves over
            if self.config.uncertainty:
                last.bias[2] = float(np.log(max(residual, 1e-3)))

    def _find_features(self, turns: int) -> np.ndarray:
        """(turns · n, d) float32 what the last layer sees of the frames, turned by each quarter."""
        seen: list[np.ndarray] = []
        self.module.eval()
        last = self.module.get_submodule("fc")
        # the hook catches what goes into the last layer
        hook = last.register_forward_pre_hook(lambda _, given: seen.append(given[0].cpu().numpy()))
        with progress("Looking at frames", turns * len(self.chosen)) as bar, torch.no_grad():
            for k in range(turns):
                for start in range(0, len(self.chosen), PROBE_BATCH):
                    some = self.chosen[start : start + PROBE_BATCH]
                    batch = torch.rot90(as_batch(self.train.images[some]), k, (2, 3)).to(self.device)
                    run_network(self.module, batch, IMAGENET_MEAN, IMAGENET_STD)
                    bar.advance(len(some))
        hook.remove()
        return np.concatenate(seen)

    @contextmanager
    def open(self) -> Iterator[None]:
        """Train mode within; with `probe` the statistics of normalisation stay."""
        self.module.train(not self.config.probe)
        yield

    def loss(self, step: int) -> tuple[torch.Tensor, dict[str, float]]:
        """Mean square error of a batch, or its likelihood; and the mean error in cm."""
        batch, wanted, heights = self._draw_batch(step)
        self.module.train(not self.config.probe)
        out = run_network(self.module, batch, IMAGENET_MEAN, IMAGENET_STD)
        error = out[:, :2] - wanted
        scale = heights.clamp_min(LEAST_HEIGHT_M)[:, None] if self.config.loss == "relative" else 1.0
        squares = (error / scale).square().mean(dim=1)
        if self.config.uncertainty:
            spread = out[:, 2]
            # minus the log-likelihood of a normal error of this spread (Kendall and Gal 2017)
            loss = (error.square().mean(dim=1) * torch.exp(-2 * spread) / 2 + spread).mean()
        else:
            loss = squares.mean()
        return loss, {"error_cm": 100 * float(error.detach().norm(dim=1).mean())}

    def _draw_batch(self, step: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        # epoch and position in it follow from the step, so that a resumed run draws the same batches
        per_epoch = max(len(self.chosen) // self.config.batch, 1)
        epoch, k = divmod(step, per_epoch)
        order = np.random.default_rng([self.seed, epoch, 64]).permutation(self.chosen)
        some = order[k * self.config.batch : (k + 1) * self.config.batch]
        batch, wanted = as_batch(self.train.images[some]), self.train.offsets[some].copy()
        if self.config.augment:
            # augmentation: quarter turns, exposure, white balance and brightness
            rng = Draws(self.seed, step, self.work.kind).of("augmentation")
            turns = rng.integers(0, 4, len(some))
            # one gain for all channels, as exposure, and a small gain for each, as white balance
            gain = rng.uniform(0.75, 1.3, (len(some), 1, 1, 1)) * rng.uniform(0.93, 1.07, (len(some), 3, 1, 1))
            lift = rng.uniform(-0.05, 0.05, (len(some), 1, 1, 1))
            batch = torch.stack(
                [torch.rot90(image, int(turn), (1, 2)) for image, turn in zip(batch, turns, strict=True)]
            )
            batch = (batch * torch.from_numpy(gain).float() + torch.from_numpy(lift).float()).clamp(0, 1)
            wanted = turn_offsets(wanted, turns)
        heights = torch.from_numpy(self.train.heights[some]).float()
        return batch.to(self.device), torch.from_numpy(wanted).to(self.device), heights.to(self.device)

    def finish(self, history: History) -> Regressor:
        """Measure the weights on the held-out frames and write them, then their record."""
        from safetensors.torch import save

        # the weights as bytes, and the camera they were trained with
        state = {name: value.detach().cpu().contiguous() for name, value in self.module.state_dict().items()}
        content, settings = save(state), self.config.record()
        about = self.sets[0].about
        camera = about.camera
        # horizontal field of view of a pinhole: 2 · atan(width / 2 / f)
        fov = round(float(2 * np.degrees(np.arctan(camera["width"] / 2 / camera["fx"]))), 6)
        record = RegressorRecord(
            name=self.file.stem, arch=self.config.arch, outputs=3 if self.config.uncertainty else 2,
            pool=self.config.pool,
            image_px=int(camera["width"]), fov_deg=fov, mean=IMAGENET_MEAN, std=IMAGENET_STD,
            pad=about.pad, pad_sha256=about.pad_sha256, size_m=about.size_m,
            started_from=f"{self.init.name} {self.init.sha256[:16]}", data=_describe_sets(self.sets, len(self.chosen)),
            settings=settings | {"seed": self.seed}, final=history.recent(self.recent), held_out=[],
            inputs_sha256=self.key, sha256=sha256_bytes(content), toolkit_version=__version__,
        )  # fmt: skip
        regressor = Regressor(record, freeze(self.module, self.device), self.device)
        # the predicted deviation is scaled once, on images that were kept out of training for it
        if self.config.uncertainty:
            scale = calibrate(regressor, self.train, self.calibration)
            record = record.model_copy(update={"sigma_scale": scale})
        rows = measure_errors(regressor, self.sets)
        record = record.model_copy(update={"held_out": rows})
        write_bytes(self.file, content)
        write_json(self.file.with_suffix(".json"), record.model_dump(mode="json"))
        return Regressor(record, regressor.module, self.device)


def turn_offsets(offsets: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """(n, 2) x right and y down after (n,) quarter turns of the picture, counter-clockwise as `rot90` makes them."""
    x, y = offsets.T
    turned = np.array([(x, y), (y, -x), (-x, -y), (-y, x)])
    return turned[turns % 4, :, np.arange(len(offsets))].astype(np.float32)


def _describe_sets(sets: Sequence[LoadedSet], n: int) -> dict[str, Any]:
    """The data in a record: of a set, or of each below `sets`."""
    rows = [
        {INPUTS: loaded.about.inputs_sha256, "seed": loaded.about.seed, "world": loaded.about.world,
         "world_seed": loaded.about.world_seed, "places": loaded.about.places}
        for loaded in sets
    ]  # fmt: skip
    if len(sets) == 1:
        return rows[0] | {"n": n}
    named = [row | {"name": loaded.name, "n": len(loaded.train.truths)} for loaded, row in zip(sets, rows, strict=True)]
    return {"sets": named, "world": ", ".join(dict.fromkeys(loaded.about.world for loaded in sets)), "n": n}


def measure_errors(regressor: Regressor, sets: Sequence[LoadedSet]) -> list[ErrorRow]:
    """Errors of a regressor on held-out frames; of several sets together, then of each."""
    samples = join_samples([loaded.held_out for loaded in sets])
    parts = []
    with progress("Testing on held-out frames", len(samples.truths)) as bar:
        for start in range(0, len(samples.truths), 64):
            some = samples.images[start : start + 64]
            parts.append(regressor.predict(some))
            bar.advance(len(some))
    answers = np.concatenate(parts)
    rows = summarise_errors(answers, samples)
    if len(sets) > 1:
        ends = np.cumsum([len(loaded.held_out.truths) for loaded in sets])[:-1]
        for data_set, own in zip(sets, np.split(answers, ends), strict=True):
            rows.append(
                summarise_errors(own, data_set.held_out)[0].model_copy(update={"by": "data", "group": data_set.name})
            )
    return rows


def calibrate(regressor: Regressor, samples: SampleSet, chosen: np.ndarray) -> float:
    """Factor on the standard deviation under which errors have the spread that is said, on frames not trained on."""
    plain = Regressor(regressor.record.model_copy(update={"sigma_scale": 1.0}), regressor.module, regressor.device)
    answers = plain.answer(samples.images[chosen])
    scaled = (answers[:, :2] - samples.offsets[chosen]) / answers[:, 2:]
    return float(np.sqrt((scaled**2).mean()))


def export_onnx(regressor: Regressor, file: Path) -> Path:
    """Write the network, normalisation within, as ONNX: `image` (n, 3, h, w) in [0, 1] to `offset` (n, outputs).

    Raises:
        ToolkitError: onnx is not installed.
    """

    class Whole(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.network = regressor.module

        def forward(self, image: torch.Tensor) -> torch.Tensor:
            return run_network(self.network, image, regressor.record.mean, regressor.record.std)

    side = regressor.record.image_px
    with TemporaryDirectory() as folder:
        made = Path(folder) / "network.onnx"
        try:
            torch.onnx.export(
                Whole().eval(), (torch.rand(1, 3, side, side),), str(made), input_names=["image"],
                output_names=["offset"], dynamic_axes={"image": {0: "n"}, "offset": {0: "n"}}, dynamo=False,
            )  # fmt: skip
        except ImportError as error:
            raise ToolkitError(f"ONNX export needs {error.name}: pip install onnx") from None
        return write_bytes(file, made.read_bytes())
