"""A patch and its record: two files that must be of each other."""

import json

import numpy as np
import pytest
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.objects.records import printed_size_mm, read_patch, write_patch

PIXELS = np.random.default_rng(0).integers(0, 256, (9, 9, 3), dtype=np.uint8)


@pytest.fixture
def png(tmp_path, patch_record):
    write_patch(tmp_path, PIXELS, patch_record("mug"))
    return tmp_path / "mug.png"


def test_what_is_written_is_read_back(png):
    patch = read_patch(png)
    np.testing.assert_array_equal(patch.pixels, PIXELS)
    assert (patch.record.n_px, patch.record.class_name) == (9, "mug")
    assert patch.size_mm == pytest.approx(9 / 72 * 2.5 * 25.4, abs=1e-3)


def test_the_papers_100_pixels_are_88_mm():
    assert printed_size_mm(100) == pytest.approx(88.19, abs=0.005)
    assert printed_size_mm(300, dpi=300, scale=1) == pytest.approx(25.4)


def mend_hash(png, **fields):
    record = json.loads(png.with_suffix(".json").read_text())
    png.with_suffix(".json").write_text(json.dumps(record | {"png_sha256": sha256_bytes(png.read_bytes())} | fields))


def test_other_pixels_than_recorded_are_refused(png):
    Image.fromarray(PIXELS[::-1]).save(png)
    with pytest.raises(ToolkitError, match=r"mug\.png: its hash \w{12} does not match the record's \w{12}: "):
        read_patch(png)


@pytest.mark.parametrize("content", [b"", b"not a picture", b"\x89PNG\r\n\x1a\n" + b"\0" * 40])
def test_what_is_no_picture_is_refused_even_if_its_record_says_so(png, content):
    png.write_bytes(content)
    with pytest.raises(ToolkitError, match="hash"):
        read_patch(png)
    mend_hash(png)
    with pytest.raises(ToolkitError, match=r"mug\.png: not a readable PNG") as caught:
        read_patch(png)
    assert "\n" not in str(caught.value)


def test_a_decompression_bomb_is_refused(png, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 30)
    with pytest.raises(ToolkitError, match=r"mug\.png: not a readable PNG"):
        read_patch(png)


def test_another_size_than_recorded_is_refused(png):
    Image.fromarray(np.zeros((9, 5, 3), np.uint8)).save(png)
    mend_hash(png)
    with pytest.raises(ToolkitError, match="expected 9×9 px as recorded, found 5×9"):
        read_patch(png)


def test_a_missing_half_is_named(png):
    record = png.with_suffix(".json")
    kept = record.read_bytes()
    record.unlink()
    with pytest.raises(ToolkitError, match=r"mug\.png has no record mug\.json beside it"):
        read_patch(png)
    record.write_bytes(kept)
    png.unlink()
    with pytest.raises(ToolkitError, match=r"cannot read .*mug\.png"):
        read_patch(png)


@pytest.mark.parametrize(
    ("field", "value"), [("png_sha256", "123"), ("n_px", 0), ("size_mm", -1), ("seed", "x"), ("colour", 1)]
)
def test_a_wrong_field_of_the_record_is_named(png, field, value):
    mend_hash(png, **{field: value})
    with pytest.raises(ToolkitError, match=rf"mug\.json: (there is no )?field '{field}'"):
        read_patch(png)
