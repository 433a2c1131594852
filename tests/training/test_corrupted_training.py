"""Training on corrupted images."""

import json

import numpy as np
import pytest
import torch
from colour_folder import write_colours
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.training.classifier_config import Corrupting
from toolkit.training.classifier_task import corrupt_some

BRIGHTER, FLATTER = ("brightness", 5), ("contrast", 5)


def test_a_share_is_corrupted_by_the_draws():
    batch = torch.rand(200, 3, 16, 16, generator=torch.Generator().manual_seed(0)) * 0.5 + 0.1
    how = Corrupting(corruptions=(BRIGHTER, FLATTER), share=0.3)
    one, same, other = (corrupt_some(batch.clone(), np.random.default_rng(seed), how) for seed in (1, 1, 2))
    assert torch.equal(one, same) and not torch.equal(one, other)
    changed = (one != batch).flatten(1).any(1)
    assert 40 <= changed.sum() <= 80  # of 200 at 0.3: 60, and 3 standard deviations of 6.5
    # by CIFAR's parameters: its value 0.3 higher, or 0.15 of the contrast
    gained = (one - batch)[changed].mean((1, 2, 3))
    flattened = one[changed].std((1, 2, 3)) / batch[changed].std((1, 2, 3))
    assert ((gained > 0.1) ^ (flattened < 0.3)).all()
    assert 10 <= (gained > 0.1).sum() <= 50


def test_every_image_by_itself():
    """Neither the other images nor how many are hit decide what is done to one."""
    batch = torch.rand(20, 3, 16, 16)
    how = Corrupting(corruptions=(("gaussian_noise", 3),), share=1.0)
    one = corrupt_some(batch.clone(), np.random.default_rng(1), how)
    changed = batch.clone()
    changed[:10] = 0
    assert torch.equal(corrupt_some(changed, np.random.default_rng(1), how)[10:], one[10:])
    few = corrupt_some(batch.clone(), np.random.default_rng(1), how.with_overrides(share=0.5))
    hit = (few != batch).flatten(1).any(1)
    assert 0 < hit.sum() < 20 and torch.equal(few[hit], one[hit])


@pytest.mark.parametrize("share", [0, -1, 1.5])
def test_shares_that_cannot_be(share):
    with pytest.raises(ToolkitError, match=r"share .*: expected a share above 0 and at most 1"):
        Corrupting(corruptions=(BRIGHTER,), share=share)


def test_the_command_trains_on_them_and_says_so(tmp_path):
    space = make_workspace(tmp_path / "space")
    folder = write_colours(tmp_path / "set", 12)
    arguments = ["train-classifier", "--data", str(folder), "--name", "hard", "--arch", "cifar_resnet8", "--quiet"]
    arguments += [
        "--image-px",
        "16",
        "--epochs",
        "1",
        "--batch",
        "8",
        "--workspace",
        str(space.root),
        "--device",
        "cpu",
    ]
    result = CliRunner().invoke(app, [*arguments, "--corrupt", "fog:3", "--corrupt", "blur:1-2"])
    assert result.exit_code == 0, result.output
    record = json.loads((space.classifiers_dir / "hard.json").read_text())
    corrupting = record["settings"]["corrupting"]
    assert corrupting["share"] == 0.5 and len(corrupting["corruptions"]) == 1 + 4 * 2
    assert corrupting["corruptions"][0] == ["fog", 3] and record["trained_on"].endswith("50% of them corrupted")
    before = record["sha256"]
    again = CliRunner().invoke(app, [*arguments, "--corrupt", "fog:4"])
    assert again.exit_code == 0 and "was trained with these inputs before" not in again.output
    assert json.loads((space.classifiers_dir / "hard.json").read_text())["sha256"] != before
    wrong = CliRunner().invoke(app, [*arguments, "--corrupt", "fgo"])
    assert wrong.exit_code != 0
