"""Files that name a way out of the workspace: nothing is written, moved or deleted outside it."""

import ast
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import toolkit
from toolkit.core.errors import ToolkitError
from toolkit.rig.plan import read_plan
from toolkit.rooms.photos.config import ImportSettings
from toolkit.rooms.photos.gates.check_captures import check_captures, make_check
from toolkit.rooms.photos.importing.import_photos import import_photos
from toolkit.rooms.photos.importing.store import write_bytes as stored_by
from toolkit.rooms.photos.shot_order import ShotStep, list_shots, order_shots, read_shots, write_shots
from toolkit.rooms.photos.studio.upload import UploadFolders

ESCAPES = ("../../../X", "/tmp/X", "..", ".", "a/b", "a\\b", "a\n", "a\0", "-x", "", "x" * 300, "‮gpj", "\x1b[31m")


def list_files(folder):
    return sorted(path.relative_to(folder) for path in folder.rglob("*"))


@pytest.fixture
def space(make_crate_space, tmp_path):
    space = make_crate_space(tmp_path / "deep" / "er" / "space")
    plan = read_plan(space.plan_file)
    write_shots(space.root / "rig" / "shots.json", list_shots(plan, order_shots(plan, ["crate"])))
    return space


@pytest.fixture
def photos(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for i in (1, 2):
        pixels = np.random.default_rng(i).integers(0, 256, (60, 80, 3), np.uint8)
        Image.fromarray(pixels).save(folder / f"pose_{i:02d}.png")
    return folder


def rename_object(file, name):
    text = file.read_text()
    content = json.loads(text)
    if "objects" in content:
        content["objects"] = {name: content["objects"]["crate"]}
    else:
        content["plan_sha256"] = {name: content["plan_sha256"]["crate"]}
        for step in content["steps"]:
            step["object"] = name
    file.write_text(json.dumps(content))


@pytest.mark.parametrize("name", ESCAPES)
def test_an_object_of_a_plan_or_a_shot_list_has_the_name_of_a_file(space, name):
    for file, read in ((space.plan_file, read_plan), (space.root / "rig" / "shots.json", read_shots)):
        rename_object(file, name)
        with pytest.raises(ToolkitError, match=r"expected a name of letters, digits|surrogate"):
            read(file)


def test_an_import_writes_nothing_outside_the_workspace(space, photos, tmp_path):
    rename_object(space.plan_file, "../../../X")
    rename_object(space.root / "rig" / "shots.json", "../../../X")
    before = list_files(tmp_path)
    with pytest.raises(ToolkitError, match="expected a name of letters"):
        import_photos(space, [photos])
    assert list_files(tmp_path) == before


def test_a_linked_folder_in_the_captures_is_not_followed(space, photos, tmp_path):
    outside = tmp_path / "outside"
    outside.mkdir()
    place = space.captures_dir / "real" / "crate"
    place.mkdir(parents=True)
    (place / "patched").symlink_to(outside)
    settings = ImportSettings(object="crate", variant="patched", match="name")
    with pytest.raises(ToolkitError, match="leads outside"):
        import_photos(space, [photos], settings)
    assert not list(outside.iterdir())


def test_the_studios_places_lie_in_the_workspace(space, tmp_path):
    """Whatever a step is called: its names are checked where the list is read, and here once more."""
    folders = UploadFolders(space.root)
    before = list_files(tmp_path)
    for step in (ShotStep(1, "../../../../X", "patched", 1), ShotStep(1, "crate", "../../../../X", 1)):
        for write in (
            lambda step=step: folders.set_skipped(step, True),
            lambda step=step: folders.drop_waiting(step),
            lambda step=step: folders.find_waiting(step),
        ):
            with pytest.raises(ToolkitError, match="leaves its folder"):
                write()
    assert list_files(tmp_path) == before


@pytest.mark.parametrize("source", ["../../x", "..", "", "a/b", "/tmp/x"])
def test_a_source_is_one_folder(space, source, tmp_path):
    before = list_files(tmp_path)
    for call in (check_captures, make_check):
        with pytest.raises(ToolkitError, match="expected the name of one folder below captures/"):
            call(space, source)
    assert list_files(tmp_path) == before


WRITING = {"write_bytes", "write_text", "touch", "symlink_to", "hardlink_to", "mkdir", "rename", "savefig", "mkstemp"}
DELETING = {"unlink", "rmtree"}
ALLOWED = {
    ("core/files.py", "*"),  # where every write goes
    ("core/records.py", "open"),  # appends, and follows no link
    ("cli/__init__.py", "open"),  # /dev/null
    ("core/workspace.py", "mkdir"),  # a new workspace's folders, where the user says
    ("core/locks.py", "open"),  # follows no link either
    ("engine/local.py", "open"),  # below a folder that was just made, which nobody else knows
    ("core/cache.py", "mkdir"),  # the cache of the user
    ("models/weights.py", "mkdir"),  # torch's cache
    ("core/cache.py", "unlink"),
    ("rig/kernel/compiled.py", "unlink"),
    ("rig/kernel/compiled.py", "rmtree"),
    ("core/records.py", "unlink"),  # the lock that was just made
    ("rooms/worlds/picture.py", "unlink"),  # the half film beside the one that it writes
    ("engine/local.py", "rmtree"),  # what it made
}


def find_writes(file):
    """Calls in a module that write to a path, or delete what is there, without core.files."""
    text = file.read_text(encoding="utf-8")
    if not any(word in text for word in (*WRITING, *DELETING, "open(", "torch.save", "shutil.copy")):
        return  # most of them, and to parse one takes long
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        name, owner = node.func.attr, getattr(node.func.value, "id", "")
        if name in WRITING | DELETING and not (name == "savefig" and "buffer" in ast.unparse(node)):
            yield name
        modes = [arg.value for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str)]
        if name in ("open", "fdopen") and any(set(mode) & set("wax+") and len(mode) < 4 for mode in modes):
            yield "open"
        if (owner, name) in (("os", "open"), ("torch", "save"), ("shutil", "copy"), ("shutil", "copytree")):
            yield "open"


def test_every_write_goes_through_one_function():
    assert stored_by.__module__ == "toolkit.core.files"
    package = Path(toolkit.__file__).parent
    found = {(str(file.relative_to(package)), call) for file in package.rglob("*.py") for call in find_writes(file)}
    assert {(file, call) for file, call in found if (file, call) not in ALLOWED and (file, "*") not in ALLOWED} == set()
