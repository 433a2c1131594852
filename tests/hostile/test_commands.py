"""Every command with bad words and in bad workspaces: lines and an exit code; nothing outside changes."""

import os
import subprocess
from functools import lru_cache

import pytest
import typer
from hostile_checks import count
from hostile_inputs import NAMES, NUMBERS, OTHER_KINDS, put_in_place
from hostile_space import READERS
from hypothesis import given, settings
from hypothesis import strategies as st

from toolkit.cli import app
from toolkit.cli.app import list_places

IMPORT = ("import", "photos", "--object", "crate", "--variant", "patched", "--match", "name", "--no-ask")
COMMANDS = {
    "plan": ("plan", "--object", "crate"),
    "print": ("print", "--class", "crate"),
    "objects": ("objects",),
    "init": ("init", "new"),
    "add": ("add", "rig/objects/crate.obj", "--class", "crate"),
    "check": ("check",),
    "import": IMPORT,
    "calibrate": ("calibrate", "photos"),
    "print-profile": ("print-profile", "photos", "--class", "crate"),
    "corrupt": ("corrupt", "photos", "out", "--corrupt", "contrast:1"),
    "capture-sim": ("capture-sim", "--object", "crate", "--variant", "unpatched"),
    "eval": ("eval", "captures/sim", "--model", "mine"),
    "baseline": ("baseline", "qr", "--class", "crate"),
    "world preview": ("world", "preview", "nowhere.glb"),
    "world export": ("world", "export", "nowhere.glb"),
    "runs": ("runs", "--all"),
    "verify": ("verify", "one"),
    "compare": ("compare", "one", "other"),
    "report": ("report", "--all"),
    "export": ("export",),
    # with these nothing is trained: a name is wrong whatever else is
    "sweep": ("sweep", "distance", "--object", "nobody"),
    "train-patch": ("train-patch", "--class", "crate", "--model", "nobody"),
    "train-texture": ("train-texture", "--object", "nobody"),
    "train-wrap": ("train-wrap", "--object", "nobody"),
    "world-eval": ("world-eval", "--object", "nobody"),
    "place": ("place", "--object", "nobody"),
    "wrap": ("wrap", "--object", "nobody"),
    "coco": ("coco", "captures/sim"),
    "models": ("models", "--model", "nobody"),
    "transfer": ("transfer", "--object", "nobody", "--model", "mine", "--model", "nobody"),
    "landing collect": ("landing", "collect", "data", "--world", "nowhere.glb"),
    "landing train": ("landing", "train", "nobody"),
    "landing boost": ("landing", "boost", "nobody"),
    "landing fly": ("landing", "fly", "nobody"),
    "train-classifier": ("train-classifier", "--data", "nowhere", "--name", "new"),
    "refine-network": ("refine-network", "new", "--data", "nowhere"),
    "head": ("head", "nobody", "--data", "nowhere", "--name", "new"),
    "zero-shot": ("zero-shot", "new", "--image", "nobody", "--prompts", "nowhere"),
    "train-patches": ("train-patches", "--data", "nowhere"),
    "corrupt-eval": ("corrupt-eval", "--data", "nowhere"),
    "retexture": ("retexture", "photos", "--found", "nobody"),
    "challenge init": ("challenge", "init", "entry"),
    "challenge check": ("challenge", "check", "nobody"),
    "challenge run": ("challenge", "run", "nobody"),
    "challenge board": ("challenge", "board", "nobody"),
}
LEFT_OUT = {
    "studio": "serves until it is stopped",
    "view": "serves until it is stopped",
    "demo": "walks the whole road",
    "landing demo": "walks the whole landing",
    "doctor": "reads nothing",
    "world list": "builds every world anew for each seed",
}
FEWER = settings(max_examples=settings.default.max_examples // 5)
"""Commands are slow: many render, look for boards or corrupt pictures."""
READING = (("plan", "--object", "crate"), ("objects",), ("print", "--class", "crate"), ("check",), IMPORT,
           ("corrupt", "photos", "corrupted", "--corrupt", "fog:1"), ("eval", "captures/real", "--model", "mine"),
           ("capture-sim", "--object", "crate", "--variant", "unpatched"),
           ("plan", "--shot-list", "--object", "crate"))  # fmt: skip


def can_be_typed(word: str) -> bool:
    try:
        return b"\0" not in os.fsencode(word)
    except UnicodeEncodeError:
        return False


PATHS = (
    "photos",
    "captures",
    "captures/sim",
    "rig/plan.json",
    "print/patches/crate.png",
    "nowhere/at/all",
    "pipe",
    "zero",
    "photos/pose_03.png",
)
words = (
    st.sampled_from(NUMBERS).map(lambda number: "9" * 400 if number == 10**400 else str(number))
    | st.integers().map(str) | st.floats().map(str) | st.sampled_from(PATHS)
    | (st.sampled_from(NAMES) | st.text(max_size=20)).filter(can_be_typed)
)  # fmt: skip

paths = words.filter(lambda word: ".." not in word and not word.startswith(("/", "~")))
"""Where a user may say where to write, another folder is no escape: the attack stays at home."""


def test_every_command_is_attacked():
    assert set(COMMANDS) | set(LEFT_OUT) == {name for name, _ in list_places()}


@lru_cache(maxsize=1)
def list_options() -> dict[str, list[tuple[str, int, bool, bool]]]:
    """Options of each command: spelling, how many values, whether it is a switch, whether it takes a path."""
    commands = typer.main.get_command(app).commands
    return {
        name: [
            (one.opts[0], one.nargs, bool(one.is_flag), one.metavar in ("FILE", "FOLDER", "PATH"))
            for one in commands[name].load().params
            if one.opts[0].startswith("-")
        ]
        for name in COMMANDS
    }


@pytest.mark.parametrize("name", COMMANDS)
@FEWER
@given(data=st.data())
def test_bad_words_are_a_line(sandbox, name, data):
    typed = list(COMMANDS[name])
    for _ in range(data.draw(st.integers(1, 2))):
        if data.draw(st.integers(0, 4)) == 0 and len(typed) > 1:
            typed[data.draw(st.integers(1, len(typed) - 1))] = data.draw(paths)
        elif options := list_options()[name]:
            spelling, nargs, is_switch, is_path = data.draw(st.sampled_from(options))
            typed += [spelling, *([] if is_switch else [data.draw(paths if is_path else words) for _ in range(nargs)])]
    sandbox.renew()
    os.mkfifo(sandbox.space_dir / "pipe")
    (sandbox.space_dir / "zero").symlink_to("/dev/zero")
    count("commands")
    sandbox.run(*typed)


@pytest.mark.parametrize("name", [name for name in READERS if name not in ("mesh", "weights")])
@FEWER
@given(data=st.data())
def test_a_bad_file_in_the_workspace_is_a_line(sandbox, name, data):
    file = sandbox.renew() / READERS[name].path
    content = data.draw(READERS[name].contents(file.read_bytes()))
    if data.draw(st.integers(0, 9)):
        file.write_bytes(content)
    else:
        put_in_place(file, data.draw(st.sampled_from(OTHER_KINDS)))
    count("workspaces")
    sandbox.run(*data.draw(st.sampled_from(READING)))


DEEP = (
    ("import", "deep", "--object", "crate", "--variant", "patched", "--match", "name", "--no-ask"),
    ("calibrate", "deep"), ("corrupt", "deep", "out", "--corrupt", "fog:1"), ("eval", "deep", "--model", "mine"),
    ("coco", "deep"),
    ("print-profile", "deep", "--class", "crate"), ("train-classifier", "--data", "deep", "--name", "new"), ("runs",),
    ("report", "--all"),
)  # fmt: skip


@pytest.mark.parametrize("words", DEEP, ids=" ".join)
def test_folders_in_folders_in_folders_are_walked(sandbox, words):
    """Python's own walk calls itself for each level, and ends at a thousand."""
    place = sandbox.renew() / ("deep" if "deep" in words else "eval")
    place.mkdir(exist_ok=True)
    top = os.open(place, os.O_RDONLY)
    for _ in range(1200):  # a walk's work grows with the square
        os.mkdir("d", dir_fd=top)
        below = os.open("d", os.O_RDONLY, dir_fd=top)
        os.close(top)
        top = below
    os.close(top)
    count("deep folders")
    try:
        sandbox.run(*words)
    finally:
        subprocess.run(["rm", "-r", place], check=True)  # `rmtree` is no walk without end either


SAID = {
    ("plan", "--object", "crate", "--resolution", "0", "0"): "a resolution of 0×0 px",
    ("plan", "--object", "crate", "--resolution", "0", "480"): "a resolution of 0×480 px",
    ("corrupt", "photos", "out", "--corrupt", "contrast:1", "--image-px", "1000000"): "choose 16 to 4096 px",
    ("corrupt", "loop", "out", "--corrupt", "fog:1"): "loop",
    ("import", "loop", "--object", "crate"): "loop",
    ("add", "loop", "--class", "crate"): "loop",
    ("calibrate", "loop"): "loop",
    ("corrupt", "photos", "loop", "--corrupt", "fog:1"): "loop",
    ("plan", "--workspace", "loop"): "loop",
    ("plan", "--object", "x" * 100_000): "no object called",
}


@pytest.mark.parametrize("words", SAID, ids=lambda words: " ".join(words)[:40])
def test_what_cannot_be_is_named(sandbox, words):
    (sandbox.renew() / "loop").symlink_to("loop")
    assert sandbox.run(*words) == 2 and SAID[words] in sandbox.err, sandbox.err
