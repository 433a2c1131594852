"""Links in a workspace are not followed; links to one, or outside of one, are."""

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.files import delete_file, delete_folder, move_file, write_text
from toolkit.core.places import check_links
from toolkit.core.records import hold_folder
from toolkit.core.workspace import Workspace, make_workspace

REFUSED = "is a link: nothing is written or deleted through a link in a workspace: put a folder in its place"


@pytest.fixture
def outside(tmp_path):
    folder = tmp_path / "outside"
    (folder / "sim").mkdir(parents=True)
    (folder / "sim" / "mine.txt").write_text("mine")
    (folder / "toolkit.toml").write_text("schema_version = 1\n")  # another workspace of the user's is no less outside
    return folder


@pytest.fixture
def linked(outside, tmp_path):
    """A folder of a workspace that is a link."""
    (tmp_path / "space").mkdir()
    (tmp_path / "space" / "toolkit.toml").write_text("schema_version = 1\n")
    (tmp_path / "space" / "captures").symlink_to(outside)
    return tmp_path / "space" / "captures"


@pytest.mark.parametrize("path", ["x.txt", "sim/mine.txt", "sim/deep/x.txt", "../captures/x.txt", "sim/../x.txt"])
def test_nothing_is_written_or_deleted_through_a_link(linked, outside, path):
    before = sorted(outside.rglob("*"))

    def hold():
        with hold_folder((linked / path).parent):
            pass

    def move():
        move_file(write_text(linked.parent / "new.txt", "new"), linked / path, linked.parent.parent)

    for change in (
        lambda: write_text(linked / path, "theirs"),
        move,
        hold,
        lambda: delete_file(linked / path),
        lambda: delete_folder((linked / path).parent),
    ):
        with pytest.raises(ToolkitError, match=REFUSED):
            change()
    assert sorted(outside.rglob("*")) == before and (outside / "sim" / "mine.txt").read_text() == "mine"


def test_an_older_workspace_and_a_link_within_it_are_no_exception(tmp_path):
    (tmp_path / "rig" / "objects").mkdir(parents=True)
    (tmp_path / "rig" / "preview").symlink_to("objects")
    with pytest.raises(ToolkitError, match=REFUSED):
        write_text(tmp_path / "rig" / "preview" / "x.txt", "x")


@pytest.mark.parametrize("name", ["rig", "rig/objects", "print", "captures", "eval"])
@pytest.mark.parametrize("target", ["outside", "nowhere", "loop"])
def test_no_workspace_is_made_through_a_link(outside, tmp_path, name, target):
    place = tmp_path / "new" / name
    place.parent.mkdir(parents=True, exist_ok=True)
    place.symlink_to({"outside": outside, "nowhere": tmp_path / "none", "loop": place.name}[target])
    (tmp_path / "new" / "toolkit.toml").write_text("schema_version = 1\n")
    before = sorted(outside.rglob("*"))
    with pytest.raises(ToolkitError, match=r"is a link: nothing is written|is a file|circle"):
        make_workspace(tmp_path / "new")
    assert sorted(outside.rglob("*")) == before and not (tmp_path / "none").exists()


def test_links_of_the_users_own_are_followed(linked, outside, tmp_path, monkeypatch):
    """To a workspace, above it, and where there is none: a bigger disk may be anywhere but below it."""
    (tmp_path / "elsewhere").symlink_to(tmp_path / "space")
    (tmp_path / "photographs").symlink_to(outside)
    write_text(Workspace(tmp_path / "elsewhere").print_dir / "page.txt", "page")
    assert (tmp_path / "space" / "print" / "page.txt").read_text() == "page"
    write_text(tmp_path / "photographs" / "x.txt", "x")
    delete_file(tmp_path / "photographs" / "x.txt")
    monkeypatch.chdir(linked)  # where the link leads: the user is there, and it is another workspace
    write_text(Workspace(linked.resolve()).print_dir / "page.txt", "page")
    check_links(linked.parent / ".." / "photographs")


def test_a_link_that_leads_into_a_workspace_is_followed_no_further(linked, tmp_path):
    (tmp_path / "short").symlink_to(linked.parent)
    with pytest.raises(ToolkitError, match=REFUSED):
        write_text(tmp_path / "short" / "captures" / "x.txt", "x")


def test_what_is_not_there_or_no_path_is_no_link(tmp_path):
    (tmp_path / "toolkit.toml").write_text("schema_version = 1\n")
    for odd in ("none", "a\0b", "x" * 5000):
        check_links(tmp_path / odd / "deeper")
    delete_file(tmp_path / "none" / "x.txt")
    delete_file(tmp_path / "toolkit.toml" / "x.txt")


def test_a_file_that_may_not_be_deleted_is_a_line(tmp_path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(ToolkitError, match=r"cannot delete .*folder"):
        delete_file(tmp_path / "folder")
