"""Checkpoints of MadryLab's robustness library, as robust-models-transfer publishes them: the numbers, and no code.

The layout is that of `robustness.train.train_model` and `robustness.attacker.AttackerModel`.
"""

import io
import pickle
import sys
from collections import OrderedDict
from types import ModuleType

import numpy as np
import pytest
import safetensors.torch
import torch
import torchvision
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.models.labels import read_labels_file
from toolkit.models.load import load_classifier
from toolkit.models.weights import SUFFIXES, open_weights
from toolkit.training.classifier_config import ClassifierConfig
from toolkit.training.classifier_task import start_network

ARCH = "squeezenet1_1"
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class InputNormalize(torch.nn.Module):
    """Buffers of shape (3, 1, 1), as in robustness.tools.helpers."""

    def __init__(self, mean, std):
        super().__init__()
        self.register_buffer("new_mean", torch.tensor(mean)[..., None, None])
        self.register_buffer("new_std", torch.tensor(std)[..., None, None])

    def forward(self, images):
        return (images - self.new_mean) / self.new_std


class DummyModel(torch.nn.Module):
    """What torchvision's other networks than ResNets were put in."""

    def __init__(self, model):
        super().__init__()
        self.model = model


class Attacker(torch.nn.Module):
    def __init__(self, model, mean, std):
        super().__init__()
        self.normalize = InputNormalize(mean, std)
        self.model = model


class AttackerModel(torch.nn.Module):
    """Normaliser, classifier, and the attacker with its copies of both."""

    def __init__(self, model, mean=MEAN, std=STD):
        super().__init__()
        self.normalizer = InputNormalize(mean, std)
        self.model = model
        self.attacker = Attacker(model, mean, std)

    def forward(self, images):
        return self.model(self.normalizer(images))


def make_network(arch=ARCH, classes=1000, seed=0):
    torch.manual_seed(seed)
    return torchvision.models.get_model(arch, weights=None, num_classes=classes).eval()


def make_checkpoint(attacker, parallel=True, **more):
    """As `train_model` saves it, after one step of SGD."""
    parameters = list(attacker.model.parameters())
    optimizer = torch.optim.SGD(parameters, 0.1, momentum=0.9, weight_decay=1e-4)
    for one in parameters[:2]:
        one.grad = torch.ones_like(one)
    optimizer.step()
    schedule = torch.optim.lr_scheduler.StepLR(optimizer, 30)
    module = torch.nn.DataParallel(attacker) if parallel else attacker
    return {
        "model": module.state_dict(), "optimizer": optimizer.state_dict(), "schedule": schedule.state_dict(),
        "epoch": 90, "amp": "N/A", "nat_prec1": torch.tensor(53.1), "adv_prec1": torch.tensor(31.0), **more,
    }  # fmt: skip


def error_of(file, model=ARCH):
    with pytest.raises(ToolkitError) as caught:
        load_classifier(model, file, "cpu")
    assert "\n" not in str(caught.value) and file.name in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("zipped", [True, False], ids=["zip", "before torch 1.6"])
@pytest.mark.parametrize("parallel", [True, False])
@pytest.mark.parametrize("dummy", [True, False])
def test_the_classifier_and_its_normalisation_are_taken(tmp_path, zipped, parallel, dummy):
    network, file = make_network(), tmp_path / f"{ARCH}_l2_eps3.ckpt"
    attacker = AttackerModel(DummyModel(network) if dummy else network)
    torch.save(make_checkpoint(attacker, parallel), file, _use_new_zipfile_serialization=zipped)
    classifier = load_classifier(ARCH, file, "cpu")
    images = torch.rand(2, 3, 224, 224)
    with torch.no_grad():
        expected = network(attacker.normalizer(images))
        assert torch.allclose(classifier.logits(images), expected, atol=1e-5)
    assert classifier.is_imagenet and classifier.labels[895] == "warplane"
    how = classifier.preprocessing
    assert (how.crop_px, how.mean, how.std) == (224, MEAN, STD)
    assert classifier.weights.name == file.name


def test_the_normalisation_of_the_checkpoint_wins(tmp_path):
    mean, std = (0.5, 0.25, 0.125), (0.3, 0.2, 0.1)
    network, file = make_network(), tmp_path / "own.ckpt"
    attacker = AttackerModel(network, mean, std)
    torch.save(make_checkpoint(attacker), file)
    classifier = load_classifier(ARCH, file, "cpu")
    images = torch.rand(2, 3, 224, 224)
    with torch.no_grad():
        assert torch.allclose(classifier.logits(images), attacker(images), atol=1e-5)
    file.with_suffix(".toml").write_text(f'architecture = "{ARCH}"\nmean = {list(mean)}\n')
    assert load_classifier(None, file, "cpu").preprocessing.std == std
    file.with_suffix(".toml").write_text("mean = [0.485, 0.456, 0.406]\n")
    message = error_of(file)
    assert "own.toml: field 'mean'" in message and "[0.5, 0.25, 0.125]" in message and "leave the field out" in message


