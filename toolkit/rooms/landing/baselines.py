"""Two classical ways to find a pad: features with a homography, and AprilTag; nothing is trained."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from toolkit.core.console import progress
from toolkit.core.threads import map_ahead
from toolkit.core.workspace import Workspace
from toolkit.rig.camera import Camera
from toolkit.rig.markers import find_markers
from toolkit.rooms.landing.collect import Collector
from toolkit.rooms.landing.config import CollectConfig
from toolkit.rooms.landing.dataset import SampleSet, open_dataset, read_split
from toolkit.rooms.landing.regressor import ErrorRow, summarise_errors
from toolkit.rooms.landing.site import TAG, TAG_FAMILY, TAG_SHARE, Pad, draw_pad, find_pad, find_world

ZOOM = 3
"""Pictures are enlarged first: the detectors look for corners of several pixels."""
LEAST_MATCHES, MOST_FRAMES = 6, 300
Finder = Callable[[np.ndarray], np.ndarray]
"""(h, w, 3) uint8 sRGB -> (2,) the pad's x and y in the camera's frame, metres; NaN where it is not found."""


@dataclass(frozen=True)
class ClassicalFinder:
    """A finder for a camera, with the interface of a regressor."""

    name: str  # `features` or `apriltag`
    find: Finder  # of a picture

    def predict(self, images: np.ndarray) -> np.ndarray:
        """(n, 2) metres of (n, h, w, 3) uint8 pictures; NaN where the pad is not found."""
        found = np.full((len(images), 2), np.nan)
        with progress(f"Finding pads by {self.name}", len(images), quiet=len(images) < 100) as bar:
            for k, image in enumerate(images):
                found[k] = self.find(image)
                bar.advance()
        return found


def make_features(pad: Pad, camera: Camera) -> ClassicalFinder:
    """SIFT features of the pad's picture, a homography by RANSAC, and the camera's pose from the pad's corners."""
    # half of SIFT's default contrast threshold: fog leaves little contrast
    sift = cv2.SIFT_create(contrastThreshold=0.02)  # type: ignore[attr-defined]
    side = min(pad.picture.shape[0], 256)
    drawn = cv2.cvtColor(cv2.resize(pad.picture, (side, side), interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    points, known = sift.detectAndCompute(drawn, None)
    matcher = cv2.BFMatcher()

    def find(image: np.ndarray) -> np.ndarray:
        # frames are small: features are looked for in an enlargement
        seen_points, seen = sift.detectAndCompute(_enlarge(image), None)
        if known is None or seen is None or len(seen) < 2:
            return np.full(2, np.nan)
        # an H has each feature twice, one upside down: both of the nearest may be meant, and RANSAC chooses
        good = [match for pair in matcher.knnMatch(known, seen, k=2) for match in pair]
        if len(good) < LEAST_MATCHES:
            return np.full(2, np.nan)
        source = np.array([points[m.queryIdx].pt for m in good], np.float32)
        target = np.array([seen_points[m.trainIdx].pt for m in good], np.float32)
        # a pad is flat: four corners by a homography, and the camera's place from them
        homography, inliers = cv2.findHomography(source, target, cv2.RANSAC, 4.0)
        if homography is None or inliers.sum() < LEAST_MATCHES:
            return np.full(2, np.nan)
        corners = np.array([[(0, 0), (side, 0), (side, side), (0, side)]], np.float32)
        return _locate(cv2.perspectiveTransform(corners, homography)[0] / ZOOM, pad.size_m, camera)

    return ClassicalFinder("features", find)


def make_apriltag(pad: Pad, camera: Camera) -> ClassicalFinder:
    """OpenCV's detector of AprilTag 36h11, for the pad that `draw_pad` makes with it."""

    def find(image: np.ndarray) -> np.ndarray:
        for number, corners in find_markers(TAG_FAMILY, _enlarge(image), refined=True):
            if number == TAG:
                return _locate(corners / ZOOM, pad.size_m * TAG_SHARE, camera)
        return np.full(2, np.nan)

    return ClassicalFinder("apriltag", find)


def _enlarge(image: np.ndarray) -> np.ndarray:
    grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    return cv2.resize(grey, None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_CUBIC)


def _locate(corners: np.ndarray, side_m: float, camera: Camera) -> np.ndarray:
    """(2,) x and y of a square's middle from its corners (4, 2) in pixels, upper left first, clockwise."""
    if not np.isfinite(corners).all() or not cv2.isContourConvex(corners.astype(np.float32)):
        return np.full(2, np.nan)
    half = side_m / 2
    # the order that IPPE_SQUARE asks for
    square = np.array([(-half, half, 0), (half, half, 0), (half, -half, 0), (-half, -half, 0)])
    found, _, place = cv2.solvePnP(
        square, corners.astype(np.float64), camera.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    if not found or not np.isfinite(place).all() or place[2, 0] <= 0:
        return np.full(2, np.nan)
    return place[:2, 0]


def measure_baselines(space: Workspace, folder: Path) -> dict[str, list[ErrorRow]]:
    """Errors of features + homography on the first held-out frames, and of an AprilTag in the pad's place.

    The tag's frames are shot again from the same cameras in the same air.
    """
    # the settings of the set: its camera and pad are the same for both finders
    about = open_dataset(folder)
    config = CollectConfig(**about.settings)
    samples = read_split(folder, "held_out", MOST_FRAMES)
    camera = config.optics.camera
    pad = find_pad(space, config.pad, config.size_m, about.seed)
    rows = {"features": summarise_errors(make_features(pad, camera).predict(samples.images), samples)}
    # the same places and cameras, with a tag as the pad
    tag = draw_pad("apriltag", config.size_m)
    collector = Collector(config, find_world(config.world, config.world_seed), tag, about.seed)
    numbers = [truth.index for truth in samples.truths]
    collector.light_pads(numbers)
    images = []
    with progress("Shooting AprilTag frames", len(numbers)) as bar:
        for sample in map_ahead(collector.shoot, numbers):
            images.append(sample.image)
            bar.advance()
    tagged = SampleSet(np.stack(images), samples.truths)
    return rows | {"apriltag": summarise_errors(make_apriltag(tag, camera).predict(tagged.images), tagged)}
