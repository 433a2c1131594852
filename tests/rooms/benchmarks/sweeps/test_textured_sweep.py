"""A texture in a sweep: it has no printed size, and is shot once where only the patch's is varied."""

import numpy as np
import pytest
from red_crate import RED, make_base

from toolkit.core.errors import ToolkitError
from toolkit.objects.load import load_object
from toolkit.objects.records import write_texture
from toolkit.rooms.benchmarks.sweeps import SweepConfig
from toolkit.rooms.benchmarks.sweeps.sweep import run_sweep


def sweep(space, redness, variants):
    config = SweepConfig(axis="size", values=[20.0, 40.0], objects=["crate"], variants=variants)
    return run_sweep(space, config, redness, make_base(space))


@pytest.mark.slow
def test_a_texture_beside_a_patch_of_several_sizes(space, redness):
    item = load_object(space.object_spec("crate"))
    corner = np.array([[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]], np.float32)
    record = {
        "name": "crate", "class_name": "crate", "class_index": 1, "networks": [], "data": {}, "seed": 0,
        "settings": {}, "final": {}, "toolkit_version": "0",
        "objects": [{"name": "crate", "mesh_sha256": item.shape_sha256}],
    }  # fmt: skip
    uv = np.repeat(corner[None], len(item.mesh.faces), axis=0)
    write_texture(space.textures_dir, np.full((8, 8, 3), RED, np.uint8), record, {"crate": uv})
    with pytest.raises(ToolkitError, match="'size' varies the patch: name the variant 'patched'"):
        sweep(space, redness, ["unpatched", "textured"])
    result = sweep(space, redness, ["unpatched", "patched", "textured"])
    assert (result.shot, result.kept) == (8, 4)  # both poses: bare once, the patch twice, the texture once
    sizes = {(row["label"], row["variant"]): row["patch_mm"] for row in result.sweep.rows if row["object"] == "crate"}
    assert sizes == {
        (label, variant): mm if variant == "patched" else None
        for label, mm in (("20mm", 20), ("40mm", 40))
        for variant in ("unpatched", "patched", "textured")
    }
    assert {group.top1 for group in result.sweep.groups if group.variant == "textured"} == {1.0}
