# ruff: noqa: NPY002 (the published code draws from NumPy's old generator, and its speed is what is measured)
"""The published corruptions, one picture at a time, in plain NumPy, OpenCV, SciPy, Pillow and scikit-image.

Written from the definitions of Hendrycks and Dietterich (ICLR 2019) as the peers of `bench_corruptions`. Each takes
(h, w, 3) uint8 and returns (h, w, 3) with values in 0…255, as the published functions do. Motion blur is ImageMagick's
kernel through OpenCV's filter; frost takes the toolkit's textures from memory, without the published reading of a file.
"""

import io
import math

import cv2
import numpy as np
from PIL import Image
from scipy import ndimage
from skimage import color, filters, util

from toolkit.corruptions.catalogue import CORRUPTIONS
from toolkit.corruptions.weather import draw_panes


def finish(values: np.ndarray) -> np.ndarray:
    return np.clip(values, 0, 1) * 255


def blur(values: np.ndarray, sigma: float) -> np.ndarray:
    return filters.gaussian(values, sigma=sigma, channel_axis=-1 if values.ndim == 3 else None)


def gaussian_noise(x, c):
    x = np.array(x) / 255.0
    return finish(x + np.random.normal(size=x.shape, scale=c))


def shot_noise(x, c):
    x = np.array(x) / 255.0
    return finish(np.random.poisson(x * c) / c)


def impulse_noise(x, c):
    return finish(util.random_noise(np.array(x) / 255.0, mode="s&p", amount=c))


def speckle_noise(x, c):
    x = np.array(x) / 255.0
    return finish(x + x * np.random.normal(size=x.shape, scale=c))


def gaussian_blur(x, c):
    return finish(blur(np.array(x) / 255.0, c))


def glass_blur(x, c):
    sigma, reach, rounds = c
    x = np.uint8(blur(np.array(x) / 255.0, sigma) * 255)
    height, width = x.shape[:2]
    for _ in range(rounds):
        for row in range(height - reach, reach, -1):
            for column in range(width - reach, reach, -1):
                dx, dy = np.random.randint(-reach, reach, size=2)
                x[row, column] = x[row + dy, column + dx]
    return finish(blur(x / 255.0, sigma))


def defocus_blur(x, c):
    radius, softness = c
    reach, taps = (8, 3) if radius <= 8 else (radius, 5)
    offsets = np.arange(-reach, reach + 1)
    disk = np.float32(offsets[:, None] ** 2 + offsets**2 <= radius**2)
    kernel = cv2.GaussianBlur(disk / disk.sum(), (taps, taps), softness)
    x = np.array(x) / 255.0
    return finish(np.stack([cv2.filter2D(x[..., channel], -1, kernel) for channel in range(3)], -1))


def blur_along(x, radius, sigma, angle):
    count = 2 * math.ceil(radius) + 1
    weights = np.exp(-0.5 * (np.arange(count) / sigma) ** 2)
    kernel = np.zeros((2 * count + 1, 2 * count + 1), np.float32)
    cos, sin = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    for step, weight in enumerate(weights / weights.sum()):
        kernel[count + math.ceil(step * sin - 0.5), count + math.ceil(step * cos - 0.5)] += weight
    used = np.argwhere(kernel)
    reach = np.abs(used - count).max()
    cut = kernel[count - reach : count + reach + 1, count - reach : count + reach + 1]
    return cv2.filter2D(x, -1, cut, borderType=cv2.BORDER_REPLICATE)


def motion_blur(x, c):
    x = np.float32(x) / 255
    return finish(blur_along(x, *c, np.random.uniform(-45, 45)))


def zoom(x, factor):
    height = x.shape[0]
    cut = math.ceil(height / factor)
    start = (height - cut) // 2
    piece = x[start : start + cut, start : start + cut]
    grown = ndimage.zoom(piece, (factor, factor, 1)[: x.ndim], order=1)
    trim = (grown.shape[0] - height) // 2
    return grown[trim : trim + height, trim : trim + height]


def zoom_blur(x, c):
    x = np.float32(x) / 255
    factors = np.arange(1, *c)
    return finish((x + sum(zoom(x, factor) for factor in factors)) / (len(factors) + 1))


def snow(x, c):
    mean, deviation, factor, threshold, radius, sigma, kept = c
    x = np.float32(x) / 255
    layer = zoom(np.random.normal(size=x.shape[:2], loc=mean, scale=deviation), factor)
    layer[layer < threshold] = 0
    layer = blur_along(np.float32(np.clip(layer, 0, 1)), radius, sigma, np.random.uniform(-135, -45))
    grey = cv2.cvtColor(x, cv2.COLOR_RGB2GRAY)[..., None]
    x = kept * x + (1 - kept) * np.maximum(x, grey * 1.5 + 0.5)
    return finish(x + (layer + np.rot90(layer, k=2))[..., None])


