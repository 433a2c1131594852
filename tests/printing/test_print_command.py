"""`toolkit print` from the command line."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from printed_pages import make_patch
from pypdf import PdfReader
from typer.testing import CliRunner

from toolkit.cli.app import make_single
from toolkit.cli.print_ import print_patches
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.printing.print_patches import print_all


@pytest.fixture
def space(tmp_path, monkeypatch):
    (tmp_path / "rig").mkdir()
    for name in ("warplane", "racer"):
        make_patch(tmp_path / "print" / "patches", name, 20, class_name=name)
    make_patch(tmp_path / "print" / "patches", "racer-2", 20, class_name="racer")
    # The package's own patches would join in with --all.
    monkeypatch.setattr("toolkit.core.workspace.PACKAGE_DATA", tmp_path / "no-package-data")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(*arguments):
    return CliRunner().invoke(make_single(print_patches), [str(argument) for argument in arguments])


def refuse(*arguments) -> str:
    result = call(*arguments)
    assert isinstance(result.exception, ToolkitError), result.output
    message = str(result.exception)
    assert "\n" not in message
    return message


def test_one_class(space):
    result = call("--class", "warplane")
    assert result.exit_code == 0, result.output
    assert len(PdfReader(space / "print" / "warplane.pdf").pages) == 1
    assert "17.6 × 17.6 mm" in result.output
    assert "1 page of a4 portrait" in result.output
    assert "actual size" in result.output
    assert sorted(path.name for path in (space / "print").iterdir()) == ["patches", "warplane.pdf"]


def test_several_classes_and_json(space):
    result = call("--class", "warplane", "--class", "racer", "--scale", "100%", "--paper", "letter", "--json")
    content = json.loads(result.stdout)
    assert [one["name"] for one in content["printed"]] == ["warplane", "racer"]
    assert content["printed"][0]["size_mm"] == pytest.approx(20 / 72 * 25.4, abs=1e-3)
    assert content["printed"][0]["paper"] == "letter"
    assert content["failed"] == []


def test_each_patch_is_scored_before_it_is_printed(space):
    """The test's patches are red from 255 and without blue: no ink makes them; neighbours' green is random."""
    said = call("--class", "warplane").output.splitlines()
    assert said[0].startswith("warplane: total variation 0.1")
    assert "come out duller than on the screen" in said[0]
    assert said[1].startswith("print/warplane.pdf")
    (one,) = json.loads(call("--class", "warplane", "--json").stdout)["printed"]
    assert one["total_variation"] == pytest.approx(1 / 9, abs=0.01)
    assert one["non_printability"] > 0.1


def test_all(space):
    assert call("--all", "--quiet").exit_code == 0
    assert {path.stem for path in (space / "print").glob("*.pdf")} == {"warplane", "racer", "racer-2"}


def test_print_all_is_what_the_command_does(space):
    printed = print_all(Workspace(space))
    by_function = {one.name: Path(one.file).read_bytes() for one in printed}
    call("--all")
    assert by_function == {path.stem: path.read_bytes() for path in (space / "print").glob("*.pdf")}
    assert len(by_function) == 3


def test_class_of_the_record_names_its_patches(space):
    make_patch(space / "print" / "patches", "mine", 20, class_name="sports car")
    assert call("--class", "Sports Car").exit_code == 0
    assert (space / "print" / "mine.pdf").is_file()


def test_patch_file_and_out(space, tmp_path):
    make_patch(tmp_path / "else", "other", 20)
    assert call("--patch-file", tmp_path / "else" / "other.png", "--out", tmp_path / "there" / "x.pdf").exit_code == 0
    assert (tmp_path / "there" / "x.pdf").read_bytes().startswith(b"%PDF")
    assert "name a folder" in refuse("--all", "--out", "x.pdf")


def test_the_rigs_size_is_compared(space):
    (space / "rig" / "objects").mkdir()
    spec = space / "rig" / "objects" / "warplane.toml"
    spec.write_text(
        'name="warplane"\nclass="warplane"\nmesh="builtin:warplane"\nlength_mm=270\n[patch]\nsize_mm=40.0\n'
    )
    said = call("--class", "warplane").output
    assert "40.0 × 40.0 mm" in said and "the rig mounts" not in said
    said = call("--class", "warplane", "--size-mm", "60").output
    assert "60.0 × 60.0 mm" in said and "the rig mounts warplane on warplane at 40.0 mm" in said
    # also beside a patch that is printed by its object, whose own size is the one asked for
    said = call("--class", "warplane", "--object", "warplane", "--size-mm", "60").output
    assert said.count("the rig mounts warplane on warplane at 40.0 mm") == 1
    assert "88" not in call("--class", "warplane", "--scale", "250").output.split("the rig mounts")[0].split("px")[0]
    spec.write_text("name = 3")
    assert "not compared with the rig" in call("--class", "warplane").output


def test_unknown_class_names_the_nearest(space):
    assert "did you mean warplane?" in refuse("--class", "warplan")


def test_nothing_named_and_nothing_there(space):
    assert refuse().startswith("no patch named: give --object, --class, --all or --patch-file (known: racer,")
    for path in (space / "print" / "patches").iterdir():
        path.unlink()
    assert "toolkit train-patch" in refuse("--all")


def test_unknown_paper(space):
    assert "did you mean letter?" in refuse("--class", "warplane", "--paper", "leter")


@pytest.mark.parametrize(
    ("option", "value"),
    [("--scale", "0"), ("--scale", "big"), ("--dpi", "-1"), ("--size-mm", "6000"), ("--copies", "0")],
)
def test_numbers_that_make_no_sense(space, option, value):
    refuse("--class", "warplane", option, value)
    assert not (space / "print" / "warplane.pdf").exists()


def test_patch_of_another_record(space):
    patches = space / "print" / "patches"
    (patches / "warplane.png").write_bytes((patches / "racer.png").read_bytes()[:-1] + b"x")
    assert "does not match the record's" in refuse("--class", "warplane")
    assert not (space / "print" / "warplane.pdf").exists()


def test_patch_without_record(space):
    (space / "print" / "patches" / "warplane.json").unlink()
    assert "no record warplane.json" in refuse("--class", "warplane")


def test_all_prints_the_good_and_lists_the_bad(space):
    (space / "print" / "patches" / "warplane.json").unlink()
    result = call("--all")
    assert result.exit_code == 1
    assert "not printed" in result.stderr
    assert "warplane.json" in result.stderr
    assert (space / "print" / "racer.pdf").is_file()


def test_read_only_folder_leaves_the_old_file(space, monkeypatch):
    call("--class", "warplane")
    before = (space / "print" / "warplane.pdf").read_bytes()
    plain_open = os.open

    def refuse_to_write(path, flags, *arguments, **more):
        if flags & (os.O_WRONLY | os.O_RDWR):
            raise OSError(errno.EROFS, "Read-only file system")
        return plain_open(path, flags, *arguments, **more)

    monkeypatch.setattr(os, "open", refuse_to_write)
    assert "read-only" in refuse("--class", "warplane", "--scale", "300")
    assert (space / "print" / "warplane.pdf").read_bytes() == before
    assert not list((space / "print").glob(".*partial"))


@pytest.mark.slow
def test_printing_needs_neither_torch_nor_open3d(space):
    code = (
        "import sys; from toolkit.cli.print_ import print_patches; print_patches(classes=['warplane']);"
        # OpenCV and SciPy may be: the object is modelled, to see whether the sheet lies on it, and its colours are
        # compared with those that inks can show
        "heavy = {'torch', 'open3d', 'matplotlib', 'trimesh', 'numba'} & set(sys.modules);"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
