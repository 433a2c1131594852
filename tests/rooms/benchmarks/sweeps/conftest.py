"""A network that knows a crate by the colour on it, and a workspace with a grey crate and a red patch."""

from pathlib import Path

import pytest
from red_crate import paint_patch


@pytest.fixture
def space(tmp_path, make_crate_space):
    """A grey crate, its red patch of 40 mm, two poses of 96×72 px."""
    space = make_crate_space(tmp_path / "space")
    paint_patch(space)
    return space


@pytest.fixture(scope="session")
def redness():
    """Labels other, crate: the second where over 1 % of the picture is red. `seen` counts images."""
    import torch

    from toolkit.imaging.preprocessing import Preprocessing
    from toolkit.models.network import Classifier
    from toolkit.models.weights import WeightsFile

    class Redness(torch.nn.Module):
        seen = 0

        def forward(self, batch):
            self.seen += len(batch)
            share = ((batch[:, 0] > 0.3) & (batch[:, 0] > 2 * batch[:, 1])).float().mean((1, 2))
            return torch.stack([torch.zeros_like(share), 200 * (share - 0.01)], dim=1)

    how = Preprocessing(72, 72, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    file = WeightsFile(Path("red.pth"), "cd" * 32, "red.pth")
    return Classifier("redness", Redness().eval(), ["other", "crate"], how, file, "cpu", False)
