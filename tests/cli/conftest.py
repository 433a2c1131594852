"""What several tests of commands stand in."""

import pytest


@pytest.fixture
def space(tmp_path, make_crate_space, monkeypatch):
    """In its folder, and without the package's own objects, which are heavy."""
    made = make_crate_space(tmp_path / "space")
    monkeypatch.setattr("toolkit.core.workspace.PACKAGE_DATA", tmp_path / "none")
    monkeypatch.chdir(made.root)
    return made
