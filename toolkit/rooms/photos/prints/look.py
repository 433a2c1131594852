"""Model of printer, light and camera by a known patch in a photograph, to draw other patches in its place.

The model, from the file to the photograph:

1. Colour: a cube of nodes from the file's sRGB to that of a wide, evenly lit texel.

2. Light: a gain in linear light, for each channel the exponential of a quadratic in (u, v), none at the middle.

3. Place: the homography with its bend; each pixel is the mean of linear light over its square.

4. Point spread: kernels and wide Gaussians for encoded luma and chroma, by least squares on the photograph. Phones
   sharpen after their tone curve and smooth colours widely, and JPEG halves the chroma.

5. Noise: normal, its deviation by luma, blurred until neighbours are as alike as the photograph's.

Parts that the known patch does not explain (keys, fingers, tape, glare) hide it, and stay.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy import sparse

from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import LINEAR_OF_CODE, delta_e2000, lab_of_linear, linear_to_srgb, srgb_to_linear
from toolkit.rooms.photos.prints.align import Drawn, PatchWarp, cell_centres, fit_warp, follow, place_cut, sample_image
from toolkit.rooms.photos.prints.colours import cube_weights, solve_cube
from toolkit.rooms.photos.prints.find import CELL_SHOWS, PatchSighting, shrink_image

YCC = np.array([[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]])
"""Luma and chroma of JPEG (ITU-T T.871) of sRGB-encoded red, green and blue, chroma about 0."""
RGB = np.linalg.inv(YCC)
MOST_TEXELS = 3000
TEXEL_SAMPLES = (3, 8)
COLOUR_ROUNDS = 3
ROBUST_ROUNDS = 5
LEAST_TEXELS = 60
DARK = 0.02
MOST_GAIN = 0.7
"""Largest change of the logarithm of light over the patch: a corner is at most twice as bright as the middle."""
KERNEL_PX = 9
KERNEL_SAMPLES = 12_000
KERNEL_RIDGE = 1e-3
WIDE = (1 / 384, 1 / 192, 1 / 96, 1 / 48)
"""Deviations of the Gaussians beside the kernel, of the photo's shorter side: cameras smooth chroma that far."""
REFINE_PX = 600.0
MEASURED_PX = 640
REFINE_STIFFNESS = 0.005
RIPPLE_DEGREE = 5
RIPPLE_TERMS = 21
RIPPLE_PLACES = 64
LEAST_POINTS = 80
"""Smallest number of usable points among the 225 that are followed."""
RIPPLE_RIDGE = 1.0
COARSE_PX = 8
"""Step at which slow changes are computed."""
NOISE_LEVELS = 8
LEAST_OF_LEVEL = 0.03
WIDE_PX, NARROW_PX = 5, 3
FLAT_PERCENT = 25
QUARTER = 0.8
"""Lower quartile over root mean square of the deviation of some ten independent values."""
HIDES = (0.09, 5.0)
"""Least difference of what hides the patch, luma and chroma together, and its least ratio to the median of the rest."""
FEW_PX = 4.0
LEAST_HIDDEN = 6.0
"""Least hidden area, texels: smaller areas are misfits."""
FEATHER_PX = (0.5, 2.0)
WHITE_PX = 0.2


@dataclass(frozen=True)
class PrintedLook:
    """The fitted model; see the module for its form.

    Attributes:
        warp: the patch in the photo's own pixels.
        ripple: (21, 2) coefficients of `ripple_terms`: difference of (u, v) from the warp's, as paper is wavy.
        nodes: (nodes³, 3) luma and chroma of each of the cube's colours.
        light: (5, 3) coefficients of `light_terms` for red, green and blue.
        kernels: (3, 9, 9) for luma and the two chromas.
        wide: (k, 4) deviation of a Gaussian in pixels, and its weight for luma and each chroma.
        noise: (levels, 3) standard deviation of luma and chromas by level of luma.
        grain_px: (2,) deviation of the Gaussian that makes white noise as smooth as that of luma, of chroma.
        delta_e: median ΔE00 of the fitted texels.
        shown: share of the texels that are in the picture and not hidden.
    """

    warp: PatchWarp
    ripple: np.ndarray
    nodes: np.ndarray
    light: np.ndarray
    kernels: np.ndarray
    wide: np.ndarray
    noise: np.ndarray
    grain_px: np.ndarray
    delta_e: float
    shown: float

    def colours(self, pixels: np.ndarray) -> np.ndarray:
        """(n, n, 3) float sRGB-encoded colours that wide texels have at the patch's middle."""
        encoded = cube_weights(pixels.reshape(-1, 3) / 255.0) @ self.nodes @ RGB.T
        return np.clip(encoded, 0, 1).reshape(pixels.shape)


