"""A network that says where the pad is: two numbers from a picture; its record, its file, and what it looks at."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field

from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import read_json, sha256_file, write_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.imaging.style import SKY
from toolkit.models.architectures import build_network
from toolkit.models.predict import ask_in_parts
from toolkit.models.weights import WeightsFile, read_state_dict
from toolkit.rooms.landing.config import CameraConfig, Pool
from toolkit.rooms.landing.dataset import Sample, SampleSet, find_shard, open_dataset, read_shard
from toolkit.rooms.worlds.conditions import name_weather
from toolkit.training.classifier_task import load_tensors

SUFFIX = ".safetensors"
PART = 16
"""Pictures in a pass, as `toolkit.models.predict` has them."""
STRIDE = 32
"""Stride of the last features of a ResNet, pixels."""
SHOWN = 6


class ErrorRow(BaseModel):
    """Errors of a group of held-out frames.

    Attributes:
        by, group: what they have in common, such as `height` and `2-4 m`.
        n: frames; `found` of them were answered.
        rmse_cm, median_cm: of the distance between answer and truth.
        share: mean of that distance as a share of the height.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    by: str
    group: str
    n: int
    found: int
    rmse_cm: float | None
    median_cm: float | None
    share: float | None


class RegressorRecord(BaseModel):
    """How a regressor came to be, and how to feed and read it.

    Attributes:
        name: name of the file.
        arch: architecture of the network.
        outputs: 2 (x, y), or 3 with the logarithm of the uncertainty.
        pool: pooling before the last layer, see `build_module`.
        image_px, fov_deg: size and field of view of its input images.
        mean, std: normalisation, sRGB-encoded.
        sigma_scale: factor on the uncertainty, from held-out frames; None without an uncertainty.
        pad, pad_sha256, size_m: pad of the training, hash of its file, and its side.
        started_from: initial weights.
        data: inputs, seed, world and places of the data set; several sets are below `sets`.
        settings: all training settings.
        final: means of the last steps.
        held_out: errors on held-out frames; the first row has all frames.
        baselines: errors of other methods, by name.
        sha256: hash of the weights' file.
        toolkit_version: version of the program that trained it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: int = 1
    name: str
    arch: str
    outputs: int = Field(ge=2, le=3)
    pool: Pool = "average"
    image_px: int = Field(gt=0)
    fov_deg: float
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    sigma_scale: float | None = None
    pad: str
    pad_sha256: str
    size_m: float
    started_from: str
    data: dict[str, Any]
    settings: dict[str, Any]
    final: dict[str, float]
    held_out: list[ErrorRow]
    baselines: dict[str, list[ErrorRow]] = {}
    inputs_sha256: str
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    toolkit_version: str


@dataclass(frozen=True)
class Regressor:
    """A trained network that is ready to use."""

    record: RegressorRecord  # see `RegressorRecord`
    module: torch.nn.Module  # in eval mode, its parameters without gradient
    device: str = "cpu"  # where it runs

    @property
    def name(self) -> str:
        """Name of its file without the suffix."""
        return self.record.name

    def outputs(self, batch: torch.Tensor) -> torch.Tensor:
        """(b, 2 or 3) from (b, 3, h, w) sRGB-encoded in [0, 1]; normalises inside, differentiable."""
        return run_network(self.module, batch.to(self.device), self.record.mean, self.record.std)

    def predict(self, images: np.ndarray) -> np.ndarray:
        """(n, 2) float64 the pad's x and y in the camera's frame, metres, from (n, h, w, 3) uint8 sRGB.

        The answer to a picture has the same bytes whatever it is asked together with.
        """
        return self.answer(images)[:, :2]

    def answer(self, images: np.ndarray) -> np.ndarray:
        """(n, 3) float64 x, y and standard deviation of each, metres; NaN for a network without uncertainty."""
        if images.shape[1:3] != (self.record.image_px, self.record.image_px):
            raise ToolkitError(
                f"{self.name} takes pictures of {self.record.image_px} px, found {images.shape[2]} × {images.shape[1]}"
            )

        # frames are asked in parts of fixed size, so an answer does not depend on how many there are
        def ask(chosen: list[int]) -> torch.Tensor:
            with torch.inference_mode():
                return self.outputs(as_batch(images[chosen])).double().cpu()

        found = np.full((len(images), 3), np.nan)
        if len(images):
            out = torch.cat(ask_in_parts(ask, len(images), self.device, part=PART)).numpy()
            found[:, :2] = out[:, :2]
            if self.record.sigma_scale is not None:
                # the network gives the logarithm of the deviation, so that it is positive
                found[:, 2] = np.exp(out[:, 2]) * self.record.sigma_scale
        return found

    def check(self, optics: CameraConfig) -> None:
        """Raise a `ToolkitError` if a camera differs from that of its training."""
        if (optics.image_px, optics.fov_deg) != (self.record.image_px, self.record.fov_deg):
            raise FieldError(
                f"{self.name} was trained on pictures of {self.record.image_px} px and {self.record.fov_deg:g}°: "
                "use these, or train another",
                {"optics.image_px": optics.image_px, "optics.fov_deg": optics.fov_deg},
            )


def build_module(arch: str, outputs: int, pool: Pool, image_px: int) -> torch.nn.Module:
    """A network with random weights whose last layer has some outputs.

    Args:
        pool: what that sees: the features' `average`, as in the paper; or the `grid` of them as it lies over the
            picture, so that where something is needs not be coded in what it is. For ResNets.

    Raises:
        FieldError: a grid of a network that is no ResNet.
    """
    module = build_network(arch, outputs)
    if pool == "grid":
        if not arch.startswith(("resnet", "wide_resnet", "resnext")):
            raise FieldError("grid is for ResNets: take average", {"pool": pool, "arch": arch})
        # without the mean over places, which says what is seen but not where
        last, cells = module.get_submodule("fc"), (-(-image_px // STRIDE)) ** 2
        assert isinstance(last, torch.nn.Linear)
        module.avgpool = torch.nn.Identity()
        module.fc = torch.nn.Linear(last.in_features * cells, outputs)
    return module


def as_batch(images: np.ndarray) -> torch.Tensor:
    """(n, 3, h, w) float32 in [0, 1] of (n, h, w, 3) uint8."""
    return torch.from_numpy(np.ascontiguousarray(images.transpose(0, 3, 1, 2))).float().div_(255)


def run_network(
    module: torch.nn.Module, batch: torch.Tensor, mean: tuple[float, ...], std: tuple[float, ...]
) -> torch.Tensor:
    """Outputs for (b, 3, h, w) in [0, 1]."""
    middle, spread = (batch.new_tensor(values).view(1, 3, 1, 1) for values in (mean, std))
    return module(((batch - middle) / spread).contiguous(memory_format=torch.channels_last))


def regressors_dir(space: Workspace) -> Path:
    """Folder of a workspace's regressors."""
    return space.classifiers_dir.parent / "regressors"


