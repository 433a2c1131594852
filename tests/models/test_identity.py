"""Which network it is: by its numbers however they are saved, its labels and its preprocessing."""

from collections import OrderedDict
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from tiny_network import tiny_classifier

from toolkit.models.identity import (
    KNOWN_TENSORS,
    describe_network,
    find_file_tensors,
    hash_network_tensors,
    hash_tensors,
    is_same_network,
)
from toolkit.models.weights import open_weights, read_state_dict
from toolkit.objects.records import NetworkRecord

WEIGHTS = Path(__file__).parents[2].parent / "shared/weights"


def save_every_way(folder, state):
    """The same numbers in files of other bytes."""
    torch.save(state, folder / "a.pth")
    torch.save({"state_dict": {f"module.{name}": value for name, value in state.items()}, "epoch": 3}, folder / "b.pth")
    torch.save(OrderedDict(reversed(state.items())), folder / "c.pth", _use_new_zipfile_serialization=False)
    save_file({name: value.contiguous() for name, value in state.items()}, folder / "d.safetensors")
    return [open_weights(file) for file in sorted(folder.iterdir())]


def test_numbers_saved_again_are_the_same_network(tmp_path):
    network = tiny_classifier()
    files = save_every_way(tmp_path, network.module.state_dict())
    assert len({file.sha256 for file in files}) == 4
    assert {hash_tensors(read_state_dict(file)) for file in files} == {hash_network_tensors(network)}
    assert hash_network_tensors(tiny_classifier(1)) != hash_network_tensors(network)


def test_one_changed_number_is_another_network():
    network = tiny_classifier()
    before = hash_network_tensors(network)
    with torch.no_grad():
        next(network.module.parameters()).view(-1)[0] += 1e-6
    assert hash_network_tensors(network) != before


def test_counters_and_layout_do_not_matter():
    state = torch.nn.BatchNorm2d(3).state_dict()
    without = {name: value for name, value in state.items() if not name.endswith("num_batches_tracked")}
    assert hash_tensors(state) == hash_tensors(without)
    plain = {"w": torch.rand(2, 3, 4, 4)}
    assert hash_tensors({"w": plain["w"].to(memory_format=torch.channels_last)}) == hash_tensors(plain)
    assert hash_tensors({"n": torch.tensor(3)}) is None


def test_the_network_id_stands_for_all_four():
    network = tiny_classifier()
    others = [
        replace(network, labels=network.labels[::-1]), replace(network, arch="other"), tiny_classifier(1),
        replace(network, preprocessing=replace(network.preprocessing, channels="BGR")),
    ]  # fmt: skip
    ids = {describe_network(one)["network_id"] for one in (network, *others)}
    assert len(ids) == 5
    same = replace(network, name="called otherwise", weights=replace(network.weights, sha256="cd" * 32))
    assert describe_network(same)["network_id"] == describe_network(network)["network_id"]


def test_a_record_names_a_network_by_its_file_or_its_numbers(tmp_path):
    network = tiny_classifier()
    files = save_every_way(tmp_path, network.module.state_dict())
    tensors = hash_network_tensors(network)
    new = NetworkRecord(arch="tiny", weights="a.pth", sha256=files[0].sha256, tensors_sha256=tensors)
    old = NetworkRecord(arch="tiny", weights="a.pth", sha256=files[0].sha256)
    again = files[3].sha256
    assert is_same_network(new, again, tensors) and is_same_network(old, files[0].sha256, None)
    # the older record's own file is at hand, and is hashed
    assert is_same_network(old, again, tensors, tmp_path) and not is_same_network(old, again, tensors)
    assert not is_same_network(new, again, hash_network_tensors(tiny_classifier(1)))
    # another file of that name says nothing
    assert find_file_tensors("b.pth", files[0].sha256, tmp_path) is None
    assert find_file_tensors("../a.pth", files[0].sha256, tmp_path) is None


def test_an_older_record_is_written_as_it_was():
    assert NetworkRecord(arch="a", weights="w", sha256="s").model_dump() == {"arch": "a", "weights": "w", "sha256": "s"}


@pytest.mark.parametrize("sha256", KNOWN_TENSORS)
def test_the_known_hashes_follow_from_the_files(sha256):
    files = [open_weights(file) for file in WEIGHTS.glob("*.pth")] if WEIGHTS.is_dir() else []
    file = next((file for file in files if file.sha256 == sha256), None)
    if file is None:
        pytest.skip("needs the weights beside the checkout")
    assert hash_tensors(read_state_dict(file)) == KNOWN_TENSORS[sha256]
