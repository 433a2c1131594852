"""Which images of a folder are corrupted: links to elsewhere are refused and listed."""

import numpy as np
import pytest
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.corruptions.folder import corrupt_images, find_sources


@pytest.fixture
def photos(tmp_path):
    rng = np.random.default_rng(0)
    for path in ("photos/a/1.png", "photos/b/2.png", "elsewhere/3.png"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(rng.integers(0, 256, (20, 20, 3), dtype=np.uint8)).save(tmp_path / path)
    return tmp_path / "photos"


def test_links_that_leave_the_folder_are_refused_and_listed(photos, tmp_path):
    (photos / "a/out.png").symlink_to(tmp_path / "elsewhere/3.png")
    (photos / "linked").symlink_to(tmp_path / "elsewhere")
    (photos / "a/within.png").symlink_to(photos / "b/2.png")
    (photos / "a/dangling.png").symlink_to(photos / "gone.png")
    result = corrupt_images(photos, tmp_path / "out", [("contrast", 1)])
    assert result.made == 3
    assert sorted(path for path, _ in result.failed) == ["a/out.png", "linked"]
    assert (tmp_path / "out/a/within.png").read_bytes() == (tmp_path / "out/b/2.png").read_bytes()


def test_out_within_is_passed_over_links_and_all(photos, tmp_path):
    out = photos / "out"
    out.mkdir()
    (out / "link.png").symlink_to(tmp_path / "elsewhere/3.png")
    found = find_sources(photos, out, "png")
    assert [source.path for source in found[0]] == ["a/1.png", "b/2.png"]
    assert found[1] == []


def test_nothing_but_links_is_one_line(tmp_path, photos):
    (tmp_path / "links").mkdir()
    (tmp_path / "links/1.png").symlink_to(photos / "a/1.png")
    with pytest.raises(ToolkitError, match=r"holds no images but links \(1.png: a link that leaves"):
        corrupt_images(tmp_path / "links", tmp_path / "out", [("contrast", 1)])
