"""The demo on a machine without ImageNet weights: it has something to show, and shows it with a control."""

import json

import pytest

from toolkit.cli import setup
from toolkit.core.console import quietly
from toolkit.core.statistics import mcnemar_p
from toolkit.models import load
from toolkit.models.find import BUNDLED


@pytest.mark.slow
def test_without_weights_the_patch_helps_and_no_verdict_hangs_on_one_image(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(load, "load_best", lambda device: (load.load_classifier(BUNDLED, device="cpu"), "for a test"))
    with quietly():
        setup.demo(tmp_path / "lab", seed=0, device="cpu")
    said = " ".join(capsys.readouterr().out.split())
    assert "The patch helps." in said and "It is this patch." in said
    summary = json.loads((tmp_path / f"lab/eval/{BUNDLED}-sim/summary.json").read_text())
    shares = {one["variant"]: one["top1"] for one in summary["groups"] if one["object"] == "all"}
    assert shares["unpatched"] < 0.5 and shares["grey-patch"] < shares["patched"]
    (pair,) = (one for one in summary["pairs"] if (one["object"], one["variant"]) == ("all", "patched"))
    assert mcnemar_p(pair["gained"] - 1, pair["lost"] + 1) < 0.05
