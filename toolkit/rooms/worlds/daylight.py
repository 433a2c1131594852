"""How bright and of what colour sun and sky are: luminance in kcd/m² and illuminance in klx, as linear sRGB.

The sky's shape and colour are Preetham, Shirley and Smits' ("A Practical Analytic Model for Daylight", 1999), and so is
what the air takes from the sun. Preetham's skies are up to twice too bright at low sun (Zotti et al. 2007), so
brightness follows measured fits: the IES's for the diffuse illuminance by day, Janiczek and DeYoung's for twilight.
"""

import numpy as np

from toolkit.imaging.colour import XYZ_OF_LINEAR_SRGB

LUMINANCE = XYZ_OF_LINEAR_SRGB[1]
LOWEST_SUN_DEG = 2.0
"""Below it the sky keeps this sun's shape; the model has no night."""
SUN_KLX = 133.8
"""Outside the air, on a surface that faces it."""
SUN_COLOUR = np.array([1.118, 0.974, 0.911])
"""Outside the air: a black body of 5800 K, of luminance 1."""
WAVELENGTHS_UM = np.array([0.61, 0.55, 0.465])
"""Wavelengths of red, green and blue, micrometres."""
OZONE_CM, OZONE_PER_CM = 0.35, np.array([0.128, 0.085, 0.008])

PEREZ = np.array([
    # slope and intercept in turbidity of A, B, C, D, E, for luminance Y and chromaticities x and y
    [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
    [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
    [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
])  # fmt: skip
ZENITH_X = np.array([
    [0.00166, -0.00375, 0.00209, 0.0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886],
])  # fmt: skip
ZENITH_Y = np.array([
    [0.00275, -0.00610, 0.00317, 0.0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688],
])  # fmt: skip


def find_zenith(sun_elevation_deg: float, turbidity: float) -> tuple[float, float, float]:
    """Luminance in kcd/m² and chromaticity x, y of the zenith, by Preetham."""
    theta = np.radians(90 - sun_elevation_deg)
    # Preetham et al. 1999, appendix A.2: zenith luminance, and chromaticities as cubics of the sun's angle
    chi = (4 / 9 - turbidity / 120) * (np.pi - 2 * theta)
    luminance = (4.0453 * turbidity - 4.9710) * np.tan(chi) - 0.2155 * turbidity + 2.4192
    powers = np.array([turbidity**2, turbidity, 1]), np.array([theta**3, theta**2, theta, 1])
    return luminance, float(powers[0] @ ZENITH_X @ powers[1]), float(powers[0] @ ZENITH_Y @ powers[1])


def clear_sky(directions: np.ndarray, sun: np.ndarray, turbidity: float) -> np.ndarray:
    """(..., 3) linear sRGB of a clear sky, kcd/m², by Preetham alone; below the horizon as at it.

    Args:
        directions: (..., 3) unit vectors.
        sun: (3,) unit vector to the sun, above the horizon.
        turbidity: 2 very clear to 8 hazy.
    """
    cosine = np.clip(directions[..., 2], 0.01, 1)
    cos_gamma = np.clip(directions @ sun, -1, 1)
    gamma = np.arccos(cos_gamma)
    zenith_angle = float(np.arccos(sun[2]))

    def perez(row: np.ndarray, cosine: np.ndarray | float, gamma: np.ndarray | float) -> np.ndarray:
        a, b, c, d, e = row @ (turbidity, 1)
        # Perez et al. 1993: a term of the angle from the zenith times a term of the angle from the sun
        return (1 + a * np.exp(b / cosine)) * (1 + c * np.exp(d * gamma) + e * np.cos(gamma) ** 2)

    zenith = find_zenith(90 - np.degrees(zenith_angle), turbidity)
    luminance, x, y = (
        high * perez(row, cosine, gamma) / perez(row, 1.0, zenith_angle)
        for high, row in zip(zenith, PEREZ, strict=True)
    )
    # xyY to XYZ
    xyz = np.stack([luminance * x / y, luminance, luminance * (1 - x - y) / y], axis=-1)
    # deep blues lie outside sRGB, where a channel is negative
    return np.maximum(xyz @ np.linalg.inv(XYZ_OF_LINEAR_SRGB).T, 0)


def find_air_mass(elevation_deg: float) -> float:
    """Return the air mass of the path to the sun, 1 at the zenith (Kasten 1965); from 0° up."""
    elevation_deg = max(elevation_deg, 0.0)
    return 1 / (np.sin(np.radians(elevation_deg)) + 0.15 * (elevation_deg + 3.885) ** -1.253)


def sunlight(elevation_deg: float, turbidity: float) -> np.ndarray:
    """(3,) linear sRGB of the sun's illuminance on a surface that faces it, klx; 0 once its disc has set."""
    mass = find_air_mass(elevation_deg)
    # Angstrom's beta from turbidity, as in Preetham's appendix
    haze = 0.04608 * turbidity - 0.04586
    # Rayleigh's scattering, Ångström's haze and ozone, as in Preetham's appendix
    lost = 0.008735 * WAVELENGTHS_UM**-4.08 + haze * WAVELENGTHS_UM**-1.3 + OZONE_PER_CM * OZONE_CM
    # the disc is 0.53° across
    above = np.clip(elevation_deg / 0.53 + 0.5, 0, 1)  # share of the disc above the horizon
    return SUN_KLX * SUN_COLOUR * np.exp(-lost * mass) * above


def diffuse_klx(sun_elevation_deg: float) -> float:
    """Illuminance of level ground by a clear sky without its sun.

    By day 0.8 + 15.5 √sin h (IES, 1984), but near the horizon and below it no more than sun and sky bring together.
    """
    by_day = 0.8 + 15.5 * float(np.sqrt(max(np.sin(np.radians(sun_elevation_deg)), 0.0)))
    return min(by_day, twilight_klx(sun_elevation_deg))


TWILIGHT = (
    (20.0, (3.74, 3.97, -4.07, 1.47)), (5.0, (3.05, 13.28, -45.98, 64.33)), (-0.8, (2.88, 22.26, -207.64, 1034.30)),
    (-5.0, (2.88, 21.81, -258.11, -858.36)), (-12.0, (2.70, 12.17, -431.69, -1899.83)),
)  # fmt: skip


def twilight_klx(sun_elevation_deg: float) -> float:
    """Illuminance of level ground by sun and sky together, from 90° to -12°.

    Janiczek and DeYoung 1987, US Naval Observatory circular 171.
    """
    x = max(sun_elevation_deg, -12.0) / 90
    terms = next((terms for low, terms in TWILIGHT if 90 * x >= low), TWILIGHT[-1][1])
    return float(10 ** sum(term * x**power for power, term in enumerate(terms))) / 1e3


def overcast_klx(sun_elevation_deg: float) -> float:
    """Illuminance of level ground below an overcast sky: 0.3 + 21 sin h (IES, 1984)."""
    return 0.3 + 21 * max(float(np.sin(np.radians(sun_elevation_deg))), 0.0)


def overcast_shape(sine: np.ndarray) -> np.ndarray:
    """Luminance over the zenith's at the sine of an elevation: (1 + 2 sin h) / 3 (Moon and Spencer 1942; CIE)."""
    return (1 + 2 * np.clip(sine, 0, 1)) / 3
