"""Weights are found in the documented order, and whatever is wrong with them is said in one line."""

import io
import pickle
import socket
import urllib.error
from zipfile import ZIP_DEFLATED, ZipFile

import pytest
import torch
import torchvision
from one_line import error_of
from safetensors.torch import save_file

from toolkit.core.files import sha256_file
from toolkit.models import weights
from toolkit.models.load import load_classifier

ARCH = "squeezenet1_1"


@pytest.fixture(scope="module")
def state():
    torch.manual_seed(0)
    return torchvision.models.squeezenet1_1().state_dict()


@pytest.fixture(autouse=True)
def empty_machine(tmp_path, monkeypatch):
    """No folder of weights, an empty cache, and no network."""
    monkeypatch.delenv("TOOLKIT_WEIGHTS", raising=False)
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path / "hub"))

    def refuse(*args, **kwargs):
        raise urllib.error.URLError("no network in this test")

    monkeypatch.setattr(torch.hub, "download_url_to_file", refuse)


def test_order_is_named_file_then_folder_then_cache_then_download(tmp_path, state, monkeypatch):
    fetched = []

    def fetch(url, target, prefix, progress):
        fetched.append((url, prefix, socket.getdefaulttimeout()))
        torch.save(state, target)

    monkeypatch.setattr(torch.hub, "download_url_to_file", fetch)
    cached = weights.find_weights(ARCH).path
    assert cached.parent == tmp_path / "hub" / "checkpoints"
    url, prefix, timeout_s = fetched[0]
    assert url.endswith(cached.name)
    assert prefix in cached.name
    assert timeout_s is not None and timeout_s < 60
    assert socket.getdefaulttimeout() is None
    assert weights.find_weights(ARCH).path == cached
    assert len(fetched) == 1

    folder = tmp_path / "folder"
    folder.mkdir()
    save_file(state, folder / f"{ARCH}-mine.safetensors")
    monkeypatch.setenv("TOOLKIT_WEIGHTS", str(folder))
    assert weights.find_weights(ARCH).path == folder / f"{ARCH}-mine.safetensors"

    named = tmp_path / "named.pth"
    torch.save(state, named)
    found = weights.find_weights(ARCH, named)
    assert (found.path, found.sha256, found.name) == (named, sha256_file(named), "named.pth")


def test_where_nothing_answers_the_error_names_every_way():
    message = error_of(lambda: weights.find_weights(ARCH))
    for way in ("with weights", "TOOLKIT_WEIGHTS", f"{ARCH}-*.pth", "cache", "download", "no network in this test"):
        assert way in message


@pytest.mark.parametrize("suffix", [".pth", ".safetensors"])
def test_both_formats_give_the_same_network(tmp_path, state, suffix):
    file = tmp_path / f"net{suffix}"
    if suffix == ".pth":
        torch.save({"state_dict": {f"module.{name}": value for name, value in state.items()}}, file)
    else:
        save_file(state, file)
    classifier = load_classifier(ARCH, file, "cpu")
    loaded = classifier.module.state_dict()
    assert all(torch.equal(loaded[name], value) for name, value in state.items())


def test_a_pickle_with_code_is_refused_and_not_run(tmp_path):
    class Payload:
        def __reduce__(self):
            return (exec, (f"open({str(tmp_path / 'ran')!r}, 'w')",))

    file = tmp_path / "evil.pth"
    torch.save({"fc.weight": Payload()}, file)
    assert "not loaded for safety" in error_of(lambda: load_classifier(ARCH, file, "cpu"))
    assert not (tmp_path / "ran").exists()


def pickle_of(*parts: bytes) -> bytes:
    """A checkpoint in torch's older format, without its storages, of which the last pickle was made by hand."""
    numbers = [pickle.dumps(one, 2) for one in (0x1950A86A20F9469CFC6C, 1001, {"little_endian": True})]
    return b"".join([*numbers, b"\x80\x02", *parts])


PICKLES = {
    "an empty stack": pickle_of(b"s."),
    "a name that was never kept": pickle_of(b"h\x07."),
    "no list": pickle_of(b"Na."),
    "100 GB": pickle_of(b"c__builtin__\nbytearray\n", pickle.dumps(10**11, 2)[2:-1], b"\x85R."),
    "an operation that is none": pickle_of(b"\xff."),
    "no end": pickle_of(b"}" * 1000),
    "a key that cannot be": pickle_of(b"}}Ns."),
}