def test_the_classifier_is_preferred_to_the_attackers_copy(tmp_path):
    """They are one network; which is read is settled where a file holds two, or the attacker's alone."""
    network, other = make_network(seed=0).state_dict(), make_network(seed=1).state_dict()
    normaliser = InputNormalize(MEAN, STD).state_dict()
    own = {f"module.model.{name}": value for name, value in network.items()}
    copy = {f"module.attacker.model.{name}": value for name, value in other.items()}
    first = {f"module.normalizer.{name}": value for name, value in normaliser.items()}
    second = {f"module.attacker.normalize.{name}": value for name, value in normaliser.items()}
    for state, expected in (({**copy, **second, **own, **first}, network), ({**copy, **second}, other)):
        torch.save({"model": state}, tmp_path / "net.ckpt")
        loaded = load_classifier(ARCH, tmp_path / "net.ckpt", "cpu").module.state_dict()
        assert all(torch.equal(loaded[name], value) for name, value in expected.items())


@pytest.mark.parametrize("parallel", [True, False])
def test_versions_of_layers_come_along(tmp_path, parallel):
    """MnasNet does not load without its own; DataParallel's names hid them."""
    network = make_network("mnasnet1_0")
    torch.save(make_checkpoint(AttackerModel(DummyModel(network)), parallel), tmp_path / "net.ckpt")
    loaded = load_classifier("mnasnet1_0", tmp_path / "net.ckpt", "cpu").module.state_dict()
    assert all(torch.equal(loaded[name], value) for name, value in network.state_dict().items())
    torch.save(torch.nn.DataParallel(network).state_dict(), tmp_path / "plain.pth")
    assert load_classifier("mnasnet1_0", tmp_path / "plain.pth", "cpu")


@pytest.mark.parametrize("versions", [["1"], {"": 2}, {1: {"version": 1}}])
def test_versions_that_are_none_are_left_out(tmp_path, versions):
    state = make_network().state_dict()
    state._metadata = versions
    torch.save(state, tmp_path / "odd.pth")
    assert load_classifier(ARCH, tmp_path / "odd.pth", "cpu")


def test_the_older_key_is_read(tmp_path):
    checkpoint = make_checkpoint(AttackerModel(make_network()))
    torch.save({"state_dict": checkpoint["model"], "epoch": 3}, tmp_path / "net.pt")
    assert load_classifier(ARCH, tmp_path / "net.pt", "cpu").preprocessing.mean == MEAN


class Payload:
    """Writes a file when it is unpickled."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return (exec, (f"open({str(self.file)!r}, 'w')",))


@pytest.mark.parametrize("place", ["schedule", "model", "extra"])
@pytest.mark.parametrize("zipped", [True, False])
def test_code_in_a_checkpoint_does_not_run(tmp_path, place, zipped):
    checkpoint = make_checkpoint(AttackerModel(make_network()))
    if place == "model":
        checkpoint["model"]["module.model.classifier.1.bias"] = Payload(tmp_path / "ran")
    else:
        checkpoint[place] = Payload(tmp_path / "ran")
    file = tmp_path / "evil.ckpt"
    torch.save(checkpoint, file, _use_new_zipfile_serialization=zipped)
    message = error_of(file)
    assert "not loaded for safety" in message and "exec" in message and not (tmp_path / "ran").exists()


@pytest.fixture
def dill(monkeypatch):
    """Stands for dill, which is not installed: a function of it by name, and pickle's own interface."""
    module = ModuleType("dill._dill")
    module._create_function = lambda *parts: parts

    class Function:
        def __reduce__(self):
            return (module._create_function, ("code",))

    module._create_function.__module__, module._create_function.__qualname__ = "dill._dill", "_create_function"
    module.Function = Function
    for name, value in {"dill": ModuleType("dill"), "dill._dill": module}.items():
        monkeypatch.setitem(sys.modules, name, value)
    sys.modules["dill"].__version__ = "0.3.9"
    sys.modules["dill"].__dict__.update(
        {name: getattr(pickle, name) for name in ("load", "Unpickler", "dump", "Pickler")}
    )
    return module