def frost(x, c):
    pane = draw_panes(c[2])[np.random.randint(5)]
    top, left = np.random.randint(0, len(pane) - x.shape[0], size=2)
    piece = pane[top : top + x.shape[0], left : left + x.shape[1]] * 255
    return np.clip(c[0] * np.array(x) + c[1] * piece, 0, 255)


def grow_clouds(side, decay):
    field, step, bound = np.zeros((side, side)), side, 100.0

    def settle(total):
        return total / 4 + bound * np.random.uniform(-bound, bound, total.shape)

    while step >= 2:
        half = step // 2
        corners = field[::step, ::step]
        pairs = corners + np.roll(corners, -1, 0)
        middles = settle(pairs + np.roll(pairs, -1, 1))
        field[half::step, half::step] = middles
        field[::step, half::step] = settle(middles + np.roll(middles, 1, 0) + corners + np.roll(corners, -1, 1))
        field[half::step, ::step] = settle(middles + np.roll(middles, 1, 1) + corners + np.roll(corners, -1, 0))
        step, bound = half, bound / decay
    field -= field.min()
    return field / field.max()


def fog(x, c):
    x = np.array(x) / 255.0
    brightest = x.max()
    x += c[0] * grow_clouds(256, c[1])[: x.shape[0], : x.shape[1], None]
    return finish(x * brightest / (brightest + c[0]))


def change_hsv(x, channel, factor, summand):
    hsv = color.rgb2hsv(np.array(x) / 255.0)
    hsv[..., channel] = np.clip(hsv[..., channel] * factor + summand, 0, 1)
    return finish(color.hsv2rgb(hsv))


def brightness(x, c):
    return change_hsv(x, 2, 1, c)


def saturate(x, c):
    return change_hsv(x, 1, *c)


def contrast(x, c):
    x = np.array(x) / 255.0
    means = x.mean((0, 1), keepdims=True)
    return finish((x - means) * c + means)


def elastic_transform(x, c):
    strength, sigma, shift = c
    x = np.float32(x) / 255
    side = x.shape[0]
    middle, reach = side // 2, side // 3
    before = np.float32([[middle + reach] * 2, [middle + reach, middle - reach], [middle - reach] * 2])
    after = before + np.random.uniform(-shift, shift, before.shape).astype(np.float32)
    x = cv2.warpAffine(x, cv2.getAffineTransform(before, after), (side, side), borderMode=cv2.BORDER_REFLECT_101)
    dx, dy = (
        np.float32(
            filters.gaussian(np.random.uniform(-1, 1, (side, side)), sigma, mode="reflect", truncate=3) * strength
        )
        for _ in range(2)
    )
    rows, columns, channels = np.meshgrid(np.arange(side), np.arange(side), np.arange(3), indexing="ij")
    places = [rows + dy[..., None], columns + dx[..., None], channels]
    return finish(ndimage.map_coordinates(x, places, order=1, mode="reflect"))


def pixelate(x, c):
    height, width = x.shape[:2]
    small = Image.fromarray(x).resize((int(width * c), int(height * c)), Image.Resampling.BOX)
    return np.asarray(small.resize((width, height), Image.Resampling.BOX))


def jpeg_compression(x, c):
    stream = io.BytesIO()
    Image.fromarray(x).save(stream, "JPEG", quality=c)
    return np.asarray(Image.open(stream))


def spatter(x, c):
    mean, deviation, sigma, threshold, strength, is_mud = c
    x = np.float32(x) / 255
    liquid = blur(np.random.normal(size=x.shape[:2], loc=mean, scale=deviation), sigma)
    liquid[liquid < threshold] = 0
    if is_mud:
        cover = blur(np.float32(liquid > threshold), strength)[..., None]
        cover[cover < 0.8] = 0
        return finish(x * (1 - cover) + cover * np.array([63, 42, 20]) / 255)
    liquid = (liquid * 255).astype(np.uint8)
    distance = cv2.distanceTransform(255 - cv2.Canny(liquid, 50, 150), cv2.DIST_L2, 5)
    distance = cv2.blur(np.minimum(distance, 20), (3, 3)).astype(np.uint8)
    relief = cv2.filter2D(cv2.equalizeHist(distance), cv2.CV_8U, np.array([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]]))
    light = liquid * np.float32(cv2.blur(relief, (3, 3)))
    return finish(x + (light / light.max() * strength)[..., None] * np.float32([175, 238, 238]) / 255)


FORMULAS = {name: globals()[name] for name in CORRUPTIONS}
