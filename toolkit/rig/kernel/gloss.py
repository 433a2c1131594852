"""How surfaces mirror light: GGX for the key light, the split-sum approximation for what is all around."""

import math

from toolkit.rig.kernel.compiled import inlined
from toolkit.rig.kernel.lanes import exp2


@inlined
def key_lobe(
    normal_light: float, normal_view: float, normal_half: float, view_half: float, alpha: float
) -> tuple[float, float]:
    """A key light's mirrored radiance per irradiance, but for Fresnel's term: that is f0 + (1 - f0) · the second value.

    GGX with Smith's masking (Walter et al. 2007; Schlick's form of the masking, k = alpha / 2), times the cosine
    towards the light.

    Args:
        normal_light, normal_view, normal_half, view_half: cosines between the normal, the light, the way back to the
            camera and the half vector.
        alpha: roughness squared, widened by the light's size.
    """
    alpha2 = alpha * alpha
    # D = alpha² / (pi d²), GGX's distribution; G / (4 n·l n·v) is folded into `masking`
    d = normal_half * normal_half * (alpha2 - 1) + 1
    k = alpha / 2
    masking = (normal_view * (1 - k) + k) * (normal_light * (1 - k) + k)
    grazing = 1 - view_half
    # Schlick's (1 - cosine)^5
    square = grazing * grazing
    return alpha2 * normal_light / (4 * math.pi * d * d * masking), square * square * grazing


@inlined
def environment_brdf(roughness: float, cosine: float) -> tuple[float, float]:
    """(scale, bias) of f0 for even light from all around: Karis' fit (Physically Based Shading on Mobile, 2014)."""
    a, b = 1 - roughness, 0.0425 - 0.0275 * roughness
    c, d = 1.04 - 0.572 * roughness, 0.022 * roughness - 0.04
    a004 = min(a * a, exp2(-9.28 * cosine)) * a + b
    return c - 1.04 * a004, d + 1.04 * a004
