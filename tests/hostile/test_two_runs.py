"""Two runs at once, and outputs that were cut: no work twice, no line twice, nothing damaged taken for whole."""

import json
from collections import Counter

import numpy as np
import pytest
from forked import TOOLKIT, Forked
from PIL import Image

from toolkit.corruptions.folder import LOG_FILE, corrupt_images


@pytest.fixture
def photos(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for i in range(6):
        pixels = np.random.default_rng(i).integers(0, 256, (40, 50, 3), np.uint8)
        Image.fromarray(pixels).save(folder / f"{i}.png")
    return folder


def run_twice(*arguments, cwd):
    """The same command in two processes at once -> their exit codes."""
    both = [Forked(TOOLKIT, *arguments, cwd=cwd) for _ in range(2)]
    return [one.wait().returncode for one in both]


def count_lines(file):
    return Counter(json.loads(line)["path"] for line in file.read_text().splitlines())


@pytest.mark.slow
def test_two_runs_of_corrupt_share_the_work(photos, tmp_path):
    assert run_twice("corrupt", photos, tmp_path / "out", "--corrupt", "fog:1-3", cwd=tmp_path) == [0, 0]
    lines = count_lines(tmp_path / "out" / LOG_FILE)
    assert len(lines) == 18 and set(lines.values()) == {1}


@pytest.mark.slow
def test_two_runs_of_the_rig_share_the_work(make_crate_space, tmp_path):
    space = make_crate_space(tmp_path / "space")
    assert run_twice("capture-sim", "--object", "crate", cwd=space.root) == [0, 0]
    lines = count_lines(space.captures_dir / "sim" / "manifest.jsonl")
    assert len(lines) == 4 and set(lines.values()) == {1}


@pytest.mark.parametrize("damage", [lambda content: content[:-20], lambda content: b"", lambda content: content + b"x"])
def test_an_output_that_was_cut_is_not_taken_for_finished(photos, tmp_path, damage):
    out = tmp_path / "out"
    assert corrupt_images(photos, out, [("fog", 1)]).made == 6
    whole = (out / "3.png").read_bytes()
    (out / "3.png").write_bytes(damage(whole))
    again = corrupt_images(photos, out, [("fog", 1)])
    assert (again.made, again.kept) == (0, 5)
    ((path, reason),) = again.failed
    assert path == "3.png" and "was changed since it was made" in reason and "delete it" in reason
    (out / "3.png").unlink()
    assert corrupt_images(photos, out, [("fog", 1)]).made == 1
    assert (out / "3.png").read_bytes() == whole
