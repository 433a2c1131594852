"""Tags beside patches in a sweep: where OpenCV reads one, in fog and blur, and one table of crossed quantities."""

import csv

import numpy as np
import pytest
from one_line import error_of
from PIL import Image
from red_crate import make_base

from toolkit.core.errors import ToolkitError
from toolkit.evaluation.predictions_csv import read_predictions
from toolkit.evaluation.summaries import open_run
from toolkit.objects.load import load_object
from toolkit.rig.applied.tag import name_variant, parse_tag
from toolkit.rig.markers import find_markers, marker_modules
from toolkit.rig.plan import read_plan, write_plan
from toolkit.rig.variants import find_booster
from toolkit.rooms.benchmarks.sweeps import SweepConfig
from toolkit.rooms.benchmarks.sweeps.cross import build_crossed_table, run_crossed
from toolkit.rooms.benchmarks.sweeps.sweep import run_sweep

VARIANTS = ("unpatched", "patched", "tag:36h11:7")


@pytest.fixture
def sharp(space):
    """The crate's plan with pictures of 320 × 240 px, in which a tag of 40 mm is large enough."""
    from toolkit.rig.plan import scale_resolution

    write_plan(space.plan_file, scale_resolution(read_plan(space.plan_file), 320))
    return space


def sweep(space, redness, axis, values, variants=VARIANTS):
    config = SweepConfig(axis=axis, values=values, objects=["crate"], variants=variants)
    return run_sweep(space, config, redness, make_base(space))


def find_shares(result) -> dict[tuple[str, str], float]:
    return {(row["label"], row["variant"]): row["top1"] for row in result.sweep.rows}


def test_a_tag_is_in_the_patchs_place_with_its_border(sharp):
    item = load_object(sharp.object_spec("crate"))
    tag, patch = find_booster(sharp, item, "tag:36h11:7"), find_booster(sharp, item, "patched")
    assert tag.sizes_mm == patch.sizes_mm == (40,) and tag.name == "tag-36h11-7"
    assert tag.sha256 != find_booster(sharp, item, "tag:36h11:8").sha256
    modules = marker_modules("DICT_APRILTAG_36h11", 7)
    shown = np.asarray(Image.fromarray(tag.pixels).resize((len(modules) + 2,) * 2, Image.Resampling.NEAREST))
    assert np.array_equal(shown[1:-1, 1:-1, 0] == 0, modules)
    assert (shown[[0, -1]] == 255).all() and (shown[:, [0, -1]] == 255).all()
    assert [*dict(find_markers("DICT_APRILTAG_36h11", np.pad(tag.pixels[..., 0], 40, constant_values=255)))] == [7]


def test_it_is_read_close_up_and_not_from_afar(sharp, redness):
    near = find_shares(sweep(sharp, redness, "distance", [1, 6]))
    assert near["1x", "tag-36h11-7"] == 1 and near["6x", "tag-36h11-7"] == 0
    assert near["1x", "patched"] == 1 and near["1x", "unpatched"] == 0


def test_what_is_written_says_who_judges(sharp, redness):
    result = sweep(sharp, redness, "distance", [1, 6])
    assert result.classified == 8  # the network is not asked about tags
    run = open_run(sharp, "sweeps/distance/redness")
    said = [one for one in read_predictions(run, result.csv_file.parent / "captures") if "tag" in one.capture.variant]
    assert {(one.capture.source, one.top1_label) for one in said} == {("1x", "crate"), ("6x", "no tag")}
    assert not any(one.correct_top5 for one in said if one.capture.source == "6x")
    assert "tag-36h11-7: read by OpenCV" in result.sweep.note
    assert {row["patch_mm"] for row in result.sweep.rows if row["variant"] == "tag-36h11-7"} == {40}


