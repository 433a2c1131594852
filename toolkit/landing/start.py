"""Where a regressor's training starts: published weights, and a last layer in closed form."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.console import notice
from toolkit.core.errors import FieldError
from toolkit.landing.config import Pool
from toolkit.landing.regressor import build_module
from toolkit.models.load import bundled_file, read_bundled
from toolkit.models.weights import WeightsFile, find_local, find_weights, open_weights, read_state_dict
from toolkit.training.classifier_task import load_tensors

if TYPE_CHECKING:
    from torch import nn

RIDGE = 0.05
"""Of the ridge regression, per frame, on standardised features."""


def find_start(arch: str, init: Path | None) -> WeightsFile:
    """The weights to start from: those that are named, ImageNet's, or where there are none the bundled network's."""
    if init is not None:
        return find_weights(arch, init)
    bundled, record = bundled_file(), read_bundled()
    if find_local(arch) is None and bundled is not None and record is not None and record.arch == arch:
        notice(f"no weights of {arch} on this machine: starting from the bundled network {record.name}")
        return open_weights(bundled, record.name)
    return find_weights(arch)


def start_module(arch: str, outputs: int, pool: Pool, *, image_px: int, init: WeightsFile, seed: int) -> "nn.Module":
    """A network with weights, all but the last layer's, which is drawn by the seed.

    Raises:
        ToolkitError: the weights are of another network.
    """
    import torch

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        module = build_module(arch, outputs, pool, image_px)
    own, given = module.state_dict(), read_state_dict(init)
    fitting = {name: value for name, value in given.items() if name in own and value.shape == own[name].shape}
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
    mean, spread = features.mean(axis=0), features.std(axis=0) + 1e-6
    rows = np.column_stack([(features - mean) / spread, np.ones(len(features))]).astype(np.float64) * weight[:, None]
    wanted = offsets * weight[:, None]
    penalty = np.full(rows.shape[1], RIDGE * len(rows))
    penalty[-1] = 1e-9
    found = np.linalg.solve(rows.T @ rows + np.diag(penalty), rows.T @ wanted)
    residual = float(np.sqrt(np.square((rows @ found - wanted) / weight[:, None]).mean()))
    weights = found[:-1] / spread[:, None]
    return weights, found[-1] - mean @ weights, residual
