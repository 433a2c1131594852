"""The card of an exported booster: what its record says, and files that make the booster again elsewhere."""

import json
import re

import pytest

from toolkit.core.workspace import make_workspace
from toolkit.objects.load import load_object
from toolkit.rig.applied.kinds import KINDS
from toolkit.rig.variants import export_object, find_booster

FOLDERS = {"patched": "patches_dir", "textured": "textures_dir", "wrapped": "wraps_dir"}


@pytest.mark.parametrize("variant", [kind.variant for kind in KINDS])
def test_the_files_beside_the_card_are_the_booster(variant, tmp_path):
    space = make_workspace(tmp_path / "w")
    item = load_object(space.object_spec("eggnog"))
    (card, mesh), _ = export_object(space, "eggnog", ["glb"], variant, tmp_path / "out", card=True)
    folder = tmp_path / f"out/eggnog-{variant}"
    assert card == folder / "README.md" and mesh == folder / f"eggnog-{variant}.glb"
    text = card.read_text()
    head, body = text.split("---\n", 2)[1:]
    assert "- unadversarial-example" in head.splitlines()
    # every picture that it shows, and every network with its hash
    assert all((folder / name).is_file() for name in re.findall(r"!\[[^]]*\]\(([^)]*)\)", body))
    record = json.loads((folder / ("wrap.json" if variant == "wrapped" else "eggnog.json")).read_text())
    trained = record["booster"] if variant == "wrapped" else record
    assert trained["networks"] and all(one["sha256"] in body for one in trained["networks"])
    share = trained["final"]["resnet18_held_out_patched_top1"]
    assert f"{share:.0%} (" in body and item.shape_sha256 in body and f"--variant {variant}" in body
    assert json.loads(body.split("```json\n")[1].split("```")[0]) == trained["settings"]
    # put where the card says, they are the same booster
    other = make_workspace(tmp_path / "other")
    place = getattr(other, FOLDERS[variant]) / ("eggnog" if variant == "wrapped" else "")
    place.mkdir(parents=True, exist_ok=True)
    for file in folder.iterdir():
        if file.suffix != ".md":
            (place / file.name).write_bytes(file.read_bytes())
    first, second = find_booster(space, item, variant), find_booster(other, item, variant)
    assert first is not None and second is not None and first.sha256 == second.sha256


@pytest.mark.parametrize("variant", ["unpatched", "grey-patch"])
def test_what_is_no_booster_has_no_card(variant, tmp_path, type_toolkit):
    make_workspace(tmp_path)
    words = ("export", "--object", "eggnog", "--variant", variant, "--card", "--workspace", tmp_path)
    code, _, err = type_toolkit(*words)
    assert code == 2 and "has no card: expected" in err and len(err.strip().splitlines()) == 1
    code, _, err = type_toolkit("export", "--card", "--workspace", tmp_path)
    assert code == 2 and "goes with --object" in err
