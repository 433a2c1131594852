"""Recipe and flags make settings; flags win; what acts is said."""

import pytest
from tiny_network import tiny_config

from toolkit.boosters.patch_config import PATCHES, RECIPES, list_patch_inputs, make_config
from toolkit.boosters.pixel_config import DataConfig
from toolkit.boosters.transforms.placement import MixedPlacement
from toolkit.core.errors import ToolkitError
from toolkit.objects.records import printed_size_mm

PARTS = ("pose", "light", "print_process", "glare", "camera")


def make(recipe: str = "default", source: str = "photos", size_px: int = 100, **choices):
    return make_config(recipe, {"size_px": size_px, **choices}, DataConfig(sources=(source,)))


@pytest.mark.parametrize(
    ("recipe", "choices", "settings"),
    [
        ("default", {}, {"steps": 600, "batch": 16, "lr": 0.05, "schedule": "cosine", "smoothing_px": 2.0}),
        ("default", {"epochs": 2}, {"steps": 26, "epochs": 2}),
        ("default", {"batch": 7, "lr": 0.01}, {"steps": 600, "batch": 7, "lr": 0.01}),
        ("default", {"affine.rotation_deg": (0, 5)}, {"affine.rotation_deg": [0, 5], "affine.share": [0.20, 0.42]}),
        ("default", {"tv_weight": 0.5}, {"tv_weight": 0.5, "printability_weight": 0.0}),
        ("default", {"pose.length_mm": 400.0}, {"pose.length_mm": 400.0}),
        ("paper", {}, {"steps": 30, "epochs": 30, "batch": 512, "lr": 0.1, "schedule": "constant"}),
        ("paper", {}, {"smoothing_px": 0.0, "start_contrast": 1.0, "mounted_share": 0.0, "mounted_views": None}),
        ("paper", {}, {"pose": None, "light": None, "print_process": None, "glare": None, "camera": None}),
        ("paper", {}, {"without_effect": {"momentum": 0.9, "weight_decay": 1e-4}}),
        ("paper", {"batch": 16, "epochs": 2}, {"steps": 26, "epochs": 2, "batch": 16, "lr": 0.1}),
        ("paper", {"steps": 5}, {"steps": 5, "epochs": None, "batch": 512}),
        ("paper", {"smoothing_px": 1.0, "schedule": "linear"}, {"smoothing_px": 1.0, "schedule": "linear"}),
        ("paper", {"light": True, "pose": True}, {"light.probability": 1.0, "pose.probability": 0.5, "camera": None}),
    ],
)
def test_recipe_and_flags_make_settings(recipe, choices, settings):
    """With 205 training images: 13 steps of 16, or 1 of 512, an epoch."""
    found = make(recipe, **choices).count_steps(205).record()
    for name, wanted in settings.items():
        value = found
        for key in name.split("."):
            value = value[key]
        assert value == wanted, name


@pytest.mark.parametrize("part", PARTS)
def test_every_part_can_be_switched_alone(part):
    without = make(**{part: False}).record()
    assert [name for name in PARTS if without[name] is None] == [part]
    alone = make("paper", **{part: True}).record()
    assert [name for name in PARTS if alone[name] is not None] == [part]


def test_the_parts_reach_the_appearance():
    full, bare = make().appearance(), make("paper").appearance()
    assert isinstance(full.placement, MixedPlacement)
    assert [len(full.on_print), len(full.on_paper), len(full.on_photo)] == [1, 2, 3]
    assert [len(bare.on_print), len(bare.on_paper), len(bare.on_photo)] == [0, 0, 0]
    assert bare.placement == make("paper").affine


def test_a_default_part_acts_in_a_quarter_to_a_half():
    request = make()
    for part in (request.pose, request.print_process, request.glare, *request.camera):
        assert 0.25 <= part.probability <= 0.5


def test_mounted_share_follows_recipe_and_source():
    assert make(source="rig:x").mounted_share == 0.875
    assert make().mounted_share == 0
    assert make("paper", source="rig").mounted_share == 0
    assert make("paper", source="rig", mounted_share=0.4).mounted_share == 0.4


