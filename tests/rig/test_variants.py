"""What is stuck on an object in each variant."""

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.find_patch import find_patch
from toolkit.objects.load import load_object
from toolkit.objects.records import TAPE_MARGIN_MM, read_patch, write_patch
from toolkit.rig.variants import ON_PAPER, apply_booster, find_booster


@pytest.fixture
def space(tmp_path, make_crate_space, patch_record, monkeypatch):
    """A workspace whose only patches are its own."""
    space = make_crate_space(tmp_path)
    monkeypatch.setattr(Workspace, "patches", lambda self: {p.stem: p for p in sorted(self.patches_dir.glob("*.png"))})
    other = np.zeros((12, 12, 3), np.uint8)
    write_patch(space.patches_dir, other, patch_record("toaster") | {"class_index": 2})
    return space


@pytest.fixture
def crate(space):
    return load_object(space.object_spec("crate"))


def test_boosters_of_each_variant(space, crate):
    own = read_patch(space.patches_dir / "crate.png")
    found = {variant: find_booster(space, crate, variant) for variant in ("unpatched", *ON_PAPER)}
    assert found["unpatched"] is None
    for variant in ("patched", "patch-alone"):
        np.testing.assert_array_equal(found[variant].pixels, own.pixels)
        assert found[variant].sha256 == own.record.png_sha256
    assert found["wrong-patch"].name == "toaster"
    assert np.ptp(found["grey-patch"].pixels) == 0
    noise = found["random-patch"].pixels
    assert noise.std() > 60
    assert abs(np.corrcoef(noise.ravel(), own.pixels.ravel())[0, 1]) < 0.2
    assert {booster.sizes_mm for booster in found.values() if booster} == {(40,)}  # as the spec says
    assert {booster.pixels.shape for booster in found.values() if booster} == {(12, 12, 3)}
    again = find_booster(space, crate, "random-patch")
    np.testing.assert_array_equal(again.pixels, noise)


def test_a_patch_alone_is_a_flat_sheet_without_the_object(space, crate):
    mesh = apply_booster(crate, find_booster(space, crate, "patch-alone"))
    side = 40 + 2 * TAPE_MARGIN_MM
    np.testing.assert_allclose(mesh.size_mm[:2], side, atol=1e-3)
    assert mesh.size_mm[2] < 1
    assert mesh.bounds[0, 2] >= 0


def test_dressing_keeps_the_object(space, crate):
    mesh = apply_booster(crate, find_booster(space, crate, "grey-patch"))
    np.testing.assert_array_equal(mesh.vertices[: len(crate.mesh.vertices)], crate.mesh.vertices)
    assert apply_booster(crate, None) is crate.mesh


def test_a_patch_of_the_class_serves_an_object_of_another_name(space, crate):
    (space.patches_dir / "crate.png").rename(space.patches_dir / "box7.png")
    (space.patches_dir / "crate.json").rename(space.patches_dir / "box7.json")
    assert find_patch(space, crate).record.class_name == "crate"


def test_what_is_missing_is_said(space, crate):
    with pytest.raises(ToolkitError, match="no variant called 'pached': did you mean patched"):
        find_booster(space, crate, "pached")
    for suffix in (".png", ".json"):
        (space.patches_dir / f"toaster{suffix}").unlink()
    with pytest.raises(ToolkitError, match="wrong-patch needs a patch of another class"):
        find_booster(space, crate, "wrong-patch")
    (space.patches_dir / "crate.png").unlink()
    with pytest.raises(ToolkitError, match=r"no patch for object 'crate'.*toolkit train-patch"):
        find_booster(space, crate, "patched")


@pytest.mark.parametrize("damage", [b"", b"\x89PNG", b"no picture"])
def test_a_broken_patch_of_another_object_stops_no_search(space, crate, damage, capsys):
    (space.patches_dir / "crate.png").rename(space.patches_dir / "z.png")
    (space.patches_dir / "crate.json").rename(space.patches_dir / "z.json")
    (space.patches_dir / "mug.png").write_bytes(damage)
    assert find_patch(space, crate).record.class_name == "crate"
    assert find_booster(space, crate, "wrong-patch").name == "toaster"
    said = capsys.readouterr().err
    assert said.count("left out: ") == 1 and "mug" in said


def test_a_broken_patch_of_the_objects_own_name_is_refused(space, crate):
    (space.patches_dir / "crate.png").write_bytes(b"")
    with pytest.raises(ToolkitError, match=r"crate\.png"):
        find_patch(space, crate)


def test_a_broken_record_of_another_objects_wrap_or_texture_stops_no_search(space, crate):
    for folder in (space.textures_dir, space.wraps_dir / "mug"):
        folder.mkdir(parents=True, exist_ok=True)
    (space.textures_dir / "mug.png").write_bytes(b"")
    (space.textures_dir / "mug.json").write_text("{")
    (space.wraps_dir / "mug" / "wrap.json").write_text("{")
    with pytest.raises(ToolkitError, match="no texture for object 'crate': run 'toolkit train-texture"):
        find_booster(space, crate, "textured")
    with pytest.raises(ToolkitError, match="no wrap is for 'crate': make one"):
        find_booster(space, crate, "wrapped")