def list_regressors(space: Workspace) -> dict[str, Path]:
    """Weights by name."""
    return {path.stem: path for path in sorted(regressors_dir(space).glob(f"*{SUFFIX}"))}


def load_regressor(space: Workspace, name: str, device: str = "cpu") -> Regressor:
    """A regressor of the workspace by its name, or by its file.

    Raises:
        ToolkitError: there is none, or its weights are not those of its record, or of another network or outputs.
    """
    own = list_regressors(space)
    file = own.get(name) or Path(name)
    if not (file.is_file() and file.suffix == SUFFIX):
        if not own:
            raise ToolkitError(f"no regressor called '{name}': there is none yet: run 'toolkit landing train'")
        raise one_of("regressor", name, list(own))
    record_file = file.with_suffix(".json")
    if not record_file.is_file():
        raise ToolkitError(f"{file}: no record {record_file.name} beside it: copy both, or train it again")
    record, digest = read_json(record_file, RegressorRecord), sha256_file(file)
    if digest != record.sha256:
        raise ToolkitError(
            f"{file}: its hash {digest[:12]} is not the {record.sha256[:12]} of {record_file.name}: the weights are of "
            "another regressor, or damaged: restore the pair, or train again"
        )
    # the hash is checked before the weights are opened
    state = read_state_dict(WeightsFile(file, digest, file.name))
    # random weights are replaced at once: drawing them must not move the caller's generator
    with torch.random.fork_rng(devices=[]):
        module = build_module(record.arch, record.outputs, record.pool, record.image_px)
    expected = module.state_dict()
    # every tensor must fit, or a part of the network would stay random
    wrong = [key for key, value in expected.items() if key not in state or state[key].shape != value.shape]
    if wrong:
        raise ToolkitError(
            f"{file}: its weights are not those of {record.arch} with {record.outputs} outputs ('{wrong[0]}' differs)"
        )
    load_tensors(module, state)
    return Regressor(record, freeze(module, device), device)


def freeze(module: torch.nn.Module, device: str) -> torch.nn.Module:
    """In eval mode, without gradients, channels last."""
    return module.eval().requires_grad_(False).to(device=device, memory_format=torch.channels_last)  # type: ignore[call-overload]


HEIGHT_EDGES, ANGLE_EDGES = (0.0, 1.0, 2.0, 4.0, 7.0, np.inf), (0.0, 5.0, 10.0, 15.0, 20.0, np.inf)


