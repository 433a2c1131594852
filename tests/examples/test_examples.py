"""Each example runs as a reader would run it, writes what it says, and is short."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("0*.py"))


def run_example(file: Path, folder: Path) -> list[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TOOLKIT_WEIGHTS": "", "HTTPS_PROXY": "http://127.0.0.1:9"}
    done = subprocess.run(
        [sys.executable, str(file), "out"], capture_output=True, text=True, check=False, cwd=folder, env=environment
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
    return done.stdout.splitlines()


def test_there_are_seven():
    assert [file.name[:3] for file in EXAMPLES] == [f"0{k}_" for k in range(1, 8)]


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_it_is_short_and_goes_through_the_front_door(file):
    text = file.read_text()
    assert len(text.splitlines()) < 60
    assert "import toolkit as tk" in text and "sys.argv[1]" in text
    deep = re.findall(r"^(?:from|import) (toolkit\.\S+)", text, re.MULTILINE)
    assert len(deep) <= 1, f"past the front door: {deep}"


@pytest.mark.slow
@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_it_runs_and_makes_what_it_says(file, tmp_path):
    said = run_example(file, tmp_path)
    assert said[-1].startswith("next: ") or "; next: " in said[-1]
    made = next(line for line in reversed(said) if line.startswith("made ")).split("; next: ")[0]
    paths = re.findall(r"\S+\.(?:png|pdf|glb|csv|html|json)\b", made)
    assert paths
    for path in paths:
        found = list(tmp_path.rglob(Path(path).name))
        assert found and found[0].stat().st_size > 50, path
    assert [path.name for path in tmp_path.iterdir()] == ["out"], "an example writes into its folder alone"


def read_shares(lines: list[str], pattern: str) -> list[float]:
    return [float(share) for line in lines for share in re.findall(pattern, line)]


@pytest.mark.slow
def test_the_patch_of_the_road_helps(tmp_path):
    """The reader is told that 30 steps are enough to see that it works."""
    file = next(file for file in EXAMPLES if file.stem == "01_road")
    said = run_example(file, tmp_path)
    patched, unpatched = (
        read_shares([line for line in said if line.startswith(name)], r"\b\d\.\d+")[0] for name in ("patched", "unpatched")
    )
    assert patched >= unpatched + 0.1
