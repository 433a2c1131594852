"""Going on from given weights: the labels that they had, and the statistics of their batch normalisation."""

import copy
import json
import shutil

import pytest
import torch
from colour_folder import write_colours

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.models.architectures import build_network, imagenet_labels
from toolkit.models.labels import imagenet_wnids
from toolkit.models.load import load_classifier, read_bundled
from toolkit.training.classifier import train_classifier
from toolkit.training.classifier_config import ClassifierConfig
from toolkit.training.classifier_task import are_folded, unfold_norms

ARCH = "cifar_resnet8"
WNIDS = {"red": "n01440764", "green": "n02012849", "blue": "n03126707"}


@pytest.fixture(scope="module")
def init(tmp_path_factory):
    """A network with ImageNet's labels, which knows nothing."""
    file = tmp_path_factory.mktemp("init") / "start.pth"
    torch.manual_seed(0)
    torch.save(build_network(ARCH, 1000).state_dict(), file)
    file.with_suffix(".json").write_text(json.dumps({"labels": imagenet_labels()}))
    return file


@pytest.fixture(scope="module")
def by_wnid(tmp_path_factory):
    folder = write_colours(tmp_path_factory.mktemp("images") / "wnids", 20)
    for colour, wnid in WNIDS.items():
        shutil.move(folder / colour, folder / wnid)
    return folder


def fine_tune(data, init, space, name="tuned", lr=0.02, epochs=4, **changes):
    config = ClassifierConfig(
        name=name, data=(str(data),), arch=ARCH, init=init, image_px=16, held_out=0.25, epochs=epochs, batch=12, lr=lr,
        **changes,
    )  # fmt: skip
    return train_classifier(config, space, device="cpu")


def test_all_labels_are_kept_and_folders_found_among_them(init, by_wnid, tmp_path):
    space = make_workspace(tmp_path)
    record = fine_tune(by_wnid, init, space, keep_labels=True).record
    assert record.labels == imagenet_labels() and record.settings["keep_labels"] is True
    indices = [imagenet_wnids().index(wnid) for wnid in WNIDS.values()]
    assert indices == [0, 134, 517]
    asked = {label for label, share in record.held_out.per_class.items() if share.n}
    assert asked == {"tench", "crane bird", "crane"}
    tuned = load_classifier("tuned", device="cpu", folder=space.classifiers_dir)
    assert tuned.is_imagenet and tuned.describe() == (
        "tuned (cifar_resnet8 trained on photographs of 3 classes from the folder wnids, from the weights start.pth; "
        "ImageNet's 1000 classes)"
    )
    # of a class that is not in the data, the last layer has moved by the loss of all others only
    before, after = torch.load(init)["fc.weight"], tuned.module.fc.weight
    moved = (after - before).norm(dim=1)
    assert moved[indices].min() > 3 * moved[[3, 4, 5]].max() > 0


def test_without_it_the_classes_are_the_folders(init, by_wnid, tmp_path):
    record = fine_tune(by_wnid, init, make_workspace(tmp_path), epochs=1).record
    assert record.labels == sorted(WNIDS.values()) and "keep_labels" not in record.settings


def test_folders_that_are_no_class_of_the_weights(init, tmp_path):
    folder = write_colours(tmp_path / "set", 4)
    with pytest.raises(ToolkitError, match=r"set/blue: 'blue' is not a class of .* \(3 of 3 folders\): .* with init"):
        fine_tune(folder, init, make_workspace(tmp_path / "space"), keep_labels=True)
    with pytest.raises(ToolkitError, match="keep_labels keeps those of init"):
        ClassifierConfig(name="x", data=("rig",), keep_labels=True)


def test_folded_normalisation_is_measured_again():
    """A network is folded as for evaluation; unfolded on the images it had its statistics from, it is itself again."""
    torch.manual_seed(0)
    whole = build_network(ARCH, 5)
    images = torch.rand(64, 3, 16, 16)
    for layer in whole.modules():
        if isinstance(layer, torch.nn.BatchNorm2d):
            layer.momentum = None  # the running statistics are the mean of all batches seen
            torch.nn.init.uniform_(layer.weight, 0.5, 2)
            torch.nn.init.uniform_(layer.bias, -1, 1)
    whole.train()(images)
    whole.eval()
    assert not are_folded(whole)
    folded = copy.deepcopy(whole)
    for layer in folded.modules():
        if isinstance(layer, torch.nn.BatchNorm2d):
            slope = layer.weight.data / (layer.running_var + layer.eps).sqrt()
            layer.bias.data -= slope * layer.running_mean
            layer.weight.data = slope
            layer.running_mean.zero_()
            layer.running_var.fill_(1 - layer.eps)
    expected = whole(images)
    assert are_folded(folded) and torch.allclose(folded(images), expected, atol=1e-4)
    assert (folded.train()(images) - expected).abs().max() > 0.1  # which is why
    for layer in folded.modules():
        if isinstance(layer, torch.nn.BatchNorm2d):
            layer.running_mean.zero_()
            layer.running_var.fill_(1 - layer.eps)
    unfold_norms(folded, [images[:32], images[32:]])
    assert not are_folded(folded) and torch.allclose(folded.eval()(images), expected, atol=1e-4)
    # once more through all layers in training, by the same images: nearly the same, as it was before it was folded
    assert (folded.train()(images) - expected).abs().max() < 0.2 * expected.std()


def test_training_goes_on_from_folded_weights(init, by_wnid, tmp_path, capsys):
    fine_tune(by_wnid, init, make_workspace(tmp_path), "x", lr=0.001, epochs=1)
    said = capsys.readouterr().err.splitlines()
    assert "the batch normalisation of start.pth is folded for evaluation: measuring its statistics again" in said


def test_what_was_trained_before_keeps_its_hash():
    """The settings of a request without any of this are those that the bundled classifier was trained under."""
    before = set(read_bundled().settings) - {"precision", "inputs_sha256"}
    assert set(ClassifierConfig(name="x", data=("rig",)).settings()) == before
