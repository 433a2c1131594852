"""Linear filters on batches of planes.

On the CPU OpenCV blurs, ten and more times as fast as torch's depthwise convolution; on a GPU, and where a gradient is
wanted, matrix products, to the same values. Large kernels go through the Fourier transform.
"""

from functools import lru_cache

import cv2
import numpy as np
import torch
from scipy.fft import next_fast_len
from torch.nn import functional

TRUNCATE = 4.0
"""Standard deviations at which a Gaussian is cut off: scikit-image's default."""


def gaussian_weights(sigma_px: float, truncate: float = TRUNCATE) -> np.ndarray:
    """(2r + 1,) float64 samples of a Gaussian that sum to 1, r = `truncate` × `sigma_px` rounded, as in SciPy."""
    radius = int(truncate * sigma_px + 0.5)
    offsets = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 * (offsets / sigma_px) ** 2)
    return weights / weights.sum()


@lru_cache(maxsize=64)
def gaussian_matrix(length: int, sigma_px: float, border: str, truncate: float = TRUNCATE) -> torch.Tensor:
    """(length, length) float32 that blurs a row of `length` values, what lies beyond the ends included.

    Args:
        length: of the row, px.
        sigma_px: standard deviation; may be larger than the row.
        border: NumPy's name of the continuation: `edge`, or `symmetric` (SciPy calls that reflect).
        truncate: standard deviations at which the Gaussian is cut off.
    """
    weights = gaussian_weights(sigma_px, truncate)
    radius = len(weights) // 2
    source = np.pad(np.arange(length), radius, mode=border)  # type: ignore[call-overload]
    matrix = np.zeros((length, length))
    rows = np.arange(length)
    for tap, weight in enumerate(weights):
        np.add.at(matrix, (rows, source[tap : tap + length]), weight)
    return torch.from_numpy(matrix.astype(np.float32))


def blur_by_matrix(planes: torch.Tensor, sigma_px: float, border: str, truncate: float = TRUNCATE) -> torch.Tensor:
    """Blur (..., h, w) float32 with a Gaussian as two matrix products: any width costs the same."""
    height, width = planes.shape[-2:]
    down = gaussian_matrix(height, sigma_px, border, truncate).to(planes.device)
    across = gaussian_matrix(width, sigma_px, border, truncate).to(planes.device)
    return down @ planes @ across.T


def blur_gaussian(planes: torch.Tensor, sigma_px: float) -> torch.Tensor:
    """Blur (b, c, h, w) float32 with a Gaussian cut off at four deviations, edge pixels repeated outwards."""
    if planes.device.type != "cpu" or planes.requires_grad:
        return blur_by_matrix(planes, sigma_px, "edge")
    weights = gaussian_weights(sigma_px)
    result = torch.empty(planes.shape)
    rows = planes.shape[-2:]
    for source, target in zip(planes.reshape(-1, *rows).numpy(), result.view(-1, *rows).numpy(), strict=True):
        cv2.sepFilter2D(source, -1, weights, weights, dst=target, borderType=cv2.BORDER_REPLICATE)
    return result


def filter_by_kernel(planes: torch.Tensor, kernel: np.ndarray) -> torch.Tensor:
    """Correlate (b, c, h, w) float32 with an odd, square `kernel`, mirrored about the edge pixels' centres.

    By the Fourier transform, where any kernel costs the same: less than in OpenCV from about 8×8 px upwards.
    """
    height, width = planes.shape[-2:]
    radius = len(kernel) // 2
    padded = functional.pad(planes, (radius,) * 4, mode="reflect")
    size = tuple(next_fast_len(length, real=True) for length in padded.shape[-2:])
    weights = torch.fft.rfft2(torch.tensor(kernel).to(planes), s=size)
    # the conjugate correlates; what wraps around stays outside of the image, on the padding
    product = torch.fft.rfft2(padded, s=size).mul_(weights.conj())
    return torch.fft.irfft2(product, s=size)[..., :height, :width]
