"""What tests share: the data beside the checkout, where there is any."""

import os
from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of photographs and meshes for development; its tests are skipped where it is absent."""
    if not SHARED.is_dir():
        pytest.skip("needs the development data in ../shared, which is not here")
    return SHARED


@pytest.fixture(scope="session")
def real_weights() -> Path:
    """A folder with real ImageNet weights `resnet18-*.pth`; skipped where there is none."""
    for folder in (os.environ.get("TOOLKIT_WEIGHTS"), SHARED / "weights"):
        if folder and any(Path(folder).glob("resnet18-*.pth")):
            return Path(folder)
    pytest.skip("needs real weights: set TOOLKIT_WEIGHTS to a folder with resnet18-*.pth")
