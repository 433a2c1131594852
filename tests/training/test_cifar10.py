"""CIFAR-10 in torchvision's own files: read as they are, and never opened where they are not."""

import hashlib
import pickle

import numpy as np
import pytest
from torchvision.datasets import CIFAR10
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.training.data import RenderCounts, list_classes, open_source
from toolkit.training.images import open_cifar

LABELS = ("cat", "dog", "ship")
PIXELS = {
    name: np.random.default_rng(k).integers(0, 256, (6, 3, 32, 32), np.uint8)
    for k, name in enumerate(("data_batch_1", "data_batch_2", "test_batch"))
}


class Trap:
    """Opening a pickle of this runs code: it makes a file."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return (open, (str(self.file), "w"))


@pytest.fixture
def cifar(tmp_path, monkeypatch):
    """A folder of eighteen images, and torchvision taught that it is the whole of CIFAR-10."""
    place = tmp_path / "data" / CIFAR10.base_folder
    place.mkdir(parents=True)
    sums = {}
    batches = {name: {"data": pixels.reshape(6, -1), "labels": [0, 1, 2, 0, 1, 2]} for name, pixels in PIXELS.items()}
    for name, content in {**batches, "batches.meta": {"label_names": list(LABELS)}}.items():
        (place / name).write_bytes(pickle.dumps(content))
        sums[name] = hashlib.md5((place / name).read_bytes()).hexdigest()
    monkeypatch.setattr(CIFAR10, "train_list", [[name, sums[name]] for name in ("data_batch_1", "data_batch_2")])
    monkeypatch.setattr(CIFAR10, "test_list", [["test_batch", sums["test_batch"]]])
    monkeypatch.setattr(CIFAR10, "meta", {**CIFAR10.meta, "md5": sums["batches.meta"]})
    monkeypatch.setattr(CIFAR10, "url", "http://127.0.0.1:9/cifar-10-python.tar.gz")
    return place.parent


def test_pixels_classes_and_labels_are_the_files(cifar):
    for folder in (cifar, cifar / CIFAR10.base_folder):
        train, test = open_cifar(folder, "train"), open_cifar(folder, "test")
        assert train.labels == LABELS and train.pixels.dtype == np.uint8
        expected = np.concatenate([PIXELS["data_batch_1"], PIXELS["data_batch_2"]]).transpose(0, 2, 3, 1)
        np.testing.assert_array_equal(train.pixels, expected)
        np.testing.assert_array_equal(test.pixels[4], PIXELS["test_batch"][4].transpose(1, 2, 0))
        assert train.classes.tolist() == [0, 1, 2] * 4 and test.classes.tolist() == [0, 1, 2] * 2
    assert open_cifar(cifar, "test", download=True).labels == LABELS  # it is there: nothing is fetched
    with pytest.raises(ToolkitError, match="no split of CIFAR-10 called 'val'"):
        open_cifar(cifar, "val")


@pytest.mark.parametrize("name", ["data_batch_2", "test_batch", "batches.meta"])
@pytest.mark.parametrize("download", [False, True])
def test_a_foreign_file_is_never_opened(name, download, cifar, tmp_path):
    sprung = tmp_path / "sprung"
    file = cifar / CIFAR10.base_folder / name
    file.write_bytes(pickle.dumps(Trap(sprung)))
    message = "cannot fetch CIFAR-10 from http" if download else f"{name} is damaged or not CIFAR-10's"
    for split in ("train", "test"):
        with pytest.raises(ToolkitError, match=message if name != "batches.meta" else name):
            open_cifar(cifar, split, download and name != "batches.meta")
    assert not sprung.exists()
    pickle.loads(file.read_bytes()).close()
    assert sprung.exists()  # the trap works


def test_what_is_not_there(cifar, tmp_path):
    (cifar / CIFAR10.base_folder / "data_batch_1").unlink()
    with pytest.raises(ToolkitError, match=r"data_batch_1 is missing: unpack .* or fetch it with download"):
        open_cifar(cifar, "test")
    with pytest.raises(ToolkitError, match="no folder cifar-10-batches-py in it"):
        open_cifar(tmp_path / "nowhere", "test")
    with pytest.raises(ToolkitError, match=r"cannot fetch .* put cifar-10-python.tar.gz into") as caught:
        open_cifar(tmp_path / "nowhere", "test", download=True)
    assert "\n" not in str(caught.value)


def test_it_is_a_source_of_training_images(cifar, tmp_path):
    counts = RenderCounts(1, 1, 0.1, 0, 32)
    source = open_source(f"cifar10:{cifar}", make_workspace(tmp_path / "space"), counts)
    assert list_classes([source]).labels == LABELS
    assert [one.label for one in source.held_out] == list(LABELS) * 2 and len(source.train) == 12
    np.testing.assert_array_equal(source.train[7].pixels, PIXELS["data_batch_2"][1].transpose(1, 2, 0))


def test_a_network_is_trained_on_it(cifar, tmp_path):
    space = make_workspace(tmp_path / "space")
    arguments = ["train-classifier", "--data", f"cifar10:{cifar}", "--name", "mine", "--arch", "cifar_resnet8"]
    arguments += ["--image-px", "32", "--epochs", "1", "--batch", "4", "--workspace", str(space.root), "--quiet"]
    result = CliRunner().invoke(app, [*arguments, "--device", "cpu"])
    assert result.exit_code == 0, result.output
    assert "of 6 correct" in result.output and "CIFAR-10's test images" in " ".join(result.output.split())
