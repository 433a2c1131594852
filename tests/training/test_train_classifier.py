"""Training a classifier: it learns what there is, resumes to the same bytes, and its record tells the truth."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from colour_folder import write_colours
from PIL import Image
from safetensors.torch import load_file

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.statistics import wilson_interval
from toolkit.core.workspace import make_workspace
from toolkit.models import load_classifier
from toolkit.training import classifier as training_run
from toolkit.training.augment import SMALL_IMAGES
from toolkit.training.classifier import RunOptions, train_classifier
from toolkit.training.classifier_config import ClassifierRequest, Recipe
from toolkit.training.classifier_steps import Fit

QUICK = Recipe(epochs=5, batch=12, lr=0.02, augmentation=SMALL_IMAGES)
QUIET = RunOptions(quiet=True, device="cpu")


@pytest.fixture(scope="module")
def space(tmp_path_factory):
    return make_workspace(tmp_path_factory.mktemp("space"))


@pytest.fixture(scope="module")
def colours(tmp_path_factory):
    return write_colours(tmp_path_factory.mktemp("images") / "colours", 36)


@pytest.fixture(scope="module")
def trained(space, colours):
    return train_classifier(
        ClassifierRequest("own", (str(colours),), image_px=16, held_out=0.4, recipe=QUICK), space, QUIET
    )


def tiny_request(colours, **changes):
    """A network with dropout and batch normalisation, a few steps."""
    recipe = Recipe(epochs=1, batch=16, lr=0.02, augmentation=SMALL_IMAGES)
    return ClassifierRequest("tiny", (str(colours),), "mobilenet_v3_small", image_px=32, recipe=recipe, **changes)


@pytest.mark.slow
def test_it_learns_colours_and_nothing_from_shuffled_ones(trained, tmp_path):
    assert trained.record.held_out.accuracy > 0.8
    folder = write_colours(tmp_path / "shuffled", 36, shuffled=True)
    request = ClassifierRequest("none", (str(folder),), image_px=16, held_out=0.4, recipe=replace(QUICK, epochs=3))
    held_out = train_classifier(request, make_workspace(tmp_path / "space"), QUIET).record.held_out
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
        "own (resnet18 trained on photographs of 3 classes from the folder colours; 3 classes of its own, "
        "not ImageNet's)"
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
    request = ClassifierRequest("own", (str(colours),), image_px=16, held_out=0.4, recipe=QUICK)
    assert train_classifier(request, space, QUIET).was_finished
    assert trained.file.read_bytes() == before


def test_a_killed_run_goes_on_to_the_same_bytes(colours, tmp_path, monkeypatch):
    request = tiny_request(colours)
    straight = train_classifier(request, make_workspace(tmp_path / "straight"), QUIET)
    assert straight.resumed_from == 0

    real = Fit.run

    def killed(self, images, classes, done=0):
        for step in real(self, images, classes, done):
            yield step
            if step.done == 3:
                raise SystemExit("killed")

    space = make_workspace(tmp_path / "resumed")
    options = replace(QUIET, checkpoint_every_s=0.0)
    monkeypatch.setattr(Fit, "run", killed)
    with pytest.raises(SystemExit):
        train_classifier(request, space, options)
    assert not (space.classifiers_dir / "tiny.safetensors").exists()
    monkeypatch.setattr(Fit, "run", real)
    said = []
    resumed = train_classifier(request, space, options, said.append)
    assert resumed.resumed_from == 3 and any("going on after step 3 of 6" in line for line in said)
    for suffix in (".safetensors", ".json"):
        one, other = (r.file.with_suffix(suffix).read_bytes() for r in (straight, resumed))
        assert one == other
    assert not (space.classifiers_dir / ".training").exists()


@pytest.mark.slow
def test_the_seed_decides(colours, tmp_path):
    files = []
    for seed in (1, 2):
        request = tiny_request(colours)
        request = replace(request, recipe=replace(request.recipe, seed=seed))
        files.append(train_classifier(request, make_workspace(tmp_path / str(seed)), QUIET).file.read_bytes())
    assert files[0] != files[1]


def test_init_takes_all_but_the_last_layer(trained, colours, tmp_path):
    from toolkit.models.weights import find_weights
    from toolkit.training.classifier_steps import start_network

    request = ClassifierRequest("next", (str(colours),), init=trained.file)
    module = start_network(request, 7, find_weights("resnet18", trained.file))
    given = load_file(trained.file)
    assert torch.equal(module.conv1.weight, given["conv1.weight"].float())
    assert module.fc.weight.shape == (7, 512)
    with pytest.raises(ToolkitError, match=r"holds no weights of resnet34"):
        start_network(replace(request, arch="resnet34"), 7, find_weights("resnet34", trained.file))


@pytest.mark.parametrize("arch", ["mnasnet0_5", "squeezenet1_1"])
def test_other_networks_are_written_and_read_back(arch, colours, tmp_path):
    space = make_workspace(tmp_path)
    request = replace(tiny_request(colours), name="other", arch=arch)
    trained = train_classifier(request, space, QUIET)
    classifier = load_classifier(None, trained.file, "cpu")  # the record says which network
    assert (classifier.arch, classifier.name) == (arch, "other")
    assert training_run.find_finished(trained.file, trained.record.settings["inputs_sha256"]) == trained.record


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "a/b"}, "--name 'a/b': expected letters"),
        ({"name": "resnet18"}, "there is a network of that name"),
        ({"arch": "resnet81"}, r"no network \(--arch\) called 'resnet81': did you mean"),
        ({"image_px": 8}, "--image-px 8: expected 16 to 1024"),
    ],
)
def test_requests_that_cannot_be(changes, message):
    with pytest.raises(ToolkitError, match=message):
        ClassifierRequest(**{"name": "x", "data": ("rig",)} | changes)


@pytest.mark.parametrize(("arch", "px"), [("inception_v3", 64), ("vit_b_16", 128), ("alexnet", 32)])
def test_images_too_small_for_the_network(arch, px, colours, space):
    request = ClassifierRequest("small", (str(colours),), arch, image_px=px)
    with pytest.raises(ToolkitError, match=rf"--arch {arch} cannot be trained with --image-px {px} .*try --image-px"):
        train_classifier(request, space, QUIET)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"epochs": 0}, "--epochs 0"), ({"batch": 1}, "--batch 1"), ({"lr": 0.0}, "--lr 0"),
        ({"weight_decay": 1.0}, "--weight-decay 1"), ({"label_smoothing": 1.0}, "--label-smoothing 1"),
    ],
)  # fmt: skip
def test_recipes_that_cannot_be(wrong, message):
    with pytest.raises(ToolkitError, match=message):
        Recipe(**wrong)


def test_a_learning_rate_that_explodes_is_one_line(colours, tmp_path):
    request = tiny_request(colours)
    request = replace(request, arch="squeezenet1_1", recipe=replace(request.recipe, lr=10.0, epochs=6, warm_up=0.01))
    with pytest.raises(ToolkitError, match="not a finite number: train again with --restart and a lower --lr than 10"):
        train_classifier(request, make_workspace(tmp_path), QUIET)


def test_the_learning_rate_is_torchs_one_cycle():
    recipe, steps = Recipe(lr=0.1, warm_up=0.25), 40
    optimiser = torch.optim.SGD([torch.nn.Parameter(torch.zeros(1))], lr=0.1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 0.1, steps, pct_start=0.25, cycle_momentum=False)
    for step in range(steps):
        assert recipe.lr_at(step, steps) == pytest.approx(optimiser.param_groups[0]["lr"], rel=1e-6, abs=1e-9)
        optimiser.step()
        schedule.step()
