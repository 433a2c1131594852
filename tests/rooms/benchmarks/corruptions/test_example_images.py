"""The picture of what was shown: an image in every variant, framed by what was answered to it."""

from io import BytesIO

import numpy as np
from hue_network import make_hue_classifier, write_photos, write_set
from PIL import Image

from toolkit.core.workspace import make_workspace
from toolkit.corruptions.catalogue import COMMON
from toolkit.rooms.benchmarks.corruptions import CorruptEvalConfig
from toolkit.rooms.benchmarks.corruptions.benchmark_run import RIGHT, WRONG, choose_conditions, draw_examples
from toolkit.rooms.benchmarks.corruptions.cells import open_variants
from toolkit.rooms.benchmarks.corruptions.grid import Grid, run_grid
from toolkit.training.images import open_images


def count(picture, colour) -> int:
    rgb = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return int((np.abs(picture.astype(int) - rgb).max(axis=2) < 12).sum())


def test_frames_say_what_was_answered(tmp_path):
    workspace, network = make_workspace(tmp_path / "space"), make_hue_classifier()
    write_set(workspace, shift=1)
    variants, _ = open_variants(workspace, ["paint-16"], network, lambda name: None)
    images = open_images(str(write_photos(tmp_path / "data")), network)
    grid = Grid(images, tuple(variants), CorruptEvalConfig(corruptions=[("fog", 2)]))
    benchmark = run_grid(grid, tmp_path / "cells.jsonl")
    picture = np.asarray(Image.open(BytesIO(draw_examples(grid, benchmark))).convert("RGB"))
    ranks = [one.ranks[len(benchmark.ids) // 2] for one in benchmark.cells]
    right = sum(rank == 1 for rank in ranks)
    assert 0 < right < len(ranks) == 4
    frame = (count(picture, RIGHT) + count(picture, WRONG)) / 4
    assert frame > 1500
    assert round(count(picture, RIGHT) / frame) == right


def test_columns_are_spread_over_what_was_run_each_at_its_middle_severity():
    chosen = choose_conditions([(name, severity) for name in COMMON for severity in (1, 2, 3, 4, 5)])
    assert chosen[0] == ("clean", 0) and len(chosen) == 6
    assert {severity for _, severity in chosen[1:]} == {3}
    assert chosen[1][0] == COMMON[0] and chosen[-1][0] == COMMON[-1]
    assert choose_conditions([("fog", 5)]) == [("clean", 0), ("fog", 5)]
