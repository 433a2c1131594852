"""A classifier that sees colours, so that every result is known beforehand, and folders of coloured images for it."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

COLOURS = {"racer": (230, 40, 40), "warplane": (40, 230, 40), "coffeepot": (40, 40, 230), "eggnog": (90, 90, 90)}


def write_image(file: Path, says: str, width: int = 64, height: int = 48) -> None:
    """An image that the colour classifier calls `says`."""
    file.parent.mkdir(parents=True, exist_ok=True)
    # no two photographs are equal: equal ones count once
    draw = np.random.default_rng(list("/".join(file.parts[-4:]).encode()))
    pixels = np.clip(np.array(COLOURS[says]) + draw.integers(-9, 10, (height, width, 3)), 0, 255).astype(np.uint8)
    Image.fromarray(pixels).save(file)


@pytest.fixture(scope="session")
def colour_classifier():
    """Labels racer, warplane, coffeepot, eggnog for red, green, blue, grey."""
    import torch

    from toolkit.imaging.preprocessing import Preprocessing
    from toolkit.models.network import Classifier
    from toolkit.models.weights import WeightsFile

    class Colours(torch.nn.Module):
        def forward(self, batch):
            means = batch.mean((2, 3))
            return torch.cat([4 * means, torch.full_like(means[:, :1], 2.0)], dim=1)

    how = Preprocessing(32, 28, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    file = WeightsFile(Path("colours.pth"), "ab" * 32, "colours.pth")
    return Classifier("colours", Colours().eval(), list(COLOURS), how, file, "cpu", False)


@pytest.fixture
def workspace(tmp_path):
    """An empty workspace."""
    from toolkit.core.workspace import Workspace

    (tmp_path / "space" / "rig").mkdir(parents=True)
    return Workspace(tmp_path / "space")


@pytest.fixture
def put(workspace):
    """Write captures/PATH as an image that the classifier calls `says`."""

    def write(path: str, says: str) -> Path:
        write_image(workspace.captures_dir / path, says)
        return workspace.captures_dir / path

    return write


@pytest.fixture
def as_older():
    """Make a run one of an older version, whose summary holds no hashes, so that its files may be changed."""
    import json

    def take_hashes(folder: Path) -> Path:
        file = folder / "summary.json"
        content = {key: value for key, value in json.loads(file.read_text()).items() if not key.endswith("_sha256")}
        file.write_text(json.dumps(content))
        return folder

    return take_hashes


@pytest.fixture
def browser():
    """A headless Chromium at a phone's width."""
    import shutil

    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        pytest.skip("needs chromium and chromedriver: scripts/test-browser installs them")
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = shutil.which("chromium")
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"):
        options.add_argument(argument)
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    phone = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", phone)
    yield driver
    driver.quit()
