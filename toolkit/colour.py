"""Between sRGB-encoded values and linear light (IEC 61966-2-1)."""

import numpy as np


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """sRGB-encoded [0, 1] to linear [0, 1], any shape, float32."""
    encoded = np.asarray(encoded, np.float32)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** np.float32(2.4))


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear to sRGB-encoded [0, 1], any shape, float32; values outside [0, 1] are clipped."""
    linear = np.clip(np.asarray(linear, np.float32), 0, 1)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** np.float32(1 / 2.4) - 0.055)
