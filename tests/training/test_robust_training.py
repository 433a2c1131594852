"""Training under attack: the network becomes robust, the record says how much, and the attack leaves no trace."""

import json

import numpy as np
import pytest
import torch
from colour_folder import write_colours
from PIL import Image
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.statistics import wilson_interval
from toolkit.core.workspace import make_workspace
from toolkit.models.load import load_classifier
from toolkit.training.classifier import train_classifier
from toolkit.training.classifier_config import Attack, ClassifierConfig
from toolkit.training.classifier_task import ClassifierTask, find_worst_images

SMALL = {"arch": "cifar_resnet8", "image_px": 16, "held_out": 0.4, "batch": 12, "lr": 0.02}


@pytest.fixture(scope="module")
def colours(tmp_path_factory):
    return write_colours(tmp_path_factory.mktemp("images") / "colours", 24)


def train(space, colours, **changes):
    config = ClassifierConfig(name="own", data=(str(colours),), **{"epochs": 2, **SMALL, **changes})
    return train_classifier(config, space, device="cpu")


@pytest.fixture(scope="module")
def pair(colours, tmp_path_factory):
    """A network trained as usual and a robust one, each with its workspace."""
    spaces = [make_workspace(tmp_path_factory.mktemp(name)) for name in ("plain", "robust")]
    made = [train(space, colours, epochs=6, robust=how) for space, how in zip(spaces, (None, "l2:2"), strict=True)]
    return list(zip(spaces, made, strict=True))


def count_right(space, colours, attack):
    """Of all images of the folder, by the written file, in its own preprocessing."""
    classifier = load_classifier("own", device="cpu", folder=space.classifiers_dir)
    files = sorted(colours.glob("*/*.png"))
    batch = torch.stack([classifier.preprocess(np.asarray(Image.open(file))) for file in files])
    truth = torch.tensor([classifier.labels.index(file.parent.name) for file in files])

    def measure(images):
        return torch.nn.functional.cross_entropy(classifier.logits(images), truth, reduction="none")

    moved = find_worst_images(batch, measure, attack)
    return [int((classifier.logits(images).argmax(1) == truth).sum()) for images in (moved, batch)]


def test_it_holds_under_attack_where_another_falls(pair, colours):
    (plain, _), (robust, _) = pair
    attack = Attack(norm="l2", eps=2, steps=10)
    (plain_attacked, plain_clean), (robust_attacked, robust_clean) = (
        count_right(s, colours, attack) for s in (plain, robust)
    )
    assert plain_clean >= 60 and robust_clean >= 60, "of 72"
    assert robust_attacked >= plain_attacked + 18


def test_the_record_says_how_it_was_trained_and_how_it_holds(pair):
    (plain, usual), (robust, made) = pair
    record = json.loads((robust.classifiers_dir / "own.json").read_text())
    assert record["settings"]["robust"] == {"norm": "l2", "eps": 2, "steps": 3, "step_size": pytest.approx(4 / 3)}
    assert record["trained_on"].endswith(", each moved to where its loss is largest (l2 2, 3 steps)")
    hit, held_out = record["held_out"]["under_attack"], record["held_out"]
    assert (hit["norm"], hit["eps"], hit["steps"], hit["step_size"]) == ("l2", 2, 20, 0.2)
    assert hit["n"] == held_out["n"] and hit["correct"] <= held_out["correct"]
    assert hit["accuracy"] == hit["correct"] / hit["n"]
    assert hit["ci95"] == pytest.approx(wilson_interval(hit["correct"], hit["n"]))
    assert made.record.held_out.under_attack is not None
    without = json.loads((plain.classifiers_dir / "own.json").read_text())
    assert "under_attack" not in without["held_out"] and "robust" not in without["settings"]
    assert usual.record.held_out.under_attack is None


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_and_an_interrupted_run_too(colours, tmp_path, monkeypatch):
    spaces = [make_workspace(tmp_path / name) for name in ("one", "two")]

    def train_short(space, robust="linf:8/255"):
        return train(space, colours, robust=robust, corrupting=("fog:3",), epochs=1, held_out=0.0)

    def stop_at_the_third(self, step, usual=ClassifierTask.loss):
        found = usual(self, step)
        if step == 2:
            raise KeyboardInterrupt
        return found

    whole = train_short(spaces[0]).file.read_bytes()
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(ClassifierTask, "loss", stop_at_the_third)
        train_short(spaces[1])
    resumed = train_short(spaces[1])
    assert resumed.resumed_from == 2 and resumed.file.read_bytes() == whole
    assert train_short(spaces[1]).was_finished
    other = train_short(spaces[1], robust="linf:4/255")
    assert not other.was_finished and other.file.read_bytes() != whole


def test_the_attack_is_in_eval_mode_and_leaves_no_trace(colours, tmp_path, monkeypatch):
    """As in MadryLab's library: by the running statistics, which the attack does not touch; then the step as usual."""
    seen = []

    def attack(images, measure, how):
        task = seen[0]
        before = {name: value.clone() for name, value in task.buffers().items()}
        worst = find_worst_images(images, measure, how)
        assert not task.module.training
        assert all(torch.equal(value, before[name]) for name, value in task.buffers().items())
        assert all(parameter.grad is None for parameter in task.parameters().values())
        seen.append(float((worst - images).flatten(1).norm(dim=1).max()))
        return worst

    def loss(self, step, usual=ClassifierTask.loss):
        seen[:] = [self]
        found = usual(self, step)
        assert self.module.training and len(seen) == 2 and 0 < seen[1] <= 0.5 * (1 + 1e-5)
        return found

    monkeypatch.setattr(ClassifierTask, "loss", loss)
    monkeypatch.setattr("toolkit.training.classifier_task.find_worst_images", attack)
    seen.append(None)
    config = ClassifierConfig(name="own", data=(str(colours),), epochs=1, **{**SMALL, "held_out": 0.0}, robust="l2:0.5")
    train_classifier(config, make_workspace(tmp_path / "space"), device="cpu")


def test_the_command_says_both_accuracies(colours, tmp_path):
    space = make_workspace(tmp_path / "space")
    words = ["train-classifier", "--data", str(colours), "--name", "own", "--arch", "cifar_resnet8", "--image-px", "16"]
    words += ["--epochs", "1", "--batch", "12", "--device", "cpu", "--workspace", str(space.root)]
    shown = CliRunner().invoke(app, [*words, "--robust", "l2:0.5", "--attack-steps", "2", "--quiet"])
    assert shown.exit_code == 0, shown.output
    assert "held-out images: " in shown.output and "under attack (l2 0.5, 20 steps): " in shown.output
    told = CliRunner().invoke(app, [*words, "--robust", "l2:0.5", "--attack-steps", "2", "--json"])
    record = json.loads(told.stdout)["record"]
    assert record["settings"]["robust"]["steps"] == 2 and record["held_out"]["under_attack"]["eps"] == 0.5
    alone = CliRunner().invoke(app, [*words, "--attack-steps", "2"])
    assert alone.exit_code and str(alone.exception).startswith("--attack-steps 2: expected together with --robust")
