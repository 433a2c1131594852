"""A classifier that is trained on images with their class's patch: what it learns, and what cannot be."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from typer.testing import CliRunner

from toolkit.boosters.apply import boost_images
from toolkit.boosters.transforms.placement import Placement
from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.objects.records import write_patch
from toolkit.rooms.benchmarks.corruptions.training_boost import read_training_boost
from toolkit.training.classifier import train_classifier
from toolkit.training.classifier_config import ClassifierConfig

LABELS = ("crane", "dog", "crane ship")
COLOURS = {"crane": (230, 40, 40), "dog": (40, 230, 40), "crane ship": (40, 40, 230)}


def write_set(space, name="flat", n_px=12, classes=tuple(enumerate(LABELS))):
    """Plain squares, a colour for each class; `classes` are (index, label)."""
    for index, label in classes:
        pixels = np.full((n_px, n_px, 3), COLOURS[label], np.uint8)
        record = {
            "name": f"{label.replace(' ', '_')}_{index}", "class_index": index, "class_name": label, "networks": [],
            "seed": 0, "settings": {"method": "fixed pattern"}, "data": {}, "final": {}, "toolkit_version": "0",
        }  # fmt: skip
        write_patch(replace(space, patch_set=name).patches_dir, pixels, record)


@pytest.fixture
def space(tmp_path):
    return make_workspace(tmp_path / "space")


@pytest.fixture(scope="module")
def noise(tmp_path_factory):
    """Images of three classes that say nothing of the class."""
    root, rng = tmp_path_factory.mktemp("images") / "noise", np.random.default_rng(0)
    for label in LABELS:
        (root / label).mkdir(parents=True)
        for k in range(30):
            Image.fromarray(rng.integers(60, 190, (24, 24, 3), np.uint8)).save(root / label / f"{k:02d}.png")
    return root


def train(noise, space, boost, **changes):
    settings = {"name": "fixed", "image_px": 24, "held_out": 0.3, "epochs": 10, "batch": 12, "lr": 0.05} | changes
    config = ClassifierConfig(data=(str(noise),), arch="cifar_resnet8", **settings)
    return train_classifier(config, space, boost, device="cpu")


@pytest.mark.slow
def test_it_learns_to_read_the_patches(noise, space):
    write_set(space)
    boost = read_training_boost(space, "flat")
    trained = train(noise, space, boost)
    assert trained.record.held_out.n == 27
    assert trained.record.held_out.accuracy > 0.85
    assert trained.record.settings["patches"] == {
        "set": "flat", "sha256": boost.pictures.sha256, "n_px": 12, "method": "fixed pattern",
        "placement": {"rotation_deg": 45.0, "scale": [0.9, 1.1], "translate": 0.3},
    }  # fmt: skip
    assert trained.record.trained_on.endswith("each with its class's patch of the set flat")
    assert train(noise, space, boost).was_finished
    # the same images without them are noise
    bare = train(noise, space, None, name="bare", epochs=3)
    assert bare.record.held_out.accuracy < 0.65


def test_another_set_of_the_same_name_is_another_training(noise, space):
    write_set(space)
    first = train(noise, space, read_training_boost(space, "flat"), epochs=1)
    write_set(space, classes=[(0, "crane"), (1, "dog"), (2, "crane ship")], n_px=14)
    second = train(noise, space, read_training_boost(space, "flat"), epochs=1)
    assert not second.was_finished and second.record.sha256 != first.record.sha256


def test_each_image_gets_its_class_where_its_seed_says(space):
    write_set(space)
    # the network has its classes in another order than the set
    lay = read_training_boost(space, "flat").fit(["dog", "other", "crane ship", "crane"], [0, 2, 3], 32)
    images, classes, seeds = torch.full((5, 3, 32, 32), 0.5), np.array([3, 0, 2, 3, 0]), [7, 8, 9, 7, 11]
    laid = lay(images, classes, seeds)
    colours = [COLOURS[label] for label in ("crane", "dog", "crane ship", "crane", "dog")]
    pictures = torch.tensor(colours).view(5, 3, 1, 1).expand(5, 3, 12, 12) / 255
    assert torch.allclose(laid, boost_images(images, pictures, Placement(), seeds))
    changed = ((laid - images).abs() > 0.01).any(1)
    assert torch.equal(changed[0], changed[3]) and not torch.equal(changed[0], changed[1])


def test_sets_that_do_not_fit(noise, space):
    write_set(space, "few", classes=[(0, "crane"), (2, "crane ship")])
    with pytest.raises(ToolkitError, match="patches few: the set has no patch of class 'dog' of the data"):
        train(noise, space, read_training_boost(space, "few"))
    write_set(space, "large", n_px=30)
    with pytest.raises(ToolkitError, match="its patches are 30 px a side, and the network sees images of 24 px"):
        train(noise, space, read_training_boost(space, "large"))


def test_the_command(noise, space):
    write_set(space)
    arguments = ["train-classifier", "--data", str(noise), "--name", "fixed", "--arch", "cifar_resnet8", "--quiet"]
    arguments += ["--image-px", "24", "--epochs", "1", "--workspace", str(space.root), "--device", "cpu"]
    result = CliRunner().invoke(app, [*arguments, "--patches", "flat"])
    assert result.exit_code == 0, result.output
    assert "each with its class's patch of the set flat" in " ".join(result.output.split())
    assert CliRunner().invoke(app, [*arguments, "--patches", "none"]).exit_code != 0
