"""The same images by several renderers: counts by hand, what is no pair, and what is shown of it."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from toolkit.captures.capture import Capture
from toolkit.core.statistics import cohen_kappa
from toolkit.evaluation.agreement import (
    add_colours,
    compare_renderers,
    count_same,
    list_colours,
    list_flips,
    write_agreement,
)
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.results import compare_predictions
from toolkit.evaluation.tables import print_agreement

FILAMENT, MITSUBA = "filament (open3d 0.19.0)", "mitsuba 3.9.1 llvm_ad_rgb"
RAYS = {"renderer": "raycast", "light": "studio", "scene_sha256": "a"}
OTHERS = {
    "sim-filament": {"renderer": "filament", "renderer_version": FILAMENT, "light": "studio", "scene_sha256": "b"},
    "sim-mitsuba": {"renderer": "mitsuba", "renderer_version": MITSUBA, "light": "studio", "scene_sha256": "c"},
}


def series(source, marks, variant="patched", settings=RAYS, **more):
    """One image per character: `+` right, `-` wrong, `x` wrong in another way, `.` none."""
    images = []
    for i, mark in enumerate(marks, 1):
        path = f"{source}/racer/{variant}/pose_{i:02d}.png"
        booster = "f" * 64 if variant != "unpatched" else None
        capture = Capture(source, "racer", variant, i, Path(path), path, booster_sha256=booster, settings=settings)
        index = "+-x".find(mark)
        if index >= 0:
            images.append(Prediction(capture, 0, "racer", index, "guess", 0.6, 0.5, index + 1))
    return [replace(one, capture=replace(one.capture, **more)) for one in images]


def shoot(source, bare, boosted, settings=None, **more):
    settings = settings or OTHERS.get(source, RAYS)
    return [*series(source, bare, "unpatched", settings, **more), *series(source, boosted, "patched", settings, **more)]


HELPS = "-------+", "+++++++-"


def test_a_gain_is_counted_within_each_renderer():
    """Seven gained, one lost; six gained; and five, too few for p < 0.05."""
    seen = [
        *shoot("sim-mitsuba", "-----+++", "++++++++"), *shoot("sim", *HELPS),
        *shoot("sim-filament", "------++", "++++++++"),
    ]  # fmt: skip
    (found,) = compare_renderers(seen)
    assert found.sources == ("sim", "sim-filament", "sim-mitsuba") and found.renderers == ("raycast", FILAMENT, MITSUBA)
    counts = [(row.source, row.outcomes.only_second, row.outcomes.only_first) for row in found.gains]
    assert counts == [("sim", 7, 1), ("sim-filament", 6, 0), ("sim-mitsuba", 5, 0)]
    for row in found.gains:
        assert {one.capture.source for pair in row.pairs for one in (pair.first, pair.second)} == {row.source}
    (verdict,) = write_agreement("resnet18", found)
    # 7 against 1 has p = 0.07, 5 against 0 has 0.06
    assert verdict.tone == "open"
    assert verdict.verdict == ("The gain of the patch holds in filament, and is not shown in raycast and mitsuba")
    assert "raycast 1 → 7 of 8 (7 gained, 1 lost, exact McNemar p = 0.07)" in verdict.sentence


@pytest.mark.parametrize(
    ("others", "said", "tone"),
    [
        ({"sim-filament": "++++++--"}, "The gain of the patch holds in both renderers", "good"),
        ({"sim-filament": "++++++--", "sim-mitsuba": "+++++++-"}, "The gain of the patch holds in all 3 renderers",
         "good"),
        (
            {"sim-mitsuba": "--------"},
            "The gain of the patch holds in raycast, and is not shown in mitsuba; it does harm in mitsuba",
            "bad",
        ),
    ],
)  # fmt: skip
def test_the_sentence_names_who_does_not_agree(others, said, tone):
    seen = shoot("sim", "--------", "++++++--")
    for source, boosted in others.items():
        bare = "++++++--" if boosted == "--------" else "--------"
        seen += shoot(source, bare, boosted)
    (verdict,) = write_agreement("resnet18", *compare_renderers(seen))
    assert (verdict.verdict, verdict.tone) == (said, tone)
    assert verdict.verdict in [headline.verdict for headline in compare_predictions("resnet18", seen).headlines]


def test_answers_kappa_and_flips_are_counted_by_hand():
    seen = [*shoot("sim", "++--", "++xx"), *shoot("sim-mitsuba", "+-+-", "+++x")]
    (found,) = compare_renderers(seen)
    (pair,) = found.pairs
    bare, patched = pair.rows
    assert (bare.second, patched.second) == ("unpatched", "patched")
    assert bare.outcomes.kappa == cohen_kappa(1, 1, 1, 1) == 0 and count_same(bare) == 2
    assert patched.outcomes.kappa == pytest.approx(cohen_kappa(2, 0, 1, 1)) and count_same(patched) == 3
    assert list_flips(found) == [
        "racer unpatched: 2 (raycast), 3 (mitsuba)",
        "racer patched: 3 (mitsuba)",
    ]
    entry = found.as_json()
    assert entry["pairs"][0]["rows"][0] | {} == {
        "variant": "unpatched", "n": 4, "n_first": 2, "n_second": 2, "same_answer": 2, "kappa": 0.0,
        "gained_over_first": 1, "lost_over_first": 1,
    }  # fmt: skip
    assert entry["flips"][0] == {"object": "racer", "variant": "unpatched", "pose_id": 2, "right": [True, False]}


@pytest.mark.parametrize(
    "other",
    [
        {"settings": RAYS},
        {"settings": OTHERS["sim-mitsuba"] | {"light": "side"}},
        {"settings": {}},
        {"corruption": ("fog", 3)},
        {"booster_sha256": "e" * 64},
    ],
    ids=["one renderer", "other light", "no manifest", "in fog", "another booster"],
)
def test_what_differs_in_more_than_the_renderer_is_not_compared(other):
    seen = shoot("sim", *HELPS) + series("sim-mitsuba", HELPS[1], **({"settings": OTHERS["sim-mitsuba"]} | other))
    assert compare_renderers(seen) == []


def test_a_pose_counts_in_all_renderers_or_in_none():
    """Mitsuba has shot half: the ray caster's pairs of the other half are left out of this table alone."""
    seen = [*shoot("sim", *HELPS), *shoot("sim-mitsuba", "----....", "++++....")]
    (found,) = compare_renderers(seen)
    assert [row.outcomes.n for row in found.gains] == [4, 4]
    assert [row.outcomes.n for row in compare_predictions("resnet18", seen).pairs if row.source == "sim"][:1] == [8]


