"""What is said of a new object's sheet: where it was moved to, and whether it is small."""

import pytest

from toolkit.captures.suggest_places import _describe_offset, describe_small_sheet
from toolkit.objects.load import TableObject
from toolkit.objects.spec import ObjectSpec, PatchMount


@pytest.mark.parametrize(
    ("at", "offset_mm", "words"),
    [
        ("top", (37.5, 0), "37.5 mm forward"), ("top", (-10, 4), "10 mm back and 4 mm to the left"),
        ("top", (0, -4), "4 mm to the right"), ("front", (3, -4), "3 mm to the right and 4 mm down"),
        ("left", (0, 12), "12 mm up"), ("back", (0, 0), "there"),
    ],
)  # fmt: skip
def test_a_shift_is_said_by_its_directions(at, offset_mm, words):
    """`offset_mm` is (forward, left) on the top, and (right, up) on the sides."""
    assert _describe_offset(PatchMount(at=at, offset_mm=offset_mm)) == words


@pytest.mark.parametrize(
    ("length_mm", "size_mm", "words"),
    [(2000, None, "88 mm is 4% of the object's 2000 mm"), (2000, 300, ""), (250, None, "")],
)
def test_a_sheet_that_is_small_beside_its_object_is_said(make_box, length_mm, size_mm, words):
    mount = PatchMount(size_mm=size_mm)
    spec = ObjectSpec(name="helmet", class_name="crash helmet", mesh="helmet.glb", length_mm=length_mm, mounts=(mount,))
    said = describe_small_sheet(TableObject(spec, make_box((10, 20, 30))))
    assert words in said and bool(said) == bool(words)