def even_texels(image: np.ndarray, sighting: PatchSighting, look: PrintedLook, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Linear light (n², 3) of each texel as a share of paper's in the same place, and (n²,) whether it shows.

    Paper is the file's white in this look: no margin is needed.
    """
    seen, trust = read_texels(image, sighting, n, look)
    light = np.exp(light_terms(cell_centres(n)) @ look.light)
    white = srgb_to_linear(look.colours(np.full((1, 1, 3), 255, np.uint8))[0, 0])
    return srgb_to_linear(seen) / light / white, trust


def light_terms(uv: np.ndarray) -> np.ndarray:
    """(..., 5) slopes and curves over the patch, all 0 at its middle."""
    x, y = 2 * uv[..., 0] - 1, 2 * uv[..., 1] - 1
    return np.stack([x, y, x * x, x * y, y * y], axis=-1)


def ripple_terms(uv: np.ndarray) -> np.ndarray:
    """(..., 21) the products of Legendre polynomials of u and v, from -1 to 1, up to degree five together."""
    degrees = np.add.outer(np.arange(RIPPLE_DEGREE + 1), np.arange(RIPPLE_DEGREE + 1)) <= RIPPLE_DEGREE
    both = np.polynomial.legendre.legvander2d(2 * uv[..., 0] - 1, 2 * uv[..., 1] - 1, [RIPPLE_DEGREE] * 2)
    return np.asarray(both[..., degrees.ravel()])


def fit_look(image: np.ndarray, sighting: PatchSighting, patch_pixels: np.ndarray) -> PrintedLook:
    """Fit the look to a patch's known texels; a `ToolkitError` if too little of the patch shows."""
    n = patch_pixels.shape[0]
    # it begins as a patch without blur, ripple and noise
    kernels, wide = no_spread()
    look = PrintedLook(
        sighting.warp, ripple=np.zeros((RIPPLE_TERMS, 2)), nodes=np.zeros((0, 3)), light=np.zeros((0, 3)),
        kernels=kernels, wide=wide, noise=np.zeros((NOISE_LEVELS, 3)), grain_px=np.zeros(2),
        delta_e=0.0, shown=sighting.shown,
    )  # fmt: skip
    look = _refine_place(image, _fit_print(image, sighting, look, patch_pixels), patch_pixels)
    # once more, as the texels' places are now exact
    look = _fit_print(image, sighting, look, patch_pixels)
    # a part round the patch's middle is enough to measure blur and noise
    part, moved = _cut_middle(image, look.warp)
    sizes_px = np.array(WIDE) * min(image.shape[:2])
    kernels, wide = _fit_kernels(PatchScene(part, replace(look, warp=moved), patch_pixels), sizes_px)
    look = replace(look, kernels=kernels, wide=wide)
    noise, grain_px = _measure_noise(PatchScene(part, replace(look, warp=moved), patch_pixels), look.warp.side_px / n)
    return replace(look, noise=noise, grain_px=grain_px)


def no_spread() -> tuple[np.ndarray, np.ndarray]:
    """`kernels` and `wide` of a `PrintedLook` that leave every pixel as it is."""
    kernels = np.zeros((3, KERNEL_PX, KERNEL_PX))
    kernels[:, KERNEL_PX // 2, KERNEL_PX // 2] = 1
    return kernels, np.zeros((0, 4))


def _fit_print(image: np.ndarray, sighting: PatchSighting, look: PrintedLook, patch_pixels: np.ndarray) -> PrintedLook:
    """The look with colours and light fitted to the texels, read where it has them."""
    seen, trust = read_texels(image, sighting, patch_pixels.shape[0], look)
    if (trust > 0).sum() < LEAST_TEXELS:
        raise ToolkitError(f"only {int((trust > 0).sum())} texels of the patch can be seen, {LEAST_TEXELS} needed")
    nodes, light, said, weight = _fit_colours(patch_pixels, seen, trust)
    lab = [lab_of_linear(srgb_to_linear(values[weight > 0])) for values in (seen, said)]
    # texels outside of the picture do not show either
    shown = min(look.shown, float((trust > 0).mean()))
    return replace(look, nodes=nodes, light=light, delta_e=float(np.median(delta_e2000(*lab))), shown=shown)


def _cut_middle(image: np.ndarray, warp: PatchWarp) -> tuple[np.ndarray, PatchWarp]:
    """Cut the photo round the patch's middle, to measure blur and noise; also returns the patch's warp there."""
    (x, y), (h, w) = warp.corners.mean(axis=0), image.shape[:2]
    left, top = int(np.clip(x - MEASURED_PX / 2, 0, w)), int(np.clip(y - MEASURED_PX / 2, 0, h))
    move = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]])
    part = image[top : top + MEASURED_PX, left : left + MEASURED_PX]
    return part, PatchWarp(move @ warp.homography, warp.bend)