def test_two_versions_of_one_renderer_are_told_apart():
    older = [
        replace(one, capture=replace(one.capture, source="old"))
        for one in shoot(
            "sim", *HELPS, settings=OTHERS["sim-mitsuba"] | {"renderer_version": "mitsuba 3.8.0 scalar_rgb"}
        )
    ]
    (found,) = compare_renderers([*older, *shoot("sim-mitsuba", *HELPS)])
    assert found.names == {"old": "mitsuba 3.8.0 scalar_rgb", "sim-mitsuba": MITSUBA}


def test_two_plans_of_one_renderer_are_each_compared_with_the_other():
    shelf = [replace(one, capture=replace(one.capture, source="shelf")) for one in shoot("sim", *HELPS)]
    found = compare_renderers([*shoot("sim", *HELPS), *shelf, *shoot("sim-mitsuba", *HELPS)])
    assert [one.sources for one in found] == [("shelf", "sim-mitsuba"), ("sim", "sim-mitsuba")]


def test_colours_are_those_of_the_objects_pixels(tmp_path, make_crate_space, monkeypatch):
    """A grey beside a lighter one: by the standard it is the difference of L* by S_L at their mean, 55.1."""
    from PIL import Image

    from toolkit.captures.truth import ObjectMask

    mask = np.zeros((8, 8), bool)
    mask[2:6, 2:6] = True
    monkeypatch.setattr(
        "toolkit.evaluation.agreement.outline_captures",
        lambda shown, _: ({one.path: ObjectMask(mask, (2, 2, 6, 6)) for one in shown}, []),
    )
    seen = []
    # sRGB 119 has L* 50.03, and 145 has 60.17, by the formulas of sRGB and CIE 15 on a pocket calculator
    for source, code in (("sim", 119), ("sim-mitsuba", 145)):
        for one in shoot(source, "++", "++"):
            file = tmp_path / one.capture.path
            file.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(
                np.where(mask[..., None], code, 7 if source == "sim" else 200).astype(np.uint8).repeat(3, 2)
            ).save(file)
            seen.append(replace(one, capture=replace(one.capture, file=file)))
    (found,) = compare_renderers(seen)
    colour = add_colours(found, make_crate_space(tmp_path / "space")).pairs[0].colour
    expected = 10.14 / (1 + 0.015 * 5.1**2 / np.sqrt(20 + 5.1**2))
    assert colour.n == 2 and colour.median == colour.p90 == pytest.approx(expected, rel=0.01)
    assert colour.lighter == pytest.approx(10.14, abs=0.02)
    (line,) = list_colours(add_colours(found, make_crate_space(tmp_path / "again")))
    assert line.startswith("mitsuba against raycast, colour of the object's pixels in 2 pairs of images: median ΔE00 9")


def test_a_run_writes_it_to_terminal_summary_and_report(workspace, put, colour_classifier):
    for source, settings in (("sim", RAYS), ("sim-mitsuba", OTHERS["sim-mitsuba"])):
        lines = []
        for variant, label in (("unpatched", "eggnog"), ("patched", "racer")):
            for i in range(1, 7):
                file = put(f"{source}/racer/{variant}/pose_{i:02d}.png", label)
                made = settings | {"studio": "oak/studio/0-1", "seed": 0}
                path = f"racer/{variant}/{file.name}"
                booster = "f" * 64 if variant == "patched" else None
                lines.append(
                    {"path": path, "object": "racer", "variant": variant, "pose_id": i, "made": made}
                    | {"booster_sha256": booster}
                )
        manifest = workspace.captures_dir / source / "manifest.jsonl"
        manifest.write_text("".join(json.dumps(line) + "\n" for line in lines))
    result = evaluate_captures(workspace.captures_dir, workspace, colour_classifier)
    summary = json.loads((result.run_dir / "summary.json").read_text())
    (entry,) = summary["renderers"]
    assert entry["renderers"] == ["raycast", MITSUBA] and [row["gained"] for row in entry["gains"]] == [6, 6]
    assert entry["pairs"][0]["colour"] is None and entry["flips"] == []
    assert {one["source"]: one["renderers"] for one in summary["rests_on"]["sources"]} == {
        "sim": ["raycast"], "sim-mitsuba": [MITSUBA],
    }  # fmt: skip
    page = result.report_file.read_text()
    assert 'id="renderers"' in page and "The gain of the patch holds in both renderers" in page
    out = io.StringIO()
    print_agreement(Console(file=out, width=200), result.renderers)
    assert MITSUBA in out.getvalue() and "predictions agree" in out.getvalue()
