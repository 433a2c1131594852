"""How much of a wrap is needed: its best pieces up to a share of what cameras see."""

import csv

import numpy as np
import pytest
from red_crate import RED, make_base

from toolkit.core.console import quietly
from toolkit.core.errors import ToolkitError
from toolkit.objects.load import load_object
from toolkit.rooms.benchmarks.sweeps import SweepConfig
from toolkit.rooms.benchmarks.sweeps.axes import find_axis, parse_values
from toolkit.rooms.benchmarks.sweeps.sweep import run_sweep
from toolkit.rooms.wraps.wrap import Wrap, WrapTraining, write_wrap
from toolkit.rooms.wraps.wrap_plan import plan_wrap

TRAINING = WrapTraining(
    class_index=1, networks=[], data={}, seed=0, settings={}, final={}, misfit={}, toolkit_version="0"
)


def test_shares_are_per_cent_of_what_cameras_see():
    axis = find_axis("coverage")
    assert parse_values(axis) == [5, 10, 20, 33, 50, 75, 100]
    assert axis.label(33.0) == "33pct"
    for wrong in ("0", "101", "all"):
        with pytest.raises(ToolkitError, match="per cent"):
            parse_values(axis, [wrong])
    assert SweepConfig(axis="coverage").shown() == ("unpatched", "wrapped")
    assert SweepConfig(axis="light").shown() == ("unpatched", "patched")


@pytest.mark.slow
def test_more_of_the_wrap_is_shot_at_higher_shares(space, redness):
    item = load_object(space.object_spec("crate"))
    config = SweepConfig(axis="coverage", values=[20, 100], objects=["crate"])
    with pytest.raises(ToolkitError, match="no wrap is for 'crate'"):
        run_sweep(space, config, redness, make_base(space))
    with quietly(True):
        plan = plan_wrap(item)
    trained = plan.record.model_copy(update={"class_name": "crate", "booster": TRAINING})
    write_wrap(space.wraps_dir / "crate", Wrap(trained, plan.pieces, np.full_like(plan.pixels, RED)))
    result = run_sweep(space, config, redness, make_base(space))
    assert (result.shot, result.kept) == (6, 2)  # both poses: bare once, each share of the wrap
    reached = {row["label"]: row["patch_share"] for row in result.sweep.rows
               if row["object"] == "crate" and row["variant"] == "wrapped"}  # fmt: skip
    assert reached["20pct"] < 0.5 and reached["100pct"] == pytest.approx(plan.record.covered, abs=1e-3)
    known = {row["label"]: row["top1"] for row in result.sweep.rows if row["variant"] == "wrapped"}
    assert known["100pct"] == 1.0
    rows = list(csv.DictReader(result.csv_file.open()))
    assert {row["coverage"] for row in rows} == {"20.0", "100.0"}
    assert all(row["patch_share"] == "" for row in rows if row["variant"] == "unpatched")
    with pytest.raises(ToolkitError, match="varies the wrap"):
        run_sweep(space, config.with_overrides(variants=("unpatched",)), redness, make_base(space))