@pytest.mark.parametrize("case", PICKLES)
def test_a_pickle_that_was_made_by_hand_is_one_line(tmp_path, case):
    (tmp_path / "net.pth").write_bytes(PICKLES[case])
    line = error_of(lambda: load_classifier(ARCH, tmp_path / "net.pth", "cpu"))
    assert "net.pth" in line and "weights_only" not in line and "Error" not in line


def test_a_checkpoint_that_was_blown_up_is_refused(tmp_path):
    torch.save({"fc.weight": torch.zeros(1000, 1000)}, tmp_path / "whole.pth")
    with ZipFile(tmp_path / "whole.pth") as source, ZipFile(tmp_path / "bomb.pth", "w", ZIP_DEFLATED) as archive:
        for name in source.namelist():
            archive.writestr(name, source.read(name))
    assert "its parts are compressed" in error_of(lambda: load_classifier(ARCH, tmp_path / "bomb.pth", "cpu"))


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("missing.pth", None, "no such file"),
        ("weights.onnx", b"x", ".safetensors"),
        ("empty.pth", b"", "damaged"),
        ("noise.pth", b"\x00noise" * 100, "damaged"),
        ("noise.safetensors", b"\x00noise" * 100, "damaged"),
        ("number.pth", pickle.dumps(3, protocol=2), "number.pth"),
    ],
)
def test_bad_files(tmp_path, name, content, expected):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    message = error_of(lambda: load_classifier(ARCH, tmp_path / name, "cpu"))
    assert expected in message and name in message


def test_truncated_file(tmp_path, state):
    buffer = io.BytesIO()
    torch.save(state, buffer)
    (tmp_path / "cut.pth").write_bytes(buffer.getvalue()[:100_000])
    assert "damaged" in error_of(lambda: load_classifier(ARCH, tmp_path / "cut.pth", "cpu"))


def test_weights_of_another_network(tmp_path, state):
    torch.save(state, tmp_path / "squeeze.pth")
    assert "with model" in error_of(lambda: load_classifier("resnet18", tmp_path / "squeeze.pth", "cpu"))
    assert "with model" in error_of(lambda: load_classifier("squeezenet1_0", tmp_path / "squeeze.pth", "cpu"))


def test_weights_that_are_not_numbers(tmp_path, state):
    broken = {**state, "classifier.1.bias": torch.full((1000,), float("nan"))}
    torch.save(broken, tmp_path / "nan.pth")
    assert "not a number" in error_of(lambda: load_classifier(ARCH, tmp_path / "nan.pth", "cpu"))


def make_odd(kind, value):
    """A tensor that is none of real, dense numbers that are there."""
    if kind == "quantised":
        return torch.quantize_per_tensor(value, 1.0, 0, torch.qint8)
    return {"complex": value.to(torch.complex64), "sparse": value.to_sparse(), "absent": value.to("meta")}[kind]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["complex", "sparse", "absent", "quantised"])
def test_values_that_no_network_takes_are_one_line(tmp_path, state, kind):
    torch.save({**state, "classifier.1.bias": make_odd(kind, state["classifier.1.bias"])}, tmp_path / "odd.pth")
    assert "no state dict of plain real numbers" in error_of(lambda: load_classifier(ARCH, tmp_path / "odd.pth", "cpu"))


@pytest.mark.parametrize("name", [1, ("a",), 2.5, None])
def test_names_that_are_no_text_are_one_line(tmp_path, state, name):
    torch.save({**state, name: torch.zeros(2)}, tmp_path / "odd.pth")
    assert "no state dict of plain real numbers" in error_of(lambda: load_classifier(ARCH, tmp_path / "odd.pth", "cpu"))


@pytest.mark.parametrize("rows", [10**7, 10**12, 10**15])
def test_a_layer_that_is_larger_than_its_file_is_one_line(tmp_path, state, rows):
    """One number of the file stands for all of them."""
    wide = state | {"fc.weight": torch.zeros(1).expand(rows, 512), "fc.bias": torch.zeros(1).expand(rows)}
    torch.save(wide, tmp_path / "wide.pth")
    line = error_of(lambda: load_classifier("resnet18", tmp_path / "wide.pth", "cpu"))
    assert f"wide.pth: 'fc.weight' is {rows}×512, which a file of " in line and "save it again" in line


def test_a_single_number_for_a_layer_is_one_line(tmp_path, state):
    torch.save({**state, "classifier.1.weight": torch.tensor(3.0)}, tmp_path / "odd.pth")
    assert "is a single number" in error_of(lambda: load_classifier(ARCH, tmp_path / "odd.pth", "cpu"))
