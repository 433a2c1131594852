"""What is stuck on an object in each variant."""

from dataclasses import replace

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.find_patch import find_patch
from toolkit.objects.load import load_object
from toolkit.objects.records import TAPE_MARGIN_MM, read_patch, write_patch
from toolkit.objects.spec import PatchMount
from toolkit.rig.mount import PAPER
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


class TestCamouflage:
    """The control that shows what its sheets hide."""

    @pytest.fixture
    def painted(self, crate):
        """The crate with a pattern that is laid on it from above; each texel of a patch lies on a field of its own."""
        mesh, n = crate.mesh, 12
        side = 40.0 / n  # mm
        low = mesh.vertices[:, :2].min(axis=0)
        fields = np.random.default_rng(0).integers(0, 256, (40, 40, 3), np.uint8)
        # a field's corner lies at the patch's, which is in the middle of the top
        start = (mesh.vertices[:, :2].min(axis=0) + mesh.vertices[:, :2].max(axis=0)) / 2 - 20 * side
        assert (start <= low).all()
        uv = ((mesh.vertices[:, :2] - start) / (40 * side)).astype(np.float32)
        materials = tuple(replace(material, texture=fields) for material in mesh.materials)
        return replace(crate, mesh=replace(mesh, uv=uv, materials=materials)), fields

    def test_it_is_what_lies_below(self, space, painted):
        item, fields = painted
        booster = find_booster(space, item, "camouflage")
        assert booster.pixels.shape == (12, 12, 3) and booster.name == "camouflage"
        # rows count down: the patch is 12 fields in the middle of 40
        np.testing.assert_array_equal(booster.pixels, fields[14:26, 14:26])
        mesh = booster.apply(item)
        (paper,) = [one for one in mesh.materials if one.name == "paper"]
        assert {tuple(colour) for colour in fields[14:26, 14:26].reshape(-1, 3)} <= {
            tuple(colour) for colour in paper.texture.reshape(-1, 3)
        }

    def test_light_is_averaged_and_not_codes(self, space, painted):
        item, _ = painted
        stripes = np.zeros((1, 80, 3), np.uint8)
        stripes[:, ::2] = 255  # the left half of each texel
        mesh = replace(item.mesh, materials=tuple(replace(one, texture=stripes) for one in item.mesh.materials))
        pixels = find_booster(space, replace(item, mesh=mesh), "camouflage").pixels
        assert (pixels == 188).all(), "half of the light is code 188, half of the codes 128"

    def test_each_of_several_sheets_has_its_own(self, space, painted):
        item, _ = painted
        mounts = [PatchMount(at="top", size_mm=40), PatchMount(at="front", size_mm=30)]
        several = replace(item, spec=item.spec.with_mounts(mounts))
        top, front = find_booster(space, several, "camouflage").sheets(several)
        assert not np.array_equal(top.mesh.materials[0].texture, front.mesh.materials[0].texture)


def test_the_margin_is_the_records_and_changes_what_is_hashed(space, crate, patch_record):
    plain = find_booster(space, crate, "patched")
    write_patch(space.patches_dir, plain.pixels, patch_record("crate") | {"margin": "bleed"})
    assert '"margin": "bleed"' in (space.patches_dir / "crate.json").read_text()
    printed = find_booster(space, crate, "patched")
    assert (plain.margin, printed.margin) == ("white", "bleed")
    assert "margin" not in plain.describe(crate) and printed.describe(crate)["margin"] == "bleed"
    (sheet,) = printed.sheets(crate)
    assert (sheet.mesh.materials[0].texture == PAPER).all(axis=2).sum() == 0
