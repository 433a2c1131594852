"""Workspaces: found from anywhere inside, and their own files win over the package's."""

from pathlib import Path

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import PACKAGE_DATA, copy_objects, make_workspace, open_workspace


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


def test_a_named_folder_without_a_marker_is_refused(tmp_path):
    with pytest.raises(
        ToolkitError, match=r"is not a workspace \(it has no toolkit.toml\): make one with 'toolkit init"
    ):
        open_workspace(tmp_path)


def test_the_marker_alone_makes_a_workspace(tmp_path, monkeypatch):
    (tmp_path / "toolkit.toml").write_text("schema_version = 1\n")
    (tmp_path / "captures").mkdir()
    monkeypatch.chdir(tmp_path / "captures")
    assert open_workspace().root == open_workspace(tmp_path).root == tmp_path


def test_an_older_workspace_has_rig_alone(tmp_path, monkeypatch):
    (tmp_path / "rig" / "objects").mkdir(parents=True)
    (tmp_path / "rig" / "my_script.py").write_text("")
    below = tmp_path / "captures" / "real"
    below.mkdir(parents=True)
    monkeypatch.chdir(below)
    assert open_workspace().root == open_workspace(tmp_path).root == tmp_path
    make_workspace(tmp_path)
    assert (tmp_path / "toolkit.toml").is_file() and open_workspace().root == tmp_path


@pytest.mark.parametrize("source", ["toolkit/__init__.py", "toolkit/rig/__init__.py", "toolkit/rig/test_pose.py"])
def test_source_code_is_never_taken_for_an_older_workspace(tmp_path, monkeypatch, source):
    (tmp_path / "toolkit" / "rig" / "shapes").mkdir(parents=True)
    (tmp_path / source).write_text("")
    space = make_workspace(tmp_path)
    for folder in ("toolkit", "toolkit/rig", "toolkit/rig/shapes"):
        monkeypatch.chdir(tmp_path / folder)
        assert open_workspace().root == space.root
    with pytest.raises(ToolkitError, match="is not a workspace"):
        open_workspace(tmp_path / "toolkit")


@pytest.mark.parametrize("folder", ["toolkit", "toolkit/rig", "tests", "tests/rig", "docs", "rig/objects"])
def test_in_the_repository_commands_work_at_its_root(monkeypatch, folder):
    root = Path(__file__).resolve().parents[2]
    monkeypatch.chdir(root / folder)
    assert open_workspace().root == root


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("schema_version = 2\n", r"field 'schema_version': expected 1, found 2"),
        ("", r"toml: field 'schema_version' is missing: correct"),
        ('schema_version = 1\nmodle = "resnet18"\n', r"there is no field 'modle'"),
        ("schema_version = \n", r"not TOML: .*line 1"),
    ],
)
def test_a_wrong_field_of_the_marker_is_named(tmp_path, content, words):
    (tmp_path / "toolkit.toml").write_text(content)
    for read in (open_workspace, make_workspace):
        with pytest.raises(ToolkitError, match=words) as caught:
            read(tmp_path)
        assert str(tmp_path / "toolkit.toml") in str(caught.value) and "\n" not in str(caught.value)


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
    assert (spec.name, spec.class_name, spec.mounts[0].size_mm) == ("mug", "coffee mug", 40)


def test_objects_are_copied_without_the_folders_that_a_link_leads_to(tmp_path):
    space = make_workspace(tmp_path / "space")
    (tmp_path / "mug.glb").write_bytes(b"mesh")
    (space.objects_dir / "mug.glb").symlink_to(tmp_path / "mug.glb")
    (space.objects_dir / "m").symlink_to("../../..")  # round in a circle, through all that lies beside
    copied = copy_objects(space, space.eval_dir / "copy")
    assert sorted(path.name for path in copied.objects_dir.iterdir()) == ["README.txt", "mug.glb"]
