"""Workspaces: found from anywhere inside, and their own files win over the package's."""

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import PACKAGE_DATA, make_workspace, open_workspace


def test_it_is_found_from_anywhere_inside(tmp_path, monkeypatch):
    space = make_workspace(tmp_path / "space")
    below = space.captures_dir / "real" / "mug"
    below.mkdir(parents=True)
    for folder in (space.root, below):
        monkeypatch.chdir(folder)
        assert open_workspace().root == space.root
    monkeypatch.chdir(tmp_path)
    assert open_workspace().root == tmp_path  # none upwards: here
    assert open_workspace(space.root).root == space.root


def test_the_nearest_one_counts(tmp_path, monkeypatch):
    make_workspace(tmp_path)
    inner = make_workspace(tmp_path / "captures" / "inner")
    monkeypatch.chdir(inner.eval_dir)
    assert open_workspace().root == inner.root


def test_a_named_folder_without_rig_is_refused(tmp_path):
    with pytest.raises(ToolkitError, match=r"is no workspace \(it has no rig/\): make one with 'toolkit init"):
        open_workspace(tmp_path)


def test_its_own_files_win(tmp_path):
    space = make_workspace(tmp_path / "space")
    assert space.object_spec("racer") == PACKAGE_DATA / "objects" / "racer.toml"
    own = space.objects_dir / "racer.toml"
    own.write_text("")
    (space.objects_dir / "mug.toml").write_text("")
    assert space.object_spec("racer") == own
    assert sorted(space.object_specs()) == ["coffeepot", "eggnog", "mug", "racer", "warplane"]
    (space.patches_dir / "racer.png").write_bytes(b"")
    assert space.patch("racer") == space.patches_dir / "racer.png"


def test_unknown_names_are_refused(tmp_path):
    space = make_workspace(tmp_path / "space")
    with pytest.raises(ToolkitError, match=r"no object called 'warplan': did you mean warplane\?"):
        space.object_spec("warplan")
    with pytest.raises(ToolkitError, match="no patch called 'nothing like it'"):
        space.patch("nothing like it")


def test_making_one_again_changes_nothing(tmp_path):
    space = make_workspace(tmp_path / "space")
    guide = space.objects_dir / "README.txt"
    guide.write_text("mine")
    (space.captures_dir / "a.txt").write_text("kept")
    assert make_workspace(tmp_path / "space") == space
    assert guide.read_text() == "mine" and (space.captures_dir / "a.txt").read_text() == "kept"


def test_a_file_in_the_way_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(ToolkitError, match=r"is a file|cannot write"):
            make_workspace(folder)


def test_the_guides_example_is_a_valid_spec(tmp_path):
    """What the guide tells people to copy must be accepted, with every line taken out of its comment."""
    from toolkit.objects.spec import read_spec

    guide = (make_workspace(tmp_path).objects_dir / "README.txt").read_text()
    lines = [line[2:] for line in guide.splitlines() if "=" in line or line.startswith("# [")]
    file = tmp_path / "mug.toml"
    file.write_text("\n".join(lines))
    spec = read_spec(file)
    assert (spec.name, spec.class_name, spec.patch.size_mm) == ("mug", "coffee mug", 40)
