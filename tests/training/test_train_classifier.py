"""Training a classifier: it learns what there is, resumes to the same bytes, and its record tells the truth."""

import json

import numpy as np
import pytest
import torch
from colour_folder import write_colours
from killed_runs import train_killed
from PIL import Image
from safetensors.torch import load_file

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.statistics import wilson_interval
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.models.load import load_classifier
from toolkit.training.classifier import train_classifier
from toolkit.training.classifier_config import ClassifierConfig
from toolkit.training.classifier_task import ClassifierTask, find_finished, start_network

QUICK = {"image_px": 16, "held_out": 0.4, "epochs": 5, "batch": 12, "lr": 0.02}
CPU = {"device": "cpu"}


@pytest.fixture(scope="module")
def space(tmp_path_factory):
    return make_workspace(tmp_path_factory.mktemp("space"))


@pytest.fixture(scope="module")
def colours(tmp_path_factory):
    return write_colours(tmp_path_factory.mktemp("images") / "colours", 36)


@pytest.fixture(scope="module")
def trained(space, colours):
    return train_classifier(ClassifierConfig(name="own", data=(str(colours),), **QUICK), space, **CPU)


def tiny_config(colours, **changes):
    """A network with dropout and batch normalisation, a few steps."""
    settings = {"name": "tiny", "arch": "mobilenet_v3_small", "image_px": 32, "epochs": 1, "batch": 16, "lr": 0.02}
    return ClassifierConfig(data=(str(colours),), **(settings | changes))


@pytest.mark.slow
def test_it_learns_colours_and_nothing_from_shuffled_ones(trained, tmp_path):
    assert trained.record.held_out.accuracy > 0.8
    folder = write_colours(tmp_path / "shuffled", 36, shuffled=True)
    config = ClassifierConfig(name="none", data=(str(folder),), **(QUICK | {"epochs": 3}))
    held_out = train_classifier(config, make_workspace(tmp_path / "space"), **CPU).record.held_out
    assert held_out.n == 42
    assert held_out.accuracy < 0.6  # of 42 at a chance of a third: 4 standard deviations below


def test_the_record_is_of_the_file(trained, space):
    record = json.loads((space.classifiers_dir / "own.json").read_text())
    assert trained.file == space.classifiers_dir / "own.safetensors"
    assert record["sha256"] == sha256_file(trained.file)
    assert {value.dtype for value in load_file(trained.file).values() if value.is_floating_point()} == {torch.float16}
    assert trained.file.stat().st_size < 25e6
    assert record["labels"] == ["blue", "green", "red"] and record["arch"] == "resnet18"
    assert record["data"]["trained_on"]["images"] == 66 and record["data"]["held_out"]["images"] == 42
    assert record["settings"]["epochs"] == 5 and record["settings"]["augmentation"]["shift"] == 0.1
    assert not list(space.classifiers_dir.glob(".training"))


def test_its_accuracy_is_that_of_the_loaded_file(trained, space, colours, tmp_path):
    """Classify every image of the folder with the loaded file: the held-out ones are among them, at most all wrong."""
    classifier = load_classifier("own", device="cpu", folder=space.classifiers_dir)
    assert classifier.name == "own" and classifier.labels == trained.record.labels
    assert classifier.describe() == (
        "own (resnet18 trained on photographs of 3 classes from the folder colours; 3 classes, not ImageNet's)"
    )
    assert next(classifier.module.parameters()).dtype == torch.float32
    right = total = 0
    for file in colours.glob("*/*.png"):
        batch = classifier.preprocess(np.asarray(Image.open(file)))[None]
        right += classifier.labels[int(classifier.logits(batch).argmax())] == file.parent.name
        total += 1
    held_out = trained.record.held_out
    assert total == 108 and right >= held_out.correct
    assert held_out.correct == sum(one.correct for one in held_out.per_class.values())
    assert held_out.ci95 == pytest.approx(wilson_interval(held_out.correct, held_out.n))
    assert held_out.n - held_out.correct == sum(count for _, _, count in held_out.confusions)


def test_the_same_again_is_nothing_to_do_and_another_seed_is_not(trained, space, colours):
    before = trained.file.read_bytes()
    config = ClassifierConfig(name="own", data=(str(colours),), **QUICK)
    assert train_classifier(config, space, **CPU).was_finished
    assert trained.file.read_bytes() == before


KILLED = """
import sys
from pathlib import Path
from dying import die_at_step
from toolkit.core.workspace import make_workspace
from toolkit.training.classifier import train_classifier
from toolkit.training.classifier_config import ClassifierConfig
from toolkit.training.classifier_task import ClassifierTask

die_at_step(ClassifierTask, 3)
config = ClassifierConfig(
    name="tiny", data=(sys.argv[2],), arch="mobilenet_v3_small", image_px=32, epochs=1, batch=16, lr=0.02
)
train_classifier(config, make_workspace(Path(sys.argv[1])), device="cpu", checkpoint_every_s=0)
"""


