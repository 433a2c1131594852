"""What the repository ships hangs together: patches, their pages, the bundled classifier."""

from pathlib import Path

import pytest

from toolkit.core.files import sha256_file
from toolkit.core.workspace import PACKAGE_DATA, Workspace
from toolkit.models.bundled import bundled_file, read_bundled
from toolkit.objects.load import BUILTIN
from toolkit.objects.records import read_patch
from toolkit.objects.shapes.everyday import MAKERS

ROOT = Path(__file__).parents[1]
SETS = (None, "rig18")


@pytest.mark.parametrize("patch_set", SETS)
def test_every_object_has_a_patch_no_longer_than_a_third_of_it(patch_set, tmp_path):
    from toolkit.objects.spec import read_spec

    space = Workspace(tmp_path).with_patches(patch_set)
    for name in BUILTIN:
        patch, spec = read_patch(space.patch(name)), read_spec(space.object_spec(name))
        assert patch.record.class_name == spec.class_name
        assert patch.size_mm <= spec.length_mm / 3


@pytest.mark.parametrize("patch_set", SETS)
def test_the_worked_example_holds_the_same_patches(patch_set):
    shipped, shown = PACKAGE_DATA / "patches" / (patch_set or ""), ROOT / "print" / "patches" / (patch_set or "")
    files = [file.name for name in BUILTIN for file in sorted(shipped.glob(f"{name}.*"))]
    assert len(files) == 2 * len(BUILTIN)
    assert [sha256_file(shipped / name) for name in files] == [sha256_file(shown / name) for name in files]


@pytest.mark.parametrize("patch_set", SETS)
@pytest.mark.parametrize("name", BUILTIN)
def test_its_page_is_of_the_shipped_patch(name, patch_set):
    from pypdf import PdfReader

    text = PdfReader(ROOT / "print" / (patch_set or "") / f"{name}.pdf").pages[0].extract_text()
    png = PACKAGE_DATA / "patches" / (patch_set or "") / f"{name}.png"
    assert sha256_file(png)[:12] in text.replace(" ", "")


def test_rig18_is_whole_small_and_not_imagenets():
    record, file = read_bundled(), bundled_file()
    assert sorted(record.labels) == sorted(MAKERS)
    assert file.stat().st_size < 25e6
    assert record.held_out.n >= 10 * len(record.labels)
    assert record.held_out.accuracy == pytest.approx(record.held_out.correct / record.held_out.n)
    assert "not ImageNet" in record.trained_on or "ImageNet" not in record.trained_on


def test_the_patches_of_rig18_were_trained_on_it():
    sha256 = sha256_file(bundled_file())
    for name in BUILTIN:
        record = read_patch(PACKAGE_DATA / "patches" / "rig18" / f"{name}.png").record
        assert [network.sha256 for network in record.networks] == [sha256]


def test_every_object_has_a_texture_that_fits_it(tmp_path):
    from toolkit.objects.load import load_object
    from toolkit.rig.variants import find_texture

    space = Workspace(tmp_path)
    for name in BUILTIN:
        item = load_object(space.object_spec(name))
        texture = find_texture(space, item)
        assert texture.record.name == name
        assert texture.record.class_name == item.spec.class_name
        assert texture.record.settings["recipe"] == "default"


def test_the_worked_example_holds_the_same_textures_and_the_objects_in_them():
    from toolkit.objects.records import read_texture

    shipped, shown = PACKAGE_DATA / "textures", ROOT / "rig" / "textures"
    for name in BUILTIN:
        for suffix in (".png", ".json"):
            assert sha256_file(shipped / f"{name}{suffix}") == sha256_file(shown / f"{name}{suffix}")
        record = read_texture(shipped / f"{name}.png").record
        assert sha256_file(shown / f"{name}.glb") == record.objects[0].glb_sha256
