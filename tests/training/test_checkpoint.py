"""One checkpoint format for all that is trained: whole or absent, of its own inputs, and nothing in it is executed."""

import json

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.training.checkpoint import Checkpoint

KEY = "k" * 64
ARRAYS = {
    "parameter.pixels": np.random.default_rng(0).random((3, 9, 9), np.float32),
    "history.loss": np.array([2.5, 1.5]),
    "buffer.count": np.array(3),
}


@pytest.fixture
def kept(tmp_path):
    checkpoint = Checkpoint(tmp_path, KEY)
    checkpoint.write(ARRAYS, "patch", 2)
    return checkpoint


def test_round_trip_is_exact(kept):
    back = kept.read("patch")
    assert back.keys() == ARRAYS.keys()
    assert all(np.array_equal(back[name], array) and back[name].dtype == array.dtype for name, array in ARRAYS.items())
    assert [path.name for path in kept.folder.iterdir()] == ["kkkkkkkkkkkkkkkk.safetensors"]


def test_none_where_there_is_none(tmp_path):
    assert Checkpoint(tmp_path, KEY).read("patch") is None


@pytest.mark.parametrize("keep", [0, 5, 60, -1])
def test_a_cut_file_is_one_clear_line(kept, keep):
    kept.file.write_bytes(kept.file.read_bytes()[:keep])
    with pytest.raises(ToolkitError, match=r"checkpoint .* is damaged .*restart") as caught:
        kept.read("patch")
    assert "\n" not in str(caught.value)


def test_a_flipped_bit_is_noticed(kept):
    content = bytearray(kept.file.read_bytes())
    content[-40] ^= 1
    kept.file.write_bytes(bytes(content))
    with pytest.raises(ToolkitError, match="do not match its hash"):
        kept.read("patch")


def test_a_safetensors_file_of_something_else_is_refused(kept):
    from safetensors.numpy import save_file

    save_file(ARRAYS, kept.file)
    with pytest.raises(ToolkitError, match="is damaged"):
        kept.read("patch")


@pytest.mark.parametrize("format", ["toolkit patch checkpoint 2", "toolkit classifier checkpoint 2"])
def test_a_checkpoint_of_an_earlier_version_is_not_taken_for_one_of_this(kept, format):
    from safetensors.numpy import save

    about = {"format": format, "inputs_sha256": KEY, "steps_done": 2, "content_sha256": "0" * 64}
    kept.file.write_bytes(save(ARRAYS, {"toolkit": json.dumps(about)}))
    with pytest.raises(ToolkitError, match=f"of another version or kind .{format}.: .*restart"):
        kept.read("patch")


def test_other_inputs_and_other_kinds_are_not_mixed(kept):
    other = Checkpoint(kept.folder, KEY[:-1] + "x")
    with pytest.raises(ToolkitError, match="other inputs"):
        other.read("patch")
    with pytest.raises(ToolkitError, match="another version or kind"):
        kept.read("texture")


def test_what_runs_share_goes_with_the_last_of_them(tmp_path):
    folder = tmp_path / ".training" / "jet"
    first, second = (Checkpoint(folder, letter * 64, shared=("data-*", "renders-*.npy")) for letter in "ab")
    for one in (first, second):
        one.write(ARRAYS, "patch", 2)
    (folder / "renders-1.npy").write_bytes(b"x")
    (folder / "data-1").mkdir()
    (folder / "data-1" / "raw").write_bytes(b"x")
    first.remove()
    assert second.file.is_file() and (folder / "data-1" / "raw").is_file() and not first.file.exists()
    second.remove()
    assert list(tmp_path.iterdir()) == []