def test_fog_and_blur_reach_network_and_reader(sharp, redness):
    for axis in ("fog", "blur"):
        shares = find_shares(sweep(sharp, redness, axis, [0, 5]))
        assert shares[f"{axis}-0", "tag-36h11-7"] == 1 and shares[f"{axis}-0", "patched"] == 1
        files = [sharp.eval_dir / f"sweeps/{axis}/captures/{axis}-{k}/crate/patched/pose_01.jpg" for k in (0, 5)]
        assert files[0].read_bytes() == files[1].read_bytes()  # corrupted when it is read
    foggy = find_shares(sweep(sharp, redness, "fog", [5]))
    assert foggy["fog-5", "patched"] < 1 or foggy["fog-5", "tag-36h11-7"] < 1


def test_crossed_quantities_make_one_table(sharp, redness):
    config = SweepConfig(
        axis="distance", values=[1, 6], objects=["crate"], variants=VARIANTS[1:], cross=["size=20,40", "fog=0,5"]
    )
    crossed = run_crossed(sharp, config, redness)
    assert crossed.axes == ("size", "fog", "distance") and crossed.is_whole
    assert len(crossed.cells) == 2 * 2 * 2 * 2
    rows = list(csv.DictReader(crossed.csv_file.open()))
    known = {(row["size"], row["fog"], row["distance"], row["variant"]): float(row["top1"]) for row in rows}
    assert known["40mm", "fog-0", "1x", "tag-36h11-7"] == 1 and known["40mm", "fog-0", "6x", "tag-36h11-7"] == 0
    # each cell is what the sweep of its values alone says
    alone = find_shares(sweep(sharp, redness, "size", [20, 40], VARIANTS[1:]))
    for label in ("20mm", "40mm"):
        for variant in ("patched", "tag-36h11-7"):
            assert known[label, "fog-0", "1x", variant] == alone[label, variant], (label, variant)
    table = build_crossed_table(crossed)
    assert table.row_count == 8 and len(table.columns) == 3 + 4
    assert {file.name for file in (sharp.eval_dir / "sweeps/distance").glob("captures*")} == {
        f"captures-{size}mm-fog-{fog}" for size in (20, 40) for fog in (0, 5)
    }


@pytest.mark.parametrize(
    ("variant", "words"),
    [
        ("tag:99h9:0", "no family of tags called '99h9'"),
        ("tag:36h11:587", "36h11 has the tags 0 to 586"),
        ("tag:36h11", "expected tag:FAMILY:NUMBER"),
        ("tag:36h11:a", "expected tag:FAMILY:NUMBER"),
        ("tag-36h11--1", "expected tag:FAMILY:NUMBER"),
    ],
)
def test_tags_that_there_are_not_are_told_before_anything_is_shot(variant, words):
    assert words in error_of(lambda: SweepConfig(axis="fog", variants=("patched", variant)))


def test_settings_that_cannot_be_crossed():
    for cross, words in (
        (["fog"], "expected AXIS=VALUES"), (["fog="], "expected AXIS=VALUES"), (["haze=1"], "haze"),
        (["fog=7"], "from 0 to 5"), (["fog=0", "fog=1"], "each axis once"), (["distance=1"], "each axis once"),
    ):  # fmt: skip
        with pytest.raises(ToolkitError, match=words):
            SweepConfig(axis="distance", cross=cross)


def test_variants_that_are_no_tags_keep_their_names():
    assert [name_variant(one) for one in ("patched", "tagged", "tag:36h11:0", "tag-36h11-0")] == [
        "patched", "tagged", "tag-36h11-0", "tag-36h11-0",
    ]  # fmt: skip
    assert parse_tag("tagged") is None


def test_the_commands_take_them(sharp, type_toolkit):
    words = ("--object", "crate", "--variant", "tag:36h11:7", "--workspace", sharp.root)
    code, _, err = type_toolkit("capture-sim", *words)
    assert code == 0, err
    assert (sharp.captures_dir / "sim/crate/tag-36h11-7/pose_01.jpg").is_file()
