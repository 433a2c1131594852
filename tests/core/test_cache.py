"""Arrays that are kept between runs: the same as made, made anew where they are not as they were written."""

import os

import numpy as np
import pytest

from toolkit.core import cache
from toolkit.core.cache import keep_arrays

INPUTS = ["cube", np.arange(3), 0.5]


@pytest.fixture
def made(monkeypatch, tmp_path):
    """How often `keep` had to make them, and where they are kept: an empty cache."""
    monkeypatch.setenv(cache.PLACE, str(tmp_path / "cache"))
    return []


def keep(made, inputs=INPUTS):
    def make():
        made.append(1)
        return {"points": np.linspace(0, 1, 7, dtype=np.float32), "name": np.array("kept")}

    found = keep_arrays("test", inputs, make)
    assert found["points"].dtype == np.float32 and found["points"][-1] == 1 and str(found["name"]) == "kept"


def test_they_are_made_once_for_the_same_inputs(made):
    for _ in range(2):
        keep(made)
    assert len(made) == 1
    for other in (["cube", np.arange(3), 0.25], ["cube", np.arange(3.0), 0.5], ["cube", np.arange(3)], INPUTS[::-1]):
        keep(made, other)
    assert len(made) == 5


@pytest.mark.parametrize("place", [0, 40, -1])
def test_a_flipped_bit_or_half_a_file_is_made_anew(made, place):
    keep(made)
    (file,) = (cache.cache_root() / "arrays").iterdir()
    whole = file.read_bytes()
    damaged = bytearray(whole)
    damaged[place] ^= 1
    for content in (damaged, whole[:-9], b""):
        file.write_bytes(content)
        keep(made)
        assert file.read_bytes() == whole
    assert len(made) == 4


def test_a_folder_that_others_can_fill_is_not_used(made):
    folder = cache.cache_root() / "arrays"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    for _ in range(2):
        keep(made)
    assert len(made) == 2 and not list(folder.iterdir())


def test_without_a_folder_they_are_made_each_time(made, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv(cache.PLACE, str(tmp_path / "file"))
    for _ in range(2):
        keep(made)
    assert len(made) == 2


def test_what_was_used_longest_ago_goes_first(made, monkeypatch):
    folder = cache.cache_root() / "arrays"
    for number in range(3):
        keep(made, [number])
        (new,) = [file for file in folder.iterdir() if file.stat().st_mtime > 1000]
        os.utime(new, (number + 1, number + 1))
    keep(made, [0])  # used again
    monkeypatch.setattr(cache, "MOST_BYTES", 3 * new.stat().st_size)
    keep(made, [3])
    assert len(made) == 4
    for number in (0, 2, 3):
        keep(made, [number])
    assert len(made) == 4 and len(list(folder.iterdir())) == 3
    keep(made, [1])
    assert len(made) == 5
