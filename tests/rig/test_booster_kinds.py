"""A kind of booster in one file of its own: a coloured band is shot, judged, exported and named as the others are."""

import subprocess
import sys
from typing import get_args

from toolkit.cli import options
from toolkit.rig.variants import CONTROLS_OF, KIND_OF, NOUNS, ON_PAPER, VARIANTS
from toolkit.rooms.benchmarks.challenge import VARIANT

BAND = '''
"""A coloured band all round an object, at half of its height."""

from dataclasses import replace

import numpy as np

from toolkit.rig.applied.base import AppliedBooster, BoosterKind
from toolkit.rig.applied.kinds import register


class BandBooster(AppliedBooster):
    """All faces between a third and two thirds of the height, in one colour."""

    def apply(self, item):
        mesh = item.mesh
        heights = mesh.vertices[mesh.faces].mean(1)[:, 2] / mesh.vertices[:, 2].max()
        band = replace(mesh.materials[0], name="band", texture=self.pixels)
        of_face = np.where((heights > 1 / 3) & (heights < 2 / 3), len(mesh.materials), mesh.face_material)
        return replace(mesh, materials=(*mesh.materials, band), face_material=of_face.astype(mesh.face_material.dtype))

    def describe(self, item):
        return {"band": self.sha256}

    def note(self):
        return {"booster": self.name}


def find_band(workspace, item, variant, perfect=False, seed=0):
    code = 128 if variant == "grey-band" else (255, 0, 0)
    return BandBooster(np.full((4, 4, 3), code, np.uint8), "be" * 32, variant)


register(BoosterKind("banded", "band", find_band, ("grey-band",), is_painted=True))
'''
ROAD = """
import band, json, sys
from pathlib import Path
from typer.testing import CliRunner
from toolkit.cli import app

def run(*words):
    done = CliRunner().invoke(app, [*words, "--workspace", sys.argv[1]])
    assert done.exit_code == 0, (words, done.output, done.exception)
    return done.output

variants = [word for name in ("unpatched", "banded", "grey-band") for word in ("--variant", name)]
run("capture-sim", "--backdrop", "white", *variants)
said = run("eval", "--model", "rig18", "--run", "band", "--no-saliency")
assert "the band" in said, said
summary = json.loads((Path(sys.argv[1]) / "eval/band/summary.json").read_text())
assert {one["variant"] for one in summary["groups"]} == {"unpatched", "banded", "grey-band"}
assert {(one["first"], one["second"]) for one in summary["controls"]["comparisons"]} == {("banded", "grey-band")}
assert [one["name"] for one in summary["rests_on"]["sources"][0]["boosters"]] == ["banded", "grey-band"]
run("export", "--object", "crate", "--to", "glb", "--variant", "banded")
"""


def test_a_kind_is_one_file_and_every_command_knows_it(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path / "space")
    spec = space.objects_dir / "crate.toml"
    spec.write_text(spec.read_text().replace('class = "crate"', 'class = "dice"'))
    (tmp_path / "band.py").write_text(BAND)
    (tmp_path / "road.py").write_text(ROAD)
    done = subprocess.run(
        [sys.executable, "road.py", str(space.root)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_lists_follow_from_the_table():
    assert VARIANTS[:4] == ("unpatched", "patched", "textured", "wrapped") and len(set(VARIANTS)) == len(VARIANTS)
    assert {control for controls in CONTROLS_OF.values() for control in controls} == set(VARIANTS[4:])
    assert set(KIND_OF) == set(VARIANTS) - {"unpatched"} and set(ON_PAPER) == {"patched", *CONTROLS_OF["patched"]}


def test_what_loads_without_the_rig_says_the_same_as_the_table():
    """Help starts in a moment: its words are written out, and the challenge's."""
    (text,) = (one.help for one in get_args(options.Variants) if hasattr(one, "help"))
    assert [name for name in VARIANTS if name not in text] == []
    assert {variant: noun for noun, variant in VARIANT.items()} == NOUNS
