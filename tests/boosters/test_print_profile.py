"""Training through a measured printer: the same colours as the profile's own, true gradients, and a run of its own."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from copier import TERMS, copier_profile, print_colours
from part_checks import check_gradient, count_changed, grey_noise

from toolkit.boosters.patch_config import PATCHES, list_patch_inputs, make_config, use_printer
from toolkit.boosters.pixel_config import DataConfig
from toolkit.boosters.transforms.printing import PrintProcess, ProfiledPrint, encode, use_profile
from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import linear_to_srgb
from toolkit.imaging.printer import (
    raise_terms,
    read_print_profile,
    white_paper,
    write_print_profile,
)

NO_BLEED = {"bleed_mm": (0.001, 0.001)}


def part(**changes) -> ProfiledPrint:

    return use_profile(copier_profile()).with_overrides({**NO_BLEED, **changes})


def config(tmp_path: Path | None = None, **changes):
    if tmp_path is not None:
        changes = use_printer(changes, write_print_profile(tmp_path / "copier.json", copier_profile()))
    return make_config("default", changes, DataConfig(sources=("rig",)))


def test_colours_are_those_that_the_profile_says():
    """Torch's against NumPy's, and NumPy's against the polynomial written out."""
    colours = np.random.default_rng(0).random((40, 3))
    pixels = torch.from_numpy(colours.T.reshape(1, 3, 5, 8))
    said = part().colour(pixels)[0].reshape(3, 40).T.numpy()
    np.testing.assert_allclose(said, print_colours(copier_profile(), colours), atol=1e-6)
    r, g, b = colours[0] ** 1.8
    terms = np.array([1, r, g, b, r * g, r * g * b, b * b])
    np.testing.assert_allclose(raise_terms(colours[0], 1.8, TERMS), terms)
    linear = terms @ np.array(copier_profile().coefficients) * np.array(white_paper())
    np.testing.assert_allclose(print_colours(copier_profile(), colours[0]), linear_to_srgb(linear), atol=1e-6)


def test_a_profile_that_changes_nothing_changes_nothing():
    identity = copier_profile(
        power=1, exponents=((1, 0, 0), (0, 1, 0), (0, 0, 1)), coefficients=((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        paper_linear=(1, 1, 1),
    )  # fmt: skip
    pixels = grey_noise(2, 3, 6, 6)
    printed = use_profile(identity).colour(pixels)
    torch.testing.assert_close(printed, encode(pixels))


def test_gradients_are_those_of_finite_differences():
    check_gradient(part().colour, grey_noise(1, 3, 3, 4))
    blurred = part(bleed_mm=(0.2, 0.4))
    check_gradient(lambda patch: blurred.change(patch, np.random.default_rng(0)), grey_noise(3, 5, 5))
    check_gradient(lambda prints: blurred.change(prints, np.random.default_rng(0)), grey_noise(2, 3, 4, 4))


def test_gradients_at_black_are_numbers():
    black = torch.zeros(1, 3, 2, 2, dtype=torch.float64, requires_grad=True)
    for power in (1.0, 1.4, 2.6):
        (gradient,) = torch.autograd.grad(part(power=power).colour(black).sum(), black)
        assert bool(torch.isfinite(gradient).all())


def test_ink_spreads_as_in_the_generic_process():
    flat = grey_noise(3, 8, 8)
    wide = part(bleed_mm=(0.6, 0.6)).change(flat, np.random.default_rng(0))
    crisp = part().change(flat, np.random.default_rng(0))
    assert wide.std() < 0.8 * crisp.std()


def test_probability_is_kept():
    prints = grey_noise(60, 3, 4, 4)
    assert count_changed(part().change, prints) == 60
    assert count_changed(part(probability=0).change, prints) == 0
    with pytest.raises(ToolkitError, match="probability 2: expected 0 to 1"):
        part(probability=2)


def test_the_flag_takes_the_place_of_the_generic_printer(tmp_path):
    assert isinstance(config().print_process, PrintProcess)
    asked = config(tmp_path)
    assert asked.print_process == use_profile(copier_profile())
    assert asked.appearance().on_print == (asked.print_process,)
    file = tmp_path / "copier.json"
    paper = make_config("paper", use_printer({}, file), DataConfig(sources=("photos",)))
    assert isinstance(paper.print_process, ProfiledPrint)
    with pytest.raises(ToolkitError, match=r"print_process off print_profile .*copier.json: expected one of the two"):
        config(tmp_path, print_process=False)


def test_the_profile_is_recorded_listed_and_makes_another_run(tmp_path):
    generic, own = config(), config(tmp_path)
    settings = json.loads(json.dumps(own.record()))
    assert settings["print_process"]["name"] == "copier" and len(settings["print_process"]["sha256"]) == 64
    assert settings["print_process"]["coefficients"] == [list(row) for row in copier_profile().coefficients]
    line = dict(own.rows())["print process"]
    assert "as measured, profile copier" in line and "ΔE00 1.2" in line
    other = copier_profile(coefficients=tuple((r + 0.001, g, b) for r, g, b in copier_profile().coefficients))
    write_print_profile(tmp_path / "other.json", other)
    sized = make_config(
        "default", use_printer({"size_mm": 100.0}, tmp_path / "copier.json"), DataConfig(sources=("rig",))
    )
    assert sized.print_process.texel_mm == pytest.approx(100 / sized.size_px), "ink spreads by millimetres"
    third = make_config("default", use_printer({}, tmp_path / "other.json"), DataConfig(sources=("rig",)))
    hashes = {
        PATCHES.key(*list_patch_inputs(one, "jet", [], "data")) for one in (generic, own, third, config(tmp_path))
    }
    assert len(hashes) == 3


def test_a_profile_comes_back_from_its_file(tmp_path):
    file = write_print_profile(tmp_path / "deep" / "copier.json", copier_profile())
    assert read_print_profile(file) == copier_profile()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"power": 0.5}, "field 'power'"),
        ({"coefficients": [[1, 1, 1]]}, "expected 7 coefficients"),
        ({"coefficients": [["x", 1, 1]] * 7}, "field 'coefficients.0.0'"),
        ({"exponents": [[2, 2, 0]] * 7}, "add up to at most 3"),
        ({"exponents": [[1, 0, 0]] * 7}, "exponents that differ"),
        ({"patch_sha256": "short"}, "field 'patch_sha256'"),
        ({"paper_linear": [0, 1, 1]}, "paper_linear from 0.2"),
        ({"schema_version": 2}, "field 'schema_version'"),
        ({"more": 1}, "field 'more'"),
    ],
)
def test_a_damaged_file_is_one_clear_line(tmp_path, changes, words):
    content = copier_profile().model_dump(mode="json") | changes
    file = tmp_path / "copier.json"
    file.write_text(json.dumps(content))
    with pytest.raises(ToolkitError) as caught:
        read_print_profile(file)
    assert words in str(caught.value) and str(file) in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(ToolkitError, match="cannot read"):
        read_print_profile(tmp_path / "none.json")