def test_the_pose_knows_the_printed_size_and_a_large_patch_a_large_object():
    assert make(size_px=60).pose.size_mm == printed_size_mm(60)
    assert make(size_px=400).pose.length_mm == printed_size_mm(400)
    with pytest.raises(ToolkitError, match=r"pose.length_mm 50: expected no less than the patch on it, 88.2 mm"):
        make(size_px=100, **{"pose.length_mm": 50.0})


def test_penalty_is_none_unless_weighed():
    import torch

    from toolkit.boosters.patch_config import non_printability, total_variation

    assert make().penalty() is None
    theta = torch.rand(3, 8, 8)
    both = make(tv_weight=2.0, printability_weight=3.0).penalty()(theta)
    torch.testing.assert_close(both, 2 * total_variation(theta) + 3 * non_printability(theta))
    torch.testing.assert_close(make(tv_weight=2.0).penalty()(theta), 2 * total_variation(theta))


def test_settings_decide_the_hash():
    hashes = [
        PATCHES.key(*list_patch_inputs(make(**choices), "jet", [], ""))
        for choices in ({}, {"glare": False}, {"tv_weight": 1.0})
    ]
    assert len(set(hashes)) == 3


@pytest.mark.parametrize(
    ("recipe", "choices", "words"),
    [
        ("papers", {}, "no recipe called 'papers': did you mean paper"),
        ("paper", {"steps": 3, "epochs": 3}, "steps 3 epochs 3: expected one of the two"),
        ("paper", {"epochs": 0}, "epochs 0: expected at least 1"),
        ("default", {"tv_weight": -1.0}, "tv_weight -1: expected at least 0"),
        ("default", {"printability_weight": float("nan")}, "printability_weight nan: expected"),
        ("default", {"affine.share": (0.5, 0.2)}, "affine.share 0.5 0.2: expected two rising numbers from 0.02 to 2"),
        ("default", {"mounted_views": 0}, "mounted_views 0: expected at least 2"),
        ("default", {"batch": 0}, "batch 0: expected at least 1"),
    ],
)
def test_what_cannot_be_is_one_clear_line(recipe, choices, words):
    with pytest.raises(ToolkitError, match=words) as caught:
        make(recipe, **choices)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("recipe", list(RECIPES))
def test_every_setting_that_acts_is_said(recipe):
    request = make(recipe, printability_weight=0.25).count_steps(205)
    said = dict(request.rows())
    assert said["steps"] == f"{request.steps}" and said["printability weight"] == "0.25"
    assert "rotation -180 to 180°" in said["affine"]
    for name, word in (
        ("pose", "elevation 20 to 80°"),
        ("light", "exposure"),
        ("glare", "strip"),
        ("camera", "quality"),
    ):
        assert (word in said.get(name, "")) == (request.record()[name] is not None)
    assert ("momentum" in said["without effect"]) == (recipe == "paper")


def test_a_config_by_hand_needs_no_recipe():
    assert dict(tiny_config().rows())["recipe"] == "custom"


@pytest.mark.parametrize("fill", [(0.9, 0.5), (0.01, 0.5), (0.5, 1.5)])
def test_a_distance_that_no_frame_holds_is_refused(fill):
    with pytest.raises(ToolkitError, match=r"mounted_fill .*: expected two rising numbers from 0.05 to 1"):
        make(source="rig", mounted_fill=fill)
    assert make(source="rig", mounted_fill=(0.2, 0.5)).record()["mounted_fill"] == [0.2, 0.5]


def test_the_earlier_word_for_clouds_goes_on_working():
    from toolkit.boosters.texture_config import make_config

    for words in (False, True):
        asked = [make_config("default", {"objects": ("crate",), name: words}) for name in ("fog", "clouds")]
        assert asked[0] == asked[1] and (asked[0].clouds is not None) == words


def test_one_thing_is_called_fog_in_the_help_of_training():
    """`--weather fog`; ImageNet-C's, which `--corrupt` takes by its name, is not offered as an example."""
    from toolkit.boosters import texture_config
    from toolkit.cli.options import list_flags

    for recipes in (RECIPES, texture_config.RECIPES):
        flags = [one for one in list_flags(recipes) if "fog" in f"{one.spelling} {one.info.description}".lower()]
        assert [one.spelling for one in flags] == ["--weather"]
