"""Each example runs as a reader would run it, writes what it says, and is short."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("0*.py"))


SMALLER = {"STEPS = 20 ": "STEPS = 2 ", "STEPS = 30 ": "STEPS = 2 ", 'pieces="1..4"': 'pieces="1..2"'}
"""Settings of trainings of which nothing is said below but that they end."""


def run_example(file: Path, folder: Path, monkeypatch, capsys) -> list[str]:
    """In this process, which has loaded the libraries and baked the objects' light before."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", [str(file), "out"])
    monkeypatch.delenv("TOOLKIT_WEIGHTS", raising=False)
    monkeypatch.setenv("HTTPS_PROXY", "http://127.0.0.1:9")
    text = file.read_text(encoding="utf-8")
    for setting, smaller in SMALLER.items() if file.stem not in HELPS else ():
        text = text.replace(setting, smaller)
    exec(compile(text, file, "exec"), {"__name__": "__main__"})
    return capsys.readouterr().out.splitlines()


HELPS = {
    "01_road": (r"^patched +(\d\.\d+)", r"^unpatched +(\d\.\d+)"),
    "04_own_training_loop": (r"learned patch: (\d+)%", r"grey patch: (\d+)%"),
    "05_texture": (r"clear views: (\d+)%", r"clear views: .* (\d+)% \(.* in its own paint"),
}
"""What some say of a booster and of the object without: the reader is told that it helps, so it must."""


def test_there_are_eight():
    assert [file.name[:3] for file in EXAMPLES] == [f"0{k}_" for k in range(1, 9)]


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_it_is_short_and_goes_through_the_front_door(file):
    text = file.read_text()
    assert len(text.splitlines()) < 60
    assert "import toolkit as tk" in text and "sys.argv[1]" in text
    deep = re.findall(r"^(?:from|import) (toolkit\.\S+)", text, re.MULTILINE)
    assert len(deep) <= 1, f"past the front door: {deep}"


@pytest.mark.slow
@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_it_runs_and_makes_what_it_says(file, tmp_path, monkeypatch, capsys):
    said = run_example(file, tmp_path, monkeypatch, capsys)
    assert said[-1].startswith("next: ") or "; next: " in said[-1]
    made = next(line for line in reversed(said) if line.startswith("made ")).split("; next: ")[0]
    paths = re.findall(r"\S+\.(?:png|pdf|glb|csv|html|json)\b", made)
    assert paths
    for path in paths:
        found = list(tmp_path.rglob(Path(path).name))
        assert found and found[0].stat().st_size > 50, path
    assert [path.name for path in tmp_path.iterdir()] == ["out"], "an example writes into its folder alone"
    if file.stem in HELPS:
        boosted, without = (float(re.search(words, "\n".join(said), re.MULTILINE)[1]) for words in HELPS[file.stem])
        assert boosted >= without + 0.1 * max(1, boosted)
