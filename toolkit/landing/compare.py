"""The classical finders on a data set's held-out frames."""

from pathlib import Path

import numpy as np

from toolkit.core.console import progress
from toolkit.core.workspace import Workspace
from toolkit.landing.baselines import make_apriltag, make_features
from toolkit.landing.collect import Collector
from toolkit.landing.config import CollectConfig
from toolkit.landing.dataset import SampleSet, open_dataset, read_split
from toolkit.landing.pads import draw_pad, find_pad
from toolkit.landing.regressor import ErrorRow, summarise_errors
from toolkit.landing.site import find_world
from toolkit.rig.raycast import map_frames

MOST_FRAMES = 300


def measure_baselines(space: Workspace, folder: Path, most: int = MOST_FRAMES) -> dict[str, list[ErrorRow]]:
    """Errors of features + homography on the first held-out frames, and of an AprilTag in the pad's place.

    The tag's frames are shot again from the same cameras in the same air.

    Args:
        space: the workspace, for the pad's picture.
        folder: of the data set.
        most: frames.
    """
    about = open_dataset(folder)
    config = CollectConfig(**about.settings)
    samples = read_split(folder, "held_out", most)
    camera = config.optics.camera
    pad = find_pad(space, config.pad, config.size_m, about.seed)
    rows = {"features": summarise_errors(make_features(pad, camera).predict(samples.images), samples)}
    tag = draw_pad("apriltag", config.size_m)
    collector = Collector(config, find_world(config.world, config.world_seed), tag, about.seed)
    numbers = [one.index for one in samples.truths]
    collector.light_pads(numbers)
    images = []
    with progress("Shooting AprilTag frames", len(numbers)) as bar:
        for sample in map_frames(collector.shoot, numbers):
            images.append(sample.image)
            bar.advance()
    tagged = SampleSet(np.stack(images), samples.truths)
    return rows | {"apriltag": summarise_errors(make_apriltag(tag, camera).predict(tagged.images), tagged)}
