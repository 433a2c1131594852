"""Patches for another network in a folder of their own: `--patches NAME`."""

import numpy as np
import pytest
from typer.testing import CliRunner

from toolkit.core.errors import ToolkitError
from toolkit.objects.find_patch import find_patch
from toolkit.objects.load import load_object
from toolkit.objects.records import read_patch, write_patch
from toolkit.rig.variants import find_booster


@pytest.fixture
def space(tmp_path, make_crate_space, patch_record):
    space = make_crate_space(tmp_path / "space")
    grey = np.full((12, 12, 3), 90, np.uint8)
    write_patch(space.patches_dir / "other", grey, patch_record("crate"))
    write_patch(space.patches_dir / "other", grey + 1, patch_record("toaster") | {"class_index": 2})
    (space.patches_dir / "previews").mkdir()
    (space.patches_dir / "previews" / "crate.png").write_bytes(b"no patch")
    return space


def test_a_set_is_not_mixed_with_the_default_one(space):
    assert "toaster" not in space.patches()
    chosen = space.with_patches("other")
    assert set(chosen.patches()) == {"crate", "toaster"}
    assert chosen.patches()["crate"] == space.root / "print" / "patches" / "other" / "crate.png"
    assert space.patches()["crate"] == space.root / "print" / "patches" / "crate.png"
    assert chosen.with_patches(None) == space
    assert chosen.print_dir == space.root / "print" / "other" and space.print_dir == space.root / "print"


def test_variants_come_from_the_set(space):
    item = load_object(space.object_spec("crate"))
    chosen = space.with_patches("other")
    np.testing.assert_array_equal(find_booster(chosen, item, "patched").pixels, 90)
    assert find_booster(chosen, item, "wrong-patch").name == "toaster"
    assert find_patch(space, item).record.png_sha256 == read_patch(space.patches_dir / "crate.png").record.png_sha256
    for suffix in (".png", ".json"):
        (chosen.patches_dir / f"crate{suffix}").unlink()
    with pytest.raises(ToolkitError, match=r"no patch for object 'crate' \(class 'crate'\) in other: .*--model other"):
        find_patch(chosen, item)


def test_unknown_sets_are_refused(space):
    assert "previews" not in space.patch_sets() and "other" in space.patch_sets()
    for name in ("othr", "../other", "previews", ""):
        with pytest.raises(ToolkitError, match="no set of patches called"):
            space.with_patches(name)


@pytest.mark.slow
def test_the_commands_shoot_and_print_the_set(space):
    from toolkit.cli import app

    def toolkit(*arguments):
        done = CliRunner().invoke(app, [*arguments, "--workspace", str(space.root), "--quiet"])
        assert done.exit_code == 0, done.output
        return done.output

    toolkit("capture-sim", "--patches", "other")
    manifest = (space.captures_dir / "sim-other" / "manifest.jsonl").read_text()
    assert read_patch(space.patches_dir / "other" / "crate.png").record.png_sha256 in manifest
    toolkit("print", "--all", "--patches", "other")
    assert {file.name for file in (space.print_dir / "other").glob("*.pdf")} == {"crate.pdf", "toaster.pdf"}
    assert not list(space.print_dir.glob("*.pdf"))
