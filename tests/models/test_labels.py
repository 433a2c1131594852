"""ImageNet's folder names stand in the order of the networks' outputs."""

import csv
import re
from pathlib import Path

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.models.labels import imagenet_wnids, index_of_label, index_of_wnid

ATTRIBUTION = Path(__file__).parents[2].parent / "shared" / "images" / "nips2017" / "ATTRIBUTION.csv"


def test_a_thousand_sorted_ids():
    wnids = imagenet_wnids()
    assert len(wnids) == len(set(wnids)) == 1000
    assert list(wnids) == sorted(wnids)
    assert all(re.fullmatch(r"n\d{8}", wnid) for wnid in wnids)


def test_known_places():
    # as published with the challenge: tench, warplane, racer, toilet tissue
    known = {"n01440764": 0, "n04552348": 895, "n04037443": 751, "n15075141": 999}
    assert {wnid: index_of_wnid(wnid) for wnid in known} == known
    with pytest.raises(ToolkitError, match="n04552348"):
        index_of_wnid("n04552349")


@pytest.mark.skipif(not ATTRIBUTION.is_file(), reason="no photographs at ../shared/images/nips2017")
def test_agrees_with_a_labelled_set():
    with ATTRIBUTION.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            assert index_of_wnid(row["file"].split("/")[0]) == int(row["class_index"])


def test_exact_name_wins_over_other_cases():
    labels = ["Crane", "crane", "maillot", "maillot"]
    assert index_of_label(labels, "crane") == 1
    with pytest.raises(ToolkitError, match="maillot = 2, maillot = 3"):
        index_of_label(labels, "maillot")
    with pytest.raises(ToolkitError, match="known: Crane"):
        index_of_label(labels, "zzz")


def test_a_few_dozen_names_are_all_said_and_a_thousand_are_not():
    for count, is_listed in ((36, True), (1000, False)):
        with pytest.raises(ToolkitError) as error:
            index_of_label([f"kind-{number:03d}" for number in range(count)], "sports car")
        assert ("kind-035" in str(error.value)) == is_listed