def read_texels(image: np.ndarray, sighting: PatchSighting, n: int, look: PrintedLook) -> tuple[np.ndarray, np.ndarray]:
    """Read the mean sRGB-encoded colour (n², 3) of each texel, and (n²,) whether it shows, by the sighting.

    Places of the texels are those of the look, ripple included.
    """
    samples = int(np.clip(np.ceil(look.warp.side_px / n), *TEXEL_SAMPLES))
    scale = min(1.0, samples * n / look.warp.side_px)
    small, warp = shrink_image(image, scale), look.warp.scaled(scale)
    # the ripple is smooth: few values suffice
    few = min(n, RIPPLE_PLACES)
    ripple = (ripple_terms(cell_centres(few)) @ look.ripple).reshape(few, few, 2).astype(np.float32)
    ripple = cv2.resize(ripple, (n * samples, n * samples), interpolation=cv2.INTER_LINEAR)
    at = warp.to_pixels(cell_centres(n * samples) + ripple.reshape(-1, 2)).reshape(n * samples, -1, 2)
    values = sample_image(small, at).astype(np.float32).reshape(n, samples, n, samples, 3).mean(axis=(1, 3)) / 255
    # the frame is repeated beyond its edge, and would spoil the mean of a texel that it cuts
    within = ((at > 0) & (at < np.array(small.shape[1::-1]))).all(axis=-1)
    within = within.reshape(n, samples, n, samples).all(axis=(1, 3))
    cells = np.arange(n) * len(sighting.agreement) // n
    shows = sighting.agreement[cells[:, None], cells[None]] >= CELL_SHOWS
    return values.reshape(-1, 3).astype(float), (within & shows).ravel().astype(float)