def summarise_errors(answers: np.ndarray, samples: SampleSet) -> list[ErrorRow]:
    """Rows for all, by height, by angle off the vertical, and by weather.

    Args:
        answers: (n, 2) metres; NaN where the pad was not found.
    """
    # the distance between answer and truth on the ground, metres
    errors = np.linalg.norm(answers - samples.offsets, axis=1)
    heights = samples.heights
    # the angle between the vertical and the line from the drone to the pad
    angles = np.degrees(np.arctan2(np.linalg.norm(samples.offsets, axis=1), heights))
    rows = [_row("all", "all", errors, heights)]
    # rows of bins without a sample are left out
    for by, values, edges, unit in (("height", heights, HEIGHT_EDGES, " m"), ("angle", angles, ANGLE_EDGES, "°")):
        for low, high in pairwise(edges):
            within = (values >= low) & (values < high)
            name = f"over {low:g}{unit}" if np.isinf(high) else f"{low:g}-{high:g}{unit}"
            if within.any():
                rows.append(_row(by, name, errors[within], heights[within]))
    weathers = [name_weather(truth.weather, truth.severity) for truth in samples.truths]
    for weather in sorted(set(weathers)):
        within = np.array([kind == weather for kind in weathers])
        rows.append(_row("weather", weather, errors[within], heights[within]))
    return rows


def _row(by: str, group: str, errors: np.ndarray, heights: np.ndarray) -> ErrorRow:
    found = np.isfinite(errors)
    some = errors[found]
    if not len(some):
        return ErrorRow(by=by, group=group, n=len(errors), found=0, rmse_cm=None, median_cm=None, share=None)
    return ErrorRow(
        by=by, group=group, n=len(errors), found=len(some), rmse_cm=round(100 * float(np.sqrt((some**2).mean())), 3),
        median_cm=round(100 * float(np.median(some)), 3), share=round(float((some / heights[found]).mean()), 5),
    )  # fmt: skip


def find_saliency(regressor: Regressor, images: np.ndarray) -> np.ndarray:
    """(n, h, w) length of the gradient of x and y with respect to each pixel's colour, from (n, h, w, 3) uint8 sRGB.

    Metres per unit of sRGB-encoded light.
    """
    batch = as_batch(images).requires_grad_(True)
    answers = regressor.outputs(batch)
    # pictures of a batch do not meet: the gradient of a sum over them holds that of each picture
    squares = sum(torch.autograd.grad(answers[:, k].sum(), batch, retain_graph=k == 0)[0].square() for k in range(2))
    assert isinstance(squares, torch.Tensor)
    return squares.sum(dim=1).sqrt().cpu().numpy()


def pick_samples(folder: Path) -> list[Sample]:
    """Held-out frames of a data set's first shard of them, from low to high, evenly spread over their heights."""
    about = open_dataset(folder)
    shards = [shard for shard in about.shards if shard.split == "held_out"] or about.shards
    if not shards:
        raise ToolkitError(f"{folder} has no shards: collect the data set again")
    samples = sorted(
        read_shard(find_shard(folder, about, shards[0]), about.size_px), key=lambda sample: sample.truth.z_m
    )
    chosen = np.linspace(0, len(samples) - 1, min(SHOWN, len(samples))).round().astype(int)
    return [samples[k] for k in chosen]


@with_default_style
def draw_saliency(regressor: Regressor, samples: Sequence[Sample]) -> tuple[bytes, list[float]]:
    """PNG of frames with what the regressor looks at below each; and the share of it on the pad."""
    # the share of saliency on the pad, beside the share of the picture that the pad takes
    saliency = find_saliency(regressor, np.stack([sample.image for sample in samples]))
    shares = [float(heat[sample.mask].sum() / heat.sum()) for heat, sample in zip(saliency, samples, strict=True)]
    figure = make_figure(1.9 * len(samples), 4.6)
    rows = figure.subplots(2, len(samples), squeeze=False)
    for k, sample in enumerate(samples):
        rows[0][k].imshow(sample.image)
        rows[0][k].set_title(f"{sample.truth.z_m:.1f} m", fontsize=9)
        rows[1][k].imshow(saliency[k] / saliency[k].max(), cmap="inferno")
        rows[1][k].contour(sample.mask, levels=[0.5], colors=SKY, linewidths=0.8)
        rows[1][k].set_title(f"{shares[k]:.0%} on the pad,\n{sample.mask.mean():.0%} of the area", fontsize=8)
        for panel in rows[:, k]:
            panel.set_axis_off()
    return encode_figure(figure), shares


def write_saliency(regressor: Regressor, dataset: Path, file: Path) -> list[float]:
    """Write `draw_saliency` of some held-out frames of a data set.

    Returns:
        The share of each on the pad, from low to high.
    """
    content, shares = draw_saliency(regressor, pick_samples(dataset))
    write_bytes(file, content)
    return shares
