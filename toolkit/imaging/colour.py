"""Convert between sRGB-encoded values and linear light (IEC 61966-2-1), and measure colour differences."""

import numpy as np


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """Decode sRGB in [0, 1] to linear light, any shape, float32."""
    encoded = np.asarray(encoded, np.float32)
    # the standard's two parts: a straight line near black, a power above it
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** np.float32(2.4))


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """Encode linear light as sRGB, any shape, float32; values are clipped to [0, 1]."""
    linear = np.clip(np.asarray(linear, np.float32), 0, 1)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** np.float32(1 / 2.4) - 0.055)


LINEAR_OF_CODE = srgb_to_linear(np.arange(256) / 255)
"""(256,) float32 linear light of each 8-bit sRGB code."""
WHITE_D65 = np.array([0.95047, 1.0, 1.08883])
XYZ_OF_LINEAR_SRGB = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
"""IEC 61966-2-1, D65."""
ADOBE_GAMMA = 563 / 256
LINEAR_SRGB_OF_ADOBE = np.array(
    [[1.3983557, -0.3983557, 0.0], [0.0, 1.0, 0.0], [0.0, -0.0429290, 1.0429290]], np.float32
)
"""Adobe RGB (1998): the primaries but for green's, and the white, are sRGB's."""
LINEAR_SRGB_OF_P3 = np.array(
    [[1.2249402, -0.2249402, 0.0], [-0.0420570, 1.0420570, 0.0], [-0.0196376, -0.0786361, 1.0982735]], np.float32
)
LINEAR_SRGB_OF_BT2020 = np.array(
    [[1.6604910, -0.5876411, -0.0728499], [-0.1245505, 1.1328999, -0.0083494], [-0.0181508, -0.1005789, 1.1187297]],
    np.float32,
)
SAME_PRIMARIES = np.eye(3, dtype=np.float32)
PRIMARIES = {9: LINEAR_SRGB_OF_BT2020, 12: LINEAR_SRGB_OF_P3}
"""By their number in ITU-T H.273: those of BT.2020 and of Display P3 (SMPTE EG 432-1), both with sRGB's white."""
ROWS_AT_ONCE = 256


def adobe_to_srgb(codes: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 of Adobe RGB (1998) as uint8 sRGB; what sRGB cannot show is cut."""
    return rgb_to_srgb(codes, LINEAR_SRGB_OF_ADOBE, ADOBE_GAMMA)


def rgb_to_srgb(codes: np.ndarray, matrix: np.ndarray = SAME_PRIMARIES, gamma: float | None = None) -> np.ndarray:
    """(h, w, 3) uint8 of other primaries and another tone curve as uint8 sRGB; what sRGB cannot show is cut.

    Args:
        matrix: (3, 3) float32 to linear sRGB.
        gamma: the power of a code that is its light, 1 for linear light; None: sRGB's curve.
    """
    light = LINEAR_OF_CODE if gamma is None else (np.arange(256, dtype=np.float32) / 255) ** np.float32(gamma)
    code_of_light = np.round(linear_to_srgb(np.arange(65536) / 65535) * 255).astype(np.uint8)
    converted = np.empty_like(codes)
    for start in range(0, len(codes), ROWS_AT_ONCE):  # a whole photograph would take twelve bytes a value
        part = light[codes[start : start + ROWS_AT_ONCE]] @ matrix.T
        converted[start : start + ROWS_AT_ONCE] = code_of_light[(np.clip(part, 0, 1) * 65535 + 0.5).astype(np.uint16)]
    return converted


POW25_7 = 25.0**7


def lab_of_linear(linear: np.ndarray) -> np.ndarray:
    """(..., 3) L*a*b* of linear sRGB, relative to the adapted white D65 (CIE 15:2004)."""
    xyz = np.maximum(np.asarray(linear, float), 0) @ XYZ_OF_LINEAR_SRGB.T / WHITE_D65
    # the cube root, and its tangent near black (CIE 15:2004, 8.2.1)
    root = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def delta_e2000(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(...) ΔE00 of L*a*b* colours (..., 3); 1 is about the least that is seen side by side.

    Source: Sharma, Wu and Dalal (2005), "The CIEDE2000 color-difference formula", whose test pairs it meets.
    """
    l1, a1, b1 = np.moveaxis(np.asarray(one, float), -1, 0)
    l2, a2, b2 = np.moveaxis(np.asarray(other, float), -1, 0)
    mean_chroma = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    # a* is stretched where colours are nearly grey (equations 4 to 7)
    stretch = 1 + 0.5 * (1 - np.sqrt(mean_chroma**7 / (mean_chroma**7 + POW25_7)))
    c1, c2 = np.hypot(stretch * a1, b1), np.hypot(stretch * a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, stretch * a)) % 360 for a, b in ((a1, b1), (a2, b2)))
    # differences and means of hue the short way round; a grey has none (10, 14)
    grey = c1 * c2 == 0
    turn = np.where(grey, 0.0, (h2 - h1 + 180) % 360 - 180)
    turn = np.where(turn == -180, 180.0, turn)  # h2 - h1 of exactly half a turn counts upwards
    far = np.abs(h1 - h2) > 180
    hue = np.where(grey, h1 + h2, (h1 + h2) / 2 + np.where(far, np.where(h1 + h2 < 360, 180, -180), 0))
    light, chroma = (l1 + l2) / 2, (c1 + c2) / 2
    # how the weight of hue differs from hue to hue (15)
    shape = (
        1 - 0.17 * np.cos(np.radians(hue - 30)) + 0.24 * np.cos(np.radians(2 * hue))
        + 0.32 * np.cos(np.radians(3 * hue + 6)) - 0.20 * np.cos(np.radians(4 * hue - 63))
    )  # fmt: skip
    d_light = (l2 - l1) / (1 + 0.015 * (light - 50) ** 2 / np.sqrt(20 + (light - 50) ** 2))
    d_chroma = (c2 - c1) / (1 + 0.045 * chroma)
    d_hue = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn / 2)) / (1 + 0.015 * chroma * shape)
    # blues are turned: chroma and hue are not independent there (16, 17, 21)
    blue = np.sin(np.radians(60 * np.exp(-(((hue - 275) / 25) ** 2))))
    rotation = -2 * np.sqrt(chroma**7 / (chroma**7 + POW25_7)) * blue
    return np.sqrt(np.maximum(d_light**2 + d_chroma**2 + d_hue**2 + rotation * d_chroma * d_hue, 0))