@pytest.mark.slow
def test_kill_9_then_the_same_again_ends_with_the_same_bytes(colours, tmp_path, capsys, one_thread):
    train_killed(KILLED, tmp_path / "resumed", colours)
    straight = train_classifier(tiny_config(colours), make_workspace(tmp_path / "straight"), **CPU)
    space = Workspace(tmp_path / "resumed")
    assert not (space.classifiers_dir / "tiny.safetensors").exists()
    capsys.readouterr()
    resumed = train_classifier(tiny_config(colours), space, **CPU)
    assert straight.resumed_from == 0
    assert resumed.resumed_from == 3 and "going on after step 3 of 6" in capsys.readouterr().err
    for suffix in (".safetensors", ".json"):
        one, other = (r.file.with_suffix(suffix).read_bytes() for r in (straight, resumed))
        assert one == other
    assert not (space.classifiers_dir / ".training").exists()


def test_ctrl_c_in_the_middle_of_a_step_keeps_the_steps_before_it(colours, tmp_path, monkeypatch):
    """The forward pass has moved the statistics of batch normalisation by then: they are put back."""
    config = tiny_config(colours, arch="cifar_resnet8", image_px=16)

    def interrupted(self, step, usual=ClassifierTask.loss):
        found = usual(self, step)
        if step == 2:
            raise KeyboardInterrupt
        return found

    space = make_workspace(tmp_path / "stopped")
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(ClassifierTask, "loss", interrupted)
        train_classifier(config, space, **CPU)
    resumed = train_classifier(config, space, **CPU)
    whole = train_classifier(config, make_workspace(tmp_path / "whole"), **CPU)
    assert resumed.resumed_from == 2
    assert resumed.file.read_bytes() == whole.file.read_bytes()


@pytest.mark.slow
def test_the_seed_decides(colours, tmp_path):
    files = []
    for seed in (1, 2):
        config = tiny_config(colours, seed=seed)
        files.append(train_classifier(config, make_workspace(tmp_path / str(seed)), **CPU).file.read_bytes())
    assert files[0] != files[1]


def test_init_takes_all_but_the_last_layer(trained, colours, tmp_path):
    from toolkit.models.weights import find_weights

    config = ClassifierConfig(name="next", data=(str(colours),), init=trained.file)
    module = start_network(config, 7, find_weights("resnet18", trained.file))
    given = load_file(trained.file)
    assert torch.equal(module.conv1.weight, given["conv1.weight"].float())
    assert module.fc.weight.shape == (7, 512)
    with pytest.raises(ToolkitError, match=r"init .*own.safetensors: holds no weights of resnet34"):
        start_network(config.with_overrides(arch="resnet34"), 7, find_weights("resnet34", trained.file))


@pytest.mark.slow
@pytest.mark.parametrize("arch", ["mnasnet0_5", "squeezenet1_1"])
def test_other_networks_are_written_and_read_back(arch, colours, tmp_path):
    space = make_workspace(tmp_path)
    trained = train_classifier(tiny_config(colours, name="other", arch=arch), space, **CPU)
    classifier = load_classifier(None, trained.file, "cpu")  # the record says which network
    assert (classifier.arch, classifier.name) == (arch, "other")
    assert find_finished(trained.file, trained.record.settings["inputs_sha256"]) == trained.record


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "a/b"}, "name 'a/b': expected letters"),
        ({"name": "resnet18"}, "there is a network of that name"),
        ({"arch": "resnet81"}, r"no network \(arch\) called 'resnet81': did you mean"),
        ({"image_px": 8}, "image_px 8: expected 16 to 1024"),
    ],
)
def test_requests_that_cannot_be(changes, message):
    with pytest.raises(ToolkitError, match=message):
        ClassifierConfig(**{"name": "x", "data": ("rig",)} | changes)


@pytest.mark.parametrize(("arch", "px"), [("inception_v3", 64), ("vit_b_16", 128), ("alexnet", 32)])
def test_images_too_small_for_the_network(arch, px, colours, space):
    config = ClassifierConfig(name="small", data=(str(colours),), arch=arch, image_px=px)
    with pytest.raises(ToolkitError, match=rf"arch {arch} cannot be trained with image_px {px} .*try image_px"):
        train_classifier(config, space, **CPU)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"epochs": 0}, "epochs 0: expected at least 1"), ({"batch": 1}, "batch 1: expected at least 2, batch norm"),
        ({"lr": 0.0}, "lr 0: expected a number above 0"), ({"weight_decay": 1.0}, "weight_decay 1: expected 0 to"),
        ({"label_smoothing": 1.0}, "label_smoothing 1: expected 0 to below 1"),
        ({"held_out": 1.0}, "held_out 1: expected a share from 0 to below 1"),
    ],
)  # fmt: skip
def test_settings_that_cannot_be(wrong, message):
    with pytest.raises(ToolkitError, match=message):
        ClassifierConfig(name="x", **wrong)


def test_a_learning_rate_that_explodes_is_one_line(colours, tmp_path):
    config = tiny_config(colours, arch="squeezenet1_1", lr=10.0, epochs=6, warm_up=0.01)
    words = r"not a finite number \(loss .*\): train again with restart and a lower lr than 10"
    with pytest.raises(ToolkitError, match=words):
        train_classifier(config, make_workspace(tmp_path), **CPU)
