"""What a regressor looks at: the gradient of its answer with respect to each pixel of the picture."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from toolkit.core.files import write_bytes
from toolkit.evaluation.figures import SKY
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.landing.dataset import Sample, open_dataset, read_shard
from toolkit.landing.regressor import Regressor, as_batch

SHOWN = 6


def find_saliency(regressor: Regressor, images: np.ndarray) -> np.ndarray:
    """(n, h, w) length of the gradient of x and y with respect to each pixel's colour, from (n, h, w, 3) uint8 sRGB.

    Metres per unit of sRGB-encoded light.
    """
    import torch

    batch = as_batch(images).requires_grad_(True)
    answers = regressor.outputs(batch)
    squares = sum(torch.autograd.grad(answers[:, k].sum(), batch, retain_graph=k == 0)[0].square() for k in range(2))
    assert isinstance(squares, torch.Tensor)
    return squares.sum(dim=1).sqrt().cpu().numpy()


def pick_samples(folder: Path, count: int = SHOWN) -> list[Sample]:
    """Held-out frames of a data set's first shard of them, from low to high, evenly spread over their heights."""
    about = open_dataset(folder)
    shard = next((shard for shard in about.shards if shard.split == "held_out"), about.shards[0])
    samples = sorted(read_shard(folder / shard.file), key=lambda sample: sample.truth.z_m)
    chosen = np.linspace(0, len(samples) - 1, min(count, len(samples))).round().astype(int)
    return [samples[k] for k in chosen]


@with_default_style
def draw_saliency(regressor: Regressor, samples: Sequence[Sample]) -> tuple[bytes, list[float]]:
    """PNG of frames with what the regressor looks at below each; and the share of it that lies on the pad."""
    saliency = find_saliency(regressor, np.stack([sample.image for sample in samples]))
    shares = [float(one[sample.mask].sum() / one.sum()) for one, sample in zip(saliency, samples, strict=True)]
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
        The share of each that lies on the pad, from low to high.
    """
    content, shares = draw_saliency(regressor, pick_samples(dataset))
    write_bytes(file, content)
    return shares
