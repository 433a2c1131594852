"""The pad in training: the view is the photograph, the gradient the finite difference, the page is true."""

import io
from pathlib import Path

import numpy as np
import pytest
import torch

from toolkit.core.draws import Draws
from toolkit.core.files import write_json
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.models.architectures import build_network
from toolkit.rooms.landing.boost import PadTask, boost_pad, plan_views, start_picture
from toolkit.rooms.landing.config import BoostConfig, PadPrintConfig
from toolkit.rooms.landing.regressor import Regressor, RegressorRecord, load_regressor, regressors_dir
from toolkit.rooms.landing.site import Pad, SiteView

CONFIG = BoostConfig(
    size_px=32, views=12, places=2, ground="bare", time="overcast", steps=12, batch=6, weathers=(), noise=0.0,
    light=(1, 1), lr=0.05,
)  # fmt: skip


def make_regressor(space: Workspace, image_px: int = 64) -> Regressor:
    """One with random weights."""
    from safetensors.torch import save_file

    from toolkit.core.files import sha256_file

    folder = regressors_dir(space)
    folder.mkdir(parents=True)
    torch.manual_seed(1)
    module = build_network("shufflenet_v2_x0_5", 2)
    save_file(module.state_dict(), folder / "random.safetensors")
    record = RegressorRecord(
        name="random", arch="shufflenet_v2_x0_5", outputs=2, image_px=image_px, fov_deg=70.0, mean=(0.5, 0.5, 0.5),
        std=(0.25, 0.25, 0.25), pad="plain", pad_sha256="0" * 64, size_m=1.0, started_from="nothing",
        data={"places": {"train": ["meadow-1-1"], "held_out": []}, "n": 0, "world": "grass"}, settings={}, final={},
        held_out=[], inputs_sha256="0" * 64, sha256=sha256_file(folder / "random.safetensors"), toolkit_version="0",
    )  # fmt: skip
    write_json(folder / "random.json", record.model_dump(mode="json"))
    return load_regressor(space, "random")


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> PadTask:
    space = make_workspace(tmp_path_factory.mktemp("boost") / "work")
    regressor = make_regressor(space)
    pad = Pad("own", start_picture(CONFIG, 0), 1.0)
    views = plan_views(CONFIG, regressor, pad, 0)
    return PadTask(CONFIG, regressor, views, seed=0, folder=space.print_dir / "pads", name="own")


def test_what_is_trained_on_is_the_photograph(task: PadTask) -> None:
    photos = task.photograph(np.arange(12), Draws(0, 0)).detach().numpy()
    for k, view in enumerate(task.views):
        quiet = view.site.photograph(SiteView(view.pose, 0, k)) / 255
        difference = np.abs(photos[k].transpose(1, 2, 0) - quiet)
        assert difference.mean() < 0.012  # the sensor's noise


def test_the_gradient_is_the_finite_difference(task: PadTask) -> None:
    """In double precision of the mean picture, along a random direction."""
    rng = np.random.default_rng(0)
    weights = torch.from_numpy(rng.standard_normal((12, 3, 64, 64))).float()
    towards = torch.from_numpy(rng.standard_normal(task.theta.shape)).float()

    def score() -> torch.Tensor:
        return (task.photograph(np.arange(12), Draws(0, 0)) * weights).sum()

    task.theta.grad = None
    score().backward()
    assert task.theta.grad is not None
    slope = float((task.theta.grad * towards).sum())
    step = 1e-3
    with torch.no_grad():
        task.theta += step * towards
        above = float(score())
        task.theta -= 2 * step * towards
        below = float(score())
        task.theta += step * towards
    assert slope == pytest.approx((above - below) / (2 * step), rel=0.03)


def test_boosting_lowers_the_error_and_prints_true_pages(tmp_path: Path) -> None:
    from pypdf import PdfReader

    space = make_workspace(tmp_path / "work")
    make_regressor(space)
    made = boost_pad(space, "random", CONFIG, PadPrintConfig(print_size_m=0.5))
    assert made.file == space.print_dir / "pads" / "random-boosted.png"
    reader = PdfReader(io.BytesIO(made.pdf.read_bytes()))
    assert len(reader.pages) == made.pages > 2
    assert float(reader.pages[0].mediabox.width) == pytest.approx(297 / 25.4 * 72, abs=1)
    assert "500" in (reader.metadata.title or "")
    assert set(made.errors) == {"plain", "random-boosted"}
    content = made.file.read_bytes()
    again = boost_pad(space, "random", CONFIG)
    assert again.was_finished
    assert again.file.read_bytes() == content
    # a kill between picture and record leaves a pair that does not match
    made.file.write_bytes(content[:-20])
    again = boost_pad(space, "random", CONFIG)
    assert not again.was_finished
    assert again.file.read_bytes() == content