def test_what_dill_pickled_is_refused_with_a_way_out_that_works(tmp_path, dill, monkeypatch):
    network, file = make_network(), tmp_path / "cifar_l2_0_5.pt"
    checkpoint = make_checkpoint(AttackerModel(network), schedule=dill.Function())
    torch.save(checkpoint, file)
    message = error_of(file)
    assert "dill._dill._create_function" in message and "weights_only" not in message
    monkeypatch.chdir(tmp_path)
    exec(message.partition("numbers alone with ")[2].partition(", and load")[0],
         {"safetensors": safetensors, "checkpoint": checkpoint})  # fmt: skip
    loaded = load_classifier(ARCH, tmp_path / "NEW.safetensors", "cpu")
    assert all(torch.equal(loaded.module.state_dict()[name], value) for name, value in network.state_dict().items())


@pytest.mark.parametrize("zipped", [True, False])
@pytest.mark.parametrize("share", [0.01, 0.3, 0.9, 0.999])
def test_a_cut_checkpoint_is_one_line(tmp_path, zipped, share):
    buffer, file = io.BytesIO(), tmp_path / "cut.ckpt"
    torch.save(make_checkpoint(AttackerModel(make_network())), buffer, _use_new_zipfile_serialization=zipped)
    file.write_bytes(buffer.getvalue()[: int(share * buffer.tell())])
    assert "cut.ckpt" in error_of(file)


def test_another_architecture_is_one_line(tmp_path):
    torch.save(make_checkpoint(AttackerModel(make_network())), tmp_path / "net.ckpt")
    assert "holds no weights of resnet18" in error_of(tmp_path / "net.ckpt", "resnet18")
    assert "holds no weights of resnet18" in error_of(tmp_path / "net.ckpt", None)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("new_mean", torch.zeros(1, 1, 1)),
        ("new_std", torch.zeros(3, 1, 1)),
        ("new_mean", torch.full((3,), float("nan"))),
    ],
)
def test_a_normaliser_that_cannot_be_is_one_line(tmp_path, name, value):
    checkpoint = make_checkpoint(AttackerModel(make_network()))
    checkpoint["model"][f"module.normalizer.{name}"] = torch.nn.Parameter(value)
    torch.save(checkpoint, tmp_path / "net.ckpt")
    assert f"'normalizer.{name}': expected a number for each of three colours" in error_of(tmp_path / "net.ckpt")


def test_a_normaliser_without_a_network_is_one_line(tmp_path):
    torch.save({"model": InputNormalize(MEAN, STD).state_dict()}, tmp_path / "net.ckpt")
    normaliser = {f"normalizer.{name}": value for name, value in InputNormalize(MEAN, STD).state_dict().items()}
    torch.save({"model": OrderedDict(normaliser)}, tmp_path / "bare.ckpt")
    assert "holds no weights" in error_of(tmp_path / "net.ckpt")
    assert "holds no weights" in error_of(tmp_path / "bare.ckpt")


def test_training_starts_from_one(tmp_path):
    network = make_network("resnet18", 5)
    torch.save(make_checkpoint(AttackerModel(network)), tmp_path / "net.ckpt")
    config = ClassifierConfig(name="own", init=tmp_path / "net.ckpt")
    started = start_network(config, 5, open_weights(tmp_path / "net.ckpt"))
    assert all(torch.equal(started.state_dict()[name], value) for name, value in network.state_dict().items())


def test_the_workspaces_checkpoints_are_listed(tmp_path, monkeypatch):
    space = make_workspace(tmp_path / "space")
    monkeypatch.delenv("TOOLKIT_WEIGHTS", raising=False)
    space.classifiers_dir.mkdir(parents=True, exist_ok=True)
    file = space.classifiers_dir / "robust_l2_eps3.ckpt"
    torch.save(make_checkpoint(AttackerModel(make_network("squeezenet1_1", 3))), file)
    file.with_suffix(".toml").write_text(
        f'architecture = "{ARCH}"\nlabels = ["a", "b", "c"]\nlicence = "MIT"\nname = "r3"\n'
    )
    listed = CliRunner().invoke(
        app, ["models", "--model", file.stem, "--workspace", str(space.root), "--device", "cpu"]
    )
    assert listed.exit_code == 0, listed.output
    assert "robust_l2_eps3" in listed.output and "MIT" in listed.output
    found = load_classifier(file.stem, device="cpu", folder=space.classifiers_dir)
    assert found.name == "r3" and found.labels == ["a", "b", "c"]
    assert np.allclose(found.preprocessing.mean, MEAN) and read_labels_file(file).arch == ARCH and ".ckpt" in SUFFIXES


def test_learning_rates_that_numpy_made_are_refused_with_the_same_way_out(tmp_path):
    """Of a cyclic schedule: numpy's scalars are objects, though they are numbers."""
    torch.save(
        make_checkpoint(AttackerModel(make_network()), schedule={"_last_lr": [np.float64(0.1)]}), tmp_path / "net.ckpt"
    )
    assert "(numpy." in (message := error_of(tmp_path / "net.ckpt")) and "save_file(" in message
