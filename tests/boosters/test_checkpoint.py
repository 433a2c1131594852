import numpy as np
import pytest

from toolkit.boosters.patch_loop import Checkpoint, read_checkpoint, write_checkpoint
from toolkit.core.errors import ToolkitError

STATE = Checkpoint("k" * 64, np.random.default_rng(0).random((3, 9, 9), np.float32), np.array([2.5, 1.5]), np.zeros(2))


@pytest.fixture
def file(tmp_path):
    write_checkpoint(tmp_path / "c.safetensors", STATE)
    return tmp_path / "c.safetensors"


def test_round_trip_is_exact(file):
    back = read_checkpoint(file, STATE.inputs_sha256)
    assert np.array_equal(back.patch, STATE.patch)
    assert back.losses.tolist() == [2.5, 1.5]
    assert back.done == 2
    assert [path.name for path in file.parent.iterdir()] == ["c.safetensors"]


def test_none_where_there_is_none(tmp_path):
    assert read_checkpoint(tmp_path / "none", "k") is None


@pytest.mark.parametrize("keep", [0, 5, 60, -1])
def test_a_cut_file_is_one_clear_line(file, keep):
    file.write_bytes(file.read_bytes()[:keep])
    with pytest.raises(ToolkitError, match=r"checkpoint .* is damaged .*--restart") as caught:
        read_checkpoint(file, STATE.inputs_sha256)
    assert "\n" not in str(caught.value)


def test_a_flipped_bit_is_noticed(file):
    content = bytearray(file.read_bytes())
    content[-40] ^= 1
    file.write_bytes(bytes(content))
    with pytest.raises(ToolkitError, match="do not match its hash"):
        read_checkpoint(file, STATE.inputs_sha256)


def test_a_safetensors_file_of_something_else_is_refused(file):
    from safetensors.numpy import save_file

    save_file({"patch": STATE.patch}, file)
    with pytest.raises(ToolkitError, match="is damaged"):
        read_checkpoint(file, STATE.inputs_sha256)


def test_other_inputs_are_not_mixed(file):
    with pytest.raises(ToolkitError, match="other inputs"):
        read_checkpoint(file, "x" * 64)
