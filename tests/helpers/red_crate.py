"""What the sweeps' tests do to their workspace."""

import numpy as np

from toolkit.captures.shoot import ShootSettings
from toolkit.objects.records import write_patch
from toolkit.rig.plan import read_plan
from toolkit.rooms.benchmarks.sweeps.axes import ShootSetup

RED = (220, 10, 10)


def paint_patch(space, colour=RED, patch_set=""):
    """Put a patch of one colour on the crate."""
    record = {
        "name": "crate", "class_name": "crate", "class_index": 1, "networks": [], "data": {}, "seed": 0,
        "settings": {}, "final": {}, "toolkit_version": "0",
    }  # fmt: skip
    write_patch(space.patches_dir / patch_set, np.full((12, 12, 3), colour, np.uint8), record)


def make_base(space) -> ShootSetup:
    """The workspace's plan on a white table."""
    return ShootSetup(read_plan(space.plan_file), ShootSettings(backdrop="white"))