def _fit_colours(
    patch_pixels: np.ndarray, seen: np.ndarray, trust: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fit nodes and light; also returns the colour of each texel by them, and the texels' weights.

    In turns: the cube, given the shares of a texel's neighbours in its mean; those shares; the light.
    """
    n = patch_pixels.shape[0]
    weights = cube_weights(patch_pixels.reshape(-1, 3) / 255.0)
    terms = light_terms(cell_centres(n))
    # even steps over all texels: the cube's nodes need few of them
    some = np.linspace(0, n * n - 1, min(n * n, MOST_TEXELS)).round().astype(int)
    # ink and lens spread a texel over its four neighbours; at first each keeps all of its own
    around = [_shift(n, *step) for step in ((0, 0), (-1, 0), (1, 0), (0, -1), (0, 1))]
    shares = np.zeros((3, len(around)))
    shares[:, 0] = 1
    light, weight = np.zeros((terms.shape[1], 3)), trust
    for step in range(COLOUR_ROUNDS):
        # luma and chroma apart, without the light: a camera blurs them differently
        even = linear_to_srgb(srgb_to_linear(seen) / np.exp(terms @ light)).astype(float) @ YCC.T
        parts = []
        for channel in range(3):
            blur = sum(
                (share * move for share, move in zip(shares[channel], around, strict=True)),
                sparse.csr_matrix((n * n, n * n)),
            )
            blurred = (blur @ weights).tocsr()
            node, _ = solve_cube(blurred[some], even[some, channel : channel + 1], weight[some])
            parts.append((node[:, 0], blurred @ node[:, 0]))
        nodes, said = (np.stack(part, axis=1) for part in zip(*parts, strict=True))
        # Cauchy weights at three medians: texels under a finger or a highlight count little
        miss = np.linalg.norm(even - said, axis=1)
        weight = trust / (1 + (miss / (3 * np.median(miss[trust > 0]) + 1e-6)) ** 2)
        light = _fit_light(terms, seen, said @ RGB.T, weight)
        if step < COLOUR_ROUNDS - 1:
            flat = weights @ nodes
            for channel in range(3):
                columns = np.stack([move @ flat[:, channel] for move in around], axis=1)
                found = np.linalg.lstsq(columns * weight[:, None], even[:, channel] * weight, rcond=None)[0]
                # shares add up to 1, so that an even area keeps its colour; a sum near 0 is useless
                shares[channel] = found / found.sum() if abs(found.sum()) > 0.2 else shares[channel]
    lit = linear_to_srgb(srgb_to_linear(np.clip(said @ RGB.T, 0, 1)) * np.exp(terms @ light)).astype(float)
    return nodes, light, lit, weight


def _shift(n: int, down: int, right: int) -> sparse.csr_matrix:
    """(n², n²) matrix that moves texels, and repeats the edge beyond the edge."""
    rows, columns = np.mgrid[:n, :n]
    beside = np.clip(rows + down, 0, n - 1) * n + np.clip(columns + right, 0, n - 1)
    return sparse.csr_matrix((np.ones(n * n), (np.arange(n * n), beside.ravel())), shape=(n * n, n * n))


def _fit_light(terms: np.ndarray, seen: np.ndarray, said: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(5, 3) coefficients of the logarithm of the seen light over the cube's, weighted by brightness."""
    there, meant = srgb_to_linear(seen).astype(float), srgb_to_linear(np.clip(said, 0, 1)).astype(float)
    # `DARK` in both keeps noise in the blacks from being a factor of the light
    ratio = np.log((there + DARK) / (meant + DARK))
    light = np.zeros((terms.shape[1], 3))
    columns = np.c_[terms, np.ones(len(terms))]
    for channel in range(3):
        root = np.sqrt(weight) * meant[:, channel]
        # the constant column is dropped: overall brightness is the cube's
        light[:, channel] = np.linalg.lstsq(columns * root[:, None], ratio[:, channel] * root, rcond=None)[0][:-1]
    return np.clip(light, -MOST_GAIN, MOST_GAIN)


class PatchScene:
    """The part of a photograph round its patch, and the known patch drawn there as the model has it.

    Attributes:
        left, top: of the part, pixels of the photo.
        uv: (h, w, 2) places on the patch.
        step: (h, w, 2) change of u and v over a pixel.
        cover: (h, w) share of each pixel on the patch.
        around: (h, w, 3) linear light round the patch, and near its rim under it.
        gain: (h, w, 3) factor on the light of a texel, without change at the patch's middle.
        seen: (h, w, 3) luma and chroma of the photo.
        drawn: (h, w, 3) the same of the known patch.
        hidden: (h, w) from 0 to 1, how far something hides the patch.
    """

    def __init__(self, image: np.ndarray, look: PrintedLook, patch_pixels: np.ndarray) -> None:
        """Draw the known patch; see `fit_look` for the arguments."""
        self.look = look
        placed = place_cut(look.warp, image.shape)
        if placed is None:
            raise ToolkitError("the patch lies outside of the photo")
        self.left, self.top, uv = placed
        self.uv = uv.astype(np.float32)
        # the ripple of the paper shifts where texels are seen
        if look.ripple.any():
            coarse = self.uv[::COARSE_PX, ::COARSE_PX]
            self.uv = self.uv - self._enlarge((ripple_terms(np.clip(coarse, 0, 1)) @ look.ripple).astype(np.float32))
        # texels a pixel: the rim is covered in part, in proportion to what of the pixel it fills
        du, dv = (sum(np.abs(part) for part in np.gradient(self.uv[..., k])) for k in (0, 1))
        self.step = np.stack([du, dv], axis=-1)
        edges = np.clip(np.minimum(self.uv, 1 - self.uv) / np.maximum(self.step, 1e-9) + 0.5, 0, 1)
        self.cover = edges.prod(axis=-1)
        h, w = uv.shape[:2]
        self._cut = image[self.top : self.top + h, self.left : self.left + w]
        self.seen = _to_ycc(self._cut / np.float32(255))
        outside = (self.cover < 0.01).astype(np.float32)
        light = LINEAR_OF_CODE[self._cut]
        # a normalised blur: the mean of what lies outside alone, also under the rim
        near = cv2.GaussianBlur(outside, (0, 0), 3.0)[..., None]
        around = cv2.GaussianBlur(light * outside[..., None], (0, 0), 3.0) / np.maximum(near, 1e-3)
        self.around = np.where(outside[..., None] > 0, light, around)
        gain = np.exp(light_terms(self.uv[::COARSE_PX, ::COARSE_PX]) @ look.light).astype(np.float32)
        self.gain = self._enlarge(gain)
        self.drawn = self.draw(patch_pixels)
        self.hidden = self._find_hidden(patch_pixels.shape[0])

    def _enlarge(self, coarse: np.ndarray) -> np.ndarray:
        """(h, w, c) from its values at every eighth pixel."""
        h, w = self.uv.shape[:2]
        y, x = np.mgrid[:h, :w].astype(np.float32) / COARSE_PX + np.float32(0.5)
        return sample_image(coarse, np.stack([x, y], axis=-1))

    def draw(self, pixels: np.ndarray) -> np.ndarray:
        """(h, w, 3) float32 luma and chroma: a patch (n, n, 3) uint8 sRGB in this place, without noise."""
        colours = srgb_to_linear(self.look.colours(pixels))
        light = draw_texels(colours, self.uv, self.step)
        light *= self.gain
        cover = self.cover[..., None].astype(np.float32)
        ycc = _to_ycc(linear_to_srgb(cover * light + (1 - cover) * self.around))
        return np.stack([self._spread(np.ascontiguousarray(ycc[..., k]), k) for k in range(3)], axis=-1)

    def _spread(self, channel: np.ndarray, k: int) -> np.ndarray:
        """(h, w) luma or a chroma as the camera spreads and sharpens it."""
        found = np.asarray(cv2.filter2D(channel, -1, self.look.kernels[k], borderType=cv2.BORDER_REPLICATE))
        for sigma_px, *shares in self.look.wide:
            found += shares[k] * (_blur_widely(channel, sigma_px) - channel)
        return found

    def _find_hidden(self, n: int) -> np.ndarray:
        inside = self.cover > 0.99
        if not inside.any():
            return np.zeros(self.cover.shape, np.float32)
        texel_px = max(self.look.warp.side_px / n, 1.0)
        miss = (self.seen - self.drawn) * inside[..., None]
        # the mean over a texel or two, in which noise and small shifts vanish; few pixels suffice
        scale = min(1.0, FEW_PX / texel_px)
        small, part = (cv2.resize(plane, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) for plane in (
            miss.astype(np.float32), inside.astype(np.float32)
        ))  # fmt: skip
        near = np.maximum(cv2.GaussianBlur(part, (0, 0), scale * texel_px), 1e-3)
        mean = cv2.GaussianBlur(small, (0, 0), scale * texel_px) / near[..., None]
        size = np.linalg.norm(mean, axis=-1)
        size = cv2.resize(size, inside.shape[::-1], interpolation=cv2.INTER_LINEAR)
        # an absolute least, and a limit that follows this photograph's own error
        least = max(HIDES[0], HIDES[1] * float(np.median(size[inside])))
        # hysteresis, as Canny's: weak pixels count where they touch a strong pixel
        weak = ((size > least / 2) & inside).astype(np.uint8)
        count, labels = cv2.connectedComponents(weak)
        strong = np.bincount(labels[(size > least) & inside], minlength=count)
        area = np.bincount(labels.ravel(), minlength=count)
        kept = (strong > 0) & (area > LEAST_HIDDEN * texel_px**2)
        # label 0 is all that is not weak
        kept[0] = False
        hidden = kept[labels].astype(np.float32)
        return np.clip(2 * cv2.GaussianBlur(hidden, (0, 0), texel_px / 3), 0, 1)

    def put(self, pixels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(h, w, 3) uint8 sRGB: this part of the photo with another patch in place of the known patch.

        At the rim the difference of the two patches is added to the photo, so that its surroundings stay. Farther in,
        nothing of the old patch is left.
        """
        other = self.draw(pixels)
        # distance from the rim in pixels
        rim_px = np.minimum(self.uv, 1 - self.uv) / np.maximum(self.step, 1e-9)
        low, high = FEATHER_PX
        # 0 at the rim, where the difference of the patches is added; 1 inside, where the pixels are new
        inner = np.clip((rim_px.min(axis=-1) - low) / (high - low), 0, 1)[..., None]
        new = other + self._draw_noise(other[..., 0], rng)
        change = inner * (new - self.seen) + (1 - inner) * (other - self.drawn)
        # what hides the patch, such as a finger, stays
        ycc = self.seen + (1 - self.hidden[..., None]) * change
        encoded = np.clip(ycc @ RGB.T.astype(np.float32), 0, 1)
        # a kernel spreads the change beyond the patch's rim; farther out the photo's bytes stay as they are
        reached = cv2.dilate((self.cover > 0).astype(np.uint8), np.ones((KERNEL_PX, KERNEL_PX), np.uint8))
        return np.where(reached[..., None] > 0, np.rint(encoded * 255).astype(np.uint8), self._cut)

    def _draw_noise(self, luma: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(h, w, 3) noise of the photo's strength at each level, and as smooth."""
        level = np.clip(luma, 0, 1) * (NOISE_LEVELS - 1)
        parts = []
        for channel in range(3):
            white = rng.standard_normal(luma.shape, np.float32)
            grain = _smooth_noise(white, float(self.look.grain_px[min(channel, 1)]))
            sigma = np.interp(level, np.arange(NOISE_LEVELS), self.look.noise[:, channel]).astype(np.float32)
            parts.append(grain * sigma)
        return np.stack(parts, axis=-1)

    def luma_error(self) -> float:
        """Return the mean distance between the photo's luma and that of the drawn patch."""
        return float(np.abs(self.seen - self.drawn)[..., 0][self.cover > 0.99].mean())

    def grey_drawn(self) -> Drawn:
        """The known patch's luma, as the alignment takes it."""
        inside = self.cover > 0.99
        return Drawn(self.drawn[..., :1], inside, self.left, self.top, self.uv.astype(float))


def draw_texels(texels: np.ndarray, uv: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(h, w, c) float32 mean of texels (n, n, c), linear light, over each pixel, at `uv` and `step` as in `PatchScene`.

    Along an axis, a pixel's mean over square texels is linear from texel to texel over the pixel's width. Several
    texels in a pixel are averaged first.
    """
    n = texels.shape[0]
    wide = float(np.median(step) * n)
    source: np.ndarray = texels.astype(np.float32)
    if wide > 1:  # several texels in a pixel: the line below is a texel wide, the rest is blurred here
        # a square of width w has a variance of w² / 12; the line of a texel has 1 / 12 of it already
        source = cv2.GaussianBlur(source, (0, 0), np.sqrt((wide**2 - 1) / 12) + 1e-3, borderType=cv2.BORDER_REPLICATE)
    # texel centres lie at half texels
    place = uv * n - 0.5
    low = np.floor(place)
    width = np.clip(step * n, 1e-6, 1)
    place = low + np.clip((place - low - 0.5) / width + 0.5, 0, 1) + 0.5
    return sample_image(source, place).reshape(*uv.shape[:2], -1)


def _to_ycc(encoded: np.ndarray) -> np.ndarray:
    return np.asarray(encoded @ YCC.T.astype(np.float32))


def _refine_place(image: np.ndarray, look: PrintedLook, patch_pixels: np.ndarray) -> PrintedLook:
    """Align once more, with the printed colours at nearly the photo's own size; kept if it fits better."""
    scale = min(1.0, REFINE_PX / look.warp.side_px)
    small = shrink_image(image, scale)
    grey = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255
    best = replace(look, warp=look.warp.scaled(scale))
    scene = PatchScene(small, best, patch_pixels)
    # the warp of the whole sheet first, then its ripple
    for is_ripple in (False, True):
        uv, pixels = follow(grey, scene.grey_drawn(), best.warp)
        if is_ripple:
            better = replace(best, ripple=_fit_ripple(uv, best.warp.to_patch(pixels) - uv))
        else:
            better = replace(best, warp=fit_warp(uv, pixels, best.warp, REFINE_STIFFNESS, 0.3))
        tried = PatchScene(small, better, patch_pixels)
        if tried.luma_error() < scene.luma_error():
            best, scene = better, tried
    # how much of the patch shows, by the pixels that it covers whole
    inside = scene.cover > 0.99
    shown = float(1 - scene.hidden[inside].mean()) if inside.any() else 0.0
    return replace(best, warp=best.warp.scaled(1 / scale), shown=shown)


def _fit_ripple(uv: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """(21, 2) coefficients of the distances of points (k, 2) from their places by the warp, robust least squares."""
    ripple = np.zeros((RIPPLE_TERMS, 2))
    if len(uv) < LEAST_POINTS:
        return ripple
    terms, weight = ripple_terms(uv), np.ones(len(uv))
    # ridge regression, reweighted by Cauchy's weights at two medians
    for _ in range(ROBUST_ROUNDS):
        normal = terms.T @ (terms * weight[:, None]) + RIPPLE_RIDGE * np.eye(RIPPLE_TERMS)
        ripple = np.linalg.solve(normal, terms.T @ (apart * weight[:, None]))
        miss = np.linalg.norm(apart - terms @ ripple, axis=1)
        weight = 1 / (1 + (miss / (2 * np.median(miss) + 1e-9)) ** 2)
    return ripple


def _fit_kernels(scene: PatchScene, sizes_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit `kernels` and `wide` of `PrintedLook`, which make the drawn patch as sharp as the photo's.

    By least squares over pixels; both keep an even area.
    """
    reach = KERNEL_PX // 2
    good = (scene.cover > 0.99) & (scene.hidden < 0.01)
    good[:reach], good[-reach:], good[:, :reach], good[:, -reach:] = False, False, False, False
    rows, columns = np.nonzero(good)
    # ten pixels for each number of the kernel, against fitting noise
    if len(rows) < 10 * KERNEL_PX**2:
        return scene.look.kernels, scene.look.wide
    some = np.linspace(0, len(rows) - 1, min(len(rows), KERNEL_SAMPLES)).round().astype(int)
    rows, columns = rows[some], columns[some]
    centre = np.zeros(KERNEL_PX**2)
    centre[centre.size // 2] = 1
    kernels, wide = [], []
    for channel in range(3):
        drawn = np.ascontiguousarray(scene.drawn[..., channel])
        windows = np.lib.stride_tricks.sliding_window_view(drawn, (KERNEL_PX, KERNEL_PX))
        near = windows[rows - reach, columns - reach].reshape(len(rows), -1)
        far = np.stack([_blur_widely(drawn, float(size))[rows, columns] for size in sizes_px], axis=1)
        # sum 1: what moves is what differs from the pixel itself
        own = near[:, [centre.size // 2]]
        apart = (np.c_[near, far] - own).astype(float)
        miss = (scene.seen[rows, columns, channel] - own[:, 0]).astype(float)
        # all pixels count alike: hidden pixels are left out, and edges, which miss most, determine the spread
        normal = apart.T @ apart
        normal += KERNEL_RIDGE * np.trace(normal) / len(normal) * np.eye(len(normal))
        # less its own mean: a shift of brightness is no blur
        moved = np.linalg.solve(normal, apart.T @ (miss - miss.mean()))
        kernel = moved[: centre.size]
        kernel[centre.size // 2] = 0
        kernels.append((centre * (1 - kernel.sum()) + kernel).reshape(KERNEL_PX, KERNEL_PX))
        wide.append(moved[centre.size :])
    return np.stack(kernels), np.c_[sizes_px, np.stack(wide, axis=1)]


def _blur_widely(channel: np.ndarray, sigma_px: float) -> np.ndarray:
    """(h, w) blurred by a Gaussian; a wide Gaussian is computed on fewer pixels."""
    scale = min(1.0, FEW_PX / sigma_px)
    small = cv2.resize(channel, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else channel
    small = cv2.GaussianBlur(small, (0, 0), scale * sigma_px, borderType=cv2.BORDER_REPLICATE)
    return small if scale == 1 else cv2.resize(small, channel.shape[::-1], interpolation=cv2.INTER_LINEAR)


def _measure_noise(scene: PatchScene, texel_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Measure `noise` and `grain_px` of `PrintedLook`."""
    miss = scene.seen - scene.drawn
    # about the local mean: a misfit of the colours is no noise
    wide = WIDE_PX if texel_px > 1.5 * WIDE_PX else NARROW_PX
    apart = miss - cv2.blur(miss, (wide, wide))
    # n / (n - 1): the mean is of the same pixels
    spread = np.sqrt(np.maximum(cv2.blur(apart**2, (wide, wide)), 0) * wide**2 / (wide**2 - 1))
    good = (scene.cover > 0.99) & (scene.hidden < 0.01)
    if good.sum() < 100:
        return np.zeros((NOISE_LEVELS, 3)), np.zeros(2)
    level = np.clip(np.rint(scene.drawn[..., 0][good] * (NOISE_LEVELS - 1)), 0, NOISE_LEVELS - 1).astype(int)
    values = spread[good]
    # by flat parts: an edge a little beside its place looks like noise
    luma = scene.drawn[..., 0]
    edges = (cv2.blur(luma**2, (wide, wide)) - cv2.blur(luma, (wide, wide)) ** 2)[good]
    # a level that few pixels have, as overshoot beside an edge is, takes its neighbours' noise
    known = np.flatnonzero(np.bincount(level, minlength=NOISE_LEVELS) > LEAST_OF_LEVEL * len(level))
    found = []
    for step in known:
        flat = (level == step) & (edges <= np.percentile(edges[level == step], FLAT_PERCENT))
        found.append(np.percentile(values[flat], 25, axis=0) / QUARTER)
    steps = np.arange(NOISE_LEVELS)
    noise = np.stack([np.interp(steps, known, np.array(found)[:, channel]) for channel in range(3)], axis=1)
    quiet = good & (spread[..., 0] < 2 * np.interp(scene.drawn[..., 0] * (NOISE_LEVELS - 1), steps, noise[:, 0]))
    pairs = quiet[:, 1:] & quiet[:, :-1]
    miss = miss - cv2.GaussianBlur(miss, (0, 0), 3.0)
    whole = noise.mean(axis=0)
    grain = []
    for channels in ((0,), (1, 2)):
        alike = []
        for channel in channels:
            limit = 4 * max(whole[channel], 1e-6)
            clipped = np.clip(miss[..., channel], -limit, limit)
            power = max(float((clipped[quiet] ** 2).mean()), 1e-12)
            alike.append((clipped[:, 1:] * clipped[:, :-1])[pairs].mean() / power)
        # white noise through a Gaussian: neighbours correlate by exp(-1 / (4 σ²))
        likeness = float(np.clip(np.mean(alike), 0.0, 0.9))
        grain.append(0.0 if likeness < 0.01 else 0.5 / np.sqrt(-np.log(likeness)))
    return noise, np.array(grain)


def _smooth_noise(white: np.ndarray, sigma_px: float) -> np.ndarray:
    """White noise through a Gaussian, its deviation 1 again."""
    if sigma_px < WHITE_PX:
        return white
    kernel = cv2.getGaussianKernel(2 * int(np.ceil(3 * sigma_px)) + 1, sigma_px)
    blurred = cv2.sepFilter2D(white, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT_101)
    # the kernel's sum of squares is the deviation that it leaves of white noise, once along each axis
    return np.asarray(blurred / float((kernel**2).sum()))
