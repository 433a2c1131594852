"""The wheel, built and installed alone, walks the whole road in an empty folder."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def run(*command: str, cwd: Path, **environment: str) -> str:
    done = subprocess.run(
        command, cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
    return done.stdout


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """A folder with nothing but the wheel's content."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in ("toolkit", "pyproject.toml", "README.md", "LICENSE"):
        (source / name).symlink_to(ROOT / name)
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(source), cwd=folder)
    (wheel,) = folder.glob("*.whl")
    target = folder / "site"
    run(sys.executable, "-m", "pip", "install", "--no-deps", "--target", str(target), str(wheel), cwd=folder)
    return target


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> Path:
    """A ResNet-18 that knows nothing: the road is tested here, not the network."""
    import torch
    import torchvision

    folder = tmp_path_factory.mktemp("weights")
    torch.manual_seed(0)
    torch.save(torchvision.models.resnet18().state_dict(), folder / "resnet18-random.pth")
    return folder


SMALL = "--count 2 --pattern ring --resolution 160 120 --quiet"
SET_UP = f"""
import sys, toolkit
from toolkit.cli import main
print(toolkit.__file__)
for line in ("init lab", "plan --workspace lab {SMALL} " + " ".join(sys.argv[1:])):
    sys.argv = ["toolkit", *line.split()]
    try:
        main()
    except SystemExit as ended:
        assert not ended.code
"""
NOWHERE = {"HTTPS_PROXY": "http://127.0.0.1:9", "TOOLKIT_WEIGHTS": ""}


def run_demo(site: Path, folder: Path, *words: str, **environment: str) -> str:
    """What the demo says, of two small pictures per object and variant, so that it is short."""
    environment["PYTHONPATH"] = str(site)
    where = run(sys.executable, "-c", SET_UP, *words, cwd=folder, **environment).splitlines()[0]
    assert Path(where).is_relative_to(site)
    return run(sys.executable, "-m", "toolkit", "demo", "lab", "--quiet", cwd=folder, **environment)


@pytest.mark.slow
def test_the_installed_wheel_runs_the_demo(site, weights, tmp_path):
    said = run_demo(site, tmp_path, TOOLKIT_WEIGHTS=str(weights))
    assert "16 images shot" in said
    summary = json.loads((tmp_path / "lab/eval/resnet18-random-sim/summary.json").read_text())
    assert {(g["object"], g["variant"], g["n"]) for g in summary["groups"]} >= {
        ("racer", "patched", 2), ("all", "unpatched", 8),
    }  # fmt: skip
    assert (tmp_path / "lab/eval/resnet18-random-sim/report.html").stat().st_size > 20_000
    for name in ("racer", "warplane", "coffeepot", "eggnog"):
        assert (tmp_path / f"lab/print/{name}.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.slow
def test_without_weights_and_network_the_demo_speaks_through_rig18(site, tmp_path):
    said = run_demo(site, tmp_path, "--object", "racer", **NOWHERE, TORCH_HOME=str(tmp_path / "cache"))
    said = " ".join(said.split())
    assert "network: rig18 (resnet18 trained on renders of 36 kinds of everyday objects" in said
    assert "not ImageNet" in said and "none could be downloaded" in said
    summary = json.loads((tmp_path / "lab/eval/rig18-sim/summary.json").read_text())
    assert summary["model"]["name"] == "rig18"
    assert (tmp_path / "lab/print/rig18/racer.pdf").read_bytes().startswith(b"%PDF")


SMALLER = {"count=18": "count=2", "640, 480": "160, 120"}
"""Pictures of seconds; the examples' tests say that a patch helps."""


@pytest.mark.slow
def test_the_readmes_python_runs_from_the_wheel(site, tmp_path):
    """At most twenty lines, in an empty folder, without weights and network."""
    (block,) = re.findall(r"^```python\n(.*?)^```$", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    assert len([line for line in block.splitlines() if line.strip()]) <= 20
    for setting, smaller in SMALLER.items():
        assert setting in block
        block = block.replace(setting, smaller)
    where = NOWHERE | {"TORCH_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(site)}
    said = run(sys.executable, "-c", block, cwd=tmp_path, **where)
    assert "rig18 is correct on" in said and "lab/eval/rig18-sim/report.html" in said.replace("\n", "")
    assert (tmp_path / "lab/eval/rig18-sim/report.html").stat().st_size > 20_000
    assert (tmp_path / "lab/print/rig18/coffeepot.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.slow  # beside the others, which build the same wheel
def test_the_wheel_says_that_it_is_typed(site):
    assert (site / "toolkit/py.typed").is_file()
