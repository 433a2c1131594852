"""How a camera develops light: tone curve, lens falloff, sensor noise; what a view takes from a texture, linearly."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from toolkit.core.files import sha256_bytes
from toolkit.imaging.colour import linear_to_srgb, srgb_to_linear
from toolkit.rig.camera import Camera
from toolkit.rig.kernel.develop import develop

SHOULDER = 0.72
"""Linear value above which highlights are compressed."""
NOISE, FALLOFF = 0.006, 0.12
"""Sensor noise and light fall-off of the camera, see `tone_map`."""


def tone_map(picture: np.ndarray, seed: tuple[int, ...], noise: float = NOISE, falloff: float = FALLOFF) -> np.ndarray:
    """(h, w, 3) uint8 sRGB of linear light in exposure units.

    Args:
        picture: (h, w, 3) float32 linear, 1 is white.
        seed: of the noise; pairs of images share it, as it has no part in what they compare.
        noise: standard deviation at middle grey, growing with the root of the light as photons' does.
        falloff: share of the light that the corners lose.
    """
    row = np.empty((1, picture.shape[1], 3), np.float32)
    return _develop(picture, row, stream_state(seed), noise, falloff)


def stream_state(seed: tuple[int, ...]) -> np.ndarray:
    """(6,) uint64 where `numpy.random.default_rng(seed)` begins, as kernels draw from it."""
    state = np.random.default_rng(seed).bit_generator.state["state"]
    # PCG64 holds two numbers of 128 bits; kernels know no type so wide
    halves = [part >> shift & 2**64 - 1 for part in (state["state"], state["inc"]) for shift in (64, 0)]
    return np.array([*halves, 0, 0], np.uint64)


def draw_grain(shape: tuple[int, ...], seed: tuple[int, ...]) -> np.ndarray:
    """(h, w, 3) float32 standard normal; pictures that share their grain need it drawn once."""
    return np.random.default_rng(seed).standard_normal(shape, dtype=np.float32)


def develop_light(picture: np.ndarray, grain: np.ndarray, noise: float = NOISE, falloff: float = FALLOFF) -> np.ndarray:
    """`tone_map` with a grain that was drawn before."""
    return _develop(picture, grain, np.zeros(0, np.uint64), noise, falloff)


def _develop(picture: np.ndarray, grain: np.ndarray, state: np.ndarray, noise: float, falloff: float) -> np.ndarray:
    coded, width = np.empty(picture.shape, np.uint8), 3 * picture.shape[1]
    light, given, codes = (
        array.reshape(len(array), width) for array in (np.ascontiguousarray(picture, np.float32), grain, coded)
    )
    work = np.empty((2, width))
    lower, starts = _CODES
    # a whole number would be another type, for which numba compiles `develop` again and changes its kept machine code
    develop(
        light, given, state, noise=noise * 0.18 / 0.4, falloff=float(falloff), shoulder=SHOULDER,
        lower=lower, starts=starts, work=work, coded=codes,
    )  # fmt: skip
    return coded


BANDS = 4096


def _make_codes() -> tuple[np.ndarray, np.ndarray]:
    """The sRGB code of the lower end of each of `BANDS` of [0, 1], and the light at which the next code starts."""
    # rounding to the nearest code: the next begins halfway, in codes
    starts = srgb_to_linear((np.arange(1, 257) - 0.5) / 255).astype(np.float32)
    # nothing comes after 255
    starts[-1] = np.inf
    lower = np.round(linear_to_srgb(np.arange(BANDS + 1) / BANDS) * 255).astype(np.uint8)
    return lower, starts


_CODES = _make_codes()


@dataclass(frozen=True)
class DepthBuffer:
    """How far away everything in a view is, for weather that is laid over it."""

    # (h, w) float32 distance along the ray through each pixel's centre, in the mesh's unit; inf for the sky
    depth: np.ndarray
    camera: Camera  # of h × w pixels
    T_world_camera: np.ndarray  # (4, 4) its pose, in the same unit

    def scaled(self, metres_per_unit: float) -> "DepthBuffer":
        """The same of what a model stands for, in metres."""
        pose = self.T_world_camera.copy()
        pose[:3, 3] *= metres_per_unit
        return DepthBuffer((self.depth * metres_per_unit).astype(np.float32), self.camera, pose)

    def cropped(self, left: int, top: int, side: int) -> "DepthBuffer":
        """A square of the same view."""
        depth, camera = self.depth[top : top + side, left : left + side], self.camera.cropped(left, top, side, side)
        return DepthBuffer(depth, camera, self.T_world_camera)


@dataclass(frozen=True)
class LinearView:
    """One view of h × w pixels; light is linear, in exposure units."""

    # (h, w, 3) float32 table and room without the object, its shadow included; 0 where it covers the pixel
    behind: np.ndarray
    dark: np.ndarray  # (h, w, 3) float32 the object with a black material: gloss, and parts that keep their paint
    coverage: np.ndarray  # (h, w) float32 share of each pixel that shows the object
    pixel: np.ndarray  # (k,) int32 which pixel a sample of the material counts for, row · w + column
    # (k, 2) float32 its place on the material's texture, u right and v up; outside [0, 1] that repeats
    uv: np.ndarray
    lod: np.ndarray  # (k,) float32 base-2 logarithm of the texture's texels per pixel there
    gain: np.ndarray  # (k, 3) float32 light that white texels bring to the pixel
    depth: DepthBuffer | None = None  # of what is seen, where it was asked for
    bare: np.ndarray | None = None  # (h, w, 3) float16 light of the object without a booster, where it was asked for
    # another renderer's (h, w, 3) float32 light of this view, from the texels (n, n, 3) uint8 sRGB
    repaint: Callable[[np.ndarray], np.ndarray] | None = None

    @property
    def share(self) -> np.ndarray:
        """(k,) share of its pixel that each sample stands for: those of a pixel divide what the object covers of it."""
        counts = np.bincount(self.pixel, minlength=self.coverage.size)
        return self.coverage.reshape(-1)[self.pixel] / counts[self.pixel]

    @property
    def sha256(self) -> str:
        """Hash of all buffers of light."""
        arrays = (array for name, array in vars(self).items() if name not in ("depth", "bare", "repaint"))
        return sha256_bytes("".join(sha256_bytes(array.tobytes()) for array in arrays).encode())

    def packed(self) -> "LinearView":
        """The same with light and shares in half precision, for views that are kept in memory."""
        half = ("behind", "dark", "coverage", "gain", "lod")
        return replace(self, **{name: getattr(self, name).astype(np.float16) for name in half})
