"""Networks for small images: they are what they follow, and are loaded like every other."""

import io
import zipfile

import numpy as np
import pytest
import torch
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.models.architectures import CIFAR10_LABELS, CIFAR_NETWORKS, build_network, published_weights
from toolkit.models.load import load_classifier


# of the CIFAR networks of `robustness` (cifar_models/resnet.py); of ResNet-8 counted by hand:
# 432 + 32, two of 2304 + 32, then (4608 + 9216 + 512 + 192) and four times as much, but for twice the norms, and 650
@pytest.mark.parametrize(
    ("arch", "parameters", "sides"),
    [
        ("cifar_resnet18", 11_173_962, [32, 32, 16, 8, 4]),
        ("cifar_resnet50", 23_520_842, [32, 32, 16, 8, 4]),
        ("cifar_resnet8", 464 + 2 * 2336 + (14336 + 192) + (4 * 14336 + 384) + 650, [32, 32, 16, 8]),
    ],
)
def test_the_networks_are_those_they_follow(arch, parameters, sides):
    module = build_network(arch, 10).eval()
    assert sum(one.numel() for one in module.parameters()) == parameters
    seen = []
    for name in ("conv1", "layer1", "layer2", "layer3", "layer4"):
        if hasattr(module, name):
            getattr(module, name).register_forward_hook(lambda layer, inputs, output: seen.append(output.shape[-1]))
    with torch.no_grad():
        assert module(torch.rand(2, 3, 32, 32)).shape == (2, 10)
    assert seen == sides


@pytest.mark.parametrize("arch", CIFAR_NETWORKS)
def test_their_first_layer_starts_as_the_others_do(arch):
    torch.manual_seed(0)
    weight = build_network(arch, 10).conv1.weight
    assert weight.shape[1:] == (3, 3, 3)
    # He's normal distribution: variance 2 / (output channels × kernel)
    assert weight.std().item() == pytest.approx((2 / (len(weight) * 9)) ** 0.5, rel=0.12)


def test_they_are_loaded_like_every_other(tmp_path):
    file = tmp_path / "own.pth"
    torch.save(build_network("cifar_resnet8", 10).state_dict(), file)
    classifier = load_classifier("cifar_resnet8", file, "cpu")
    assert tuple(classifier.labels) == CIFAR10_LABELS and not classifier.is_imagenet
    assert classifier.preprocess(np.zeros((32, 32, 3), np.uint8)).shape == (3, 32, 32)
    torch.save(build_network("cifar_resnet8", 1000).state_dict(), file)
    assert load_classifier("cifar_resnet8", file, "cpu").labels[7] == "class 7"  # not ImageNet's for the number alone


def test_nobody_publishes_their_weights(monkeypatch):
    monkeypatch.delenv("TOOLKIT_WEIGHTS", raising=False)
    with pytest.raises(ToolkitError, match="train it with 'toolkit train-classifier --arch cifar_resnet50'"):
        load_classifier("cifar_resnet50")


def test_the_normalisation_is_that_of_the_images(shared):
    archive = shared / "images" / "cifar10_half.zip"
    if not archive.is_file():
        pytest.skip("needs images/cifar10_half.zip of the development data")
    with zipfile.ZipFile(archive) as files:
        names = [name for name in files.namelist() if name.startswith("train/")][::50]
        pixels = np.stack([np.asarray(Image.open(io.BytesIO(files.read(name)))) for name in names]) / 255
    how = published_weights("cifar_resnet18").transforms()
    assert len(names) == 500 and pixels.shape[1:] == (32, 32, 3)
    assert pixels.mean((0, 1, 2)) == pytest.approx(how.mean, abs=0.02)
    assert pixels.std((0, 1, 2)) == pytest.approx(how.std, abs=0.01)
