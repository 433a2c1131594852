"""Every command that works for long, killed at one write after the other and run again: the bytes of a whole run."""

import json
import os
import shutil
import sys
from subprocess import PIPE, Popen

import cv2
import numpy as np
import pytest
from colour_folder import write_colours
from hostile_checks import count
from killed_runs import be_nobody_special, end_in_spite_of_kills, fill_the_disk, read_folder, run
from PIL import Image

torch = pytest.importorskip("torch")

from safetensors.torch import save_file  # noqa: E402

from toolkit.models.architectures import build_network  # noqa: E402

COMMANDS = {
    "plan": "plan --object crate",
    "print": "print --class crate",
    "capture-sim": "capture-sim --object crate --source new",
    "corrupt": "corrupt photos out --corrupt fog:1-3",
    "eval": "eval captures/sim --model own",
    "wrap": "wrap --object crate --views 8 --pieces 3 --texel-mm 2",
    "retexture": "retexture photos --found old.png --as new.png --object desk",
    "refine-network": "refine-network new --model own --data colours --steps 3 --batch 6",
    "train-classifier": "train-classifier --name new --data colours --arch cifar_resnet8 --epochs 1 --image-px 16",
    "landing collect": "landing collect --frames 4 --places 2 --time overcast --image-px 48 --weather clear",
    "landing fly": "landing fly apriltag --pad apriltag --places 1 --ground bare --time overcast --weather clear "
                   "--weather fog:3 --episodes 2 --batch 1 --start-height-m 2.2 2.6 --time-limit-s 0.5 --size-m 1",
}  # fmt: skip
KILLS = {"plan": 2, "print": 2, "capture-sim": 15, "corrupt": 25, "eval": 5, "wrap": 6, "retexture": 30,
         "refine-network": 6, "train-classifier": 6, "landing collect": 5, "landing fly": 6}  # fmt: skip
"""How often each is killed with FUZZ, 108 times in all; more often where a run is cheap, and has many writes."""
MOST_KILLS = 30 if "FUZZ" in os.environ else 4
ANEW = ("print",)
"""Starts quickly, and is killed in processes that are started anew; the others in forked ones."""
SERVE = """
import json, os, sys
answers, sys.stdout = sys.stdout, sys.stderr
from toolkit.cli import main
for line in sys.stdin:
    folder, *words = json.loads(line)
    os.chdir(folder)
    sys.argv = ["toolkit", *words]
    try:
        main()
    except SystemExit as ended:
        print(ended.code or 0, file=answers, flush=True)
"""


def photograph(pixels: np.ndarray) -> np.ndarray:
    """(480, 640, 3) uint8: a patch on a grey table, a little aslant."""
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32) * 960
    corners = np.array([[150, 110], [385, 128], [372, 366], [140, 340]], np.float32)
    H, big = cv2.getPerspectiveTransform(square, corners), cv2.resize(pixels, (960, 960), interpolation=cv2.INTER_AREA)
    drawn = cv2.warpPerspective(big, H, (640, 480), borderValue=(90, 90, 90)).astype(float)
    return np.clip(cv2.GaussianBlur(drawn, (0, 0), 0.7), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def furnished(make_crate_space, tmp_path_factory):
    """A workspace with an object, rendered images of it, photographs of a patch, pictures of colours and a network."""
    space = make_crate_space(tmp_path_factory.mktemp("kills") / "space")
    write_colours(space.root / "colours", 5)
    for seed, name in enumerate(("old", "new")):
        rng = np.random.default_rng(seed)
        pixels = rng.integers(0, 2, (24, 24, 3)) * 255 + 2 * rng.integers(0, 256, (6, 6, 3)).repeat(4, 0).repeat(4, 1)
        Image.fromarray((pixels // 3).astype(np.uint8)).save(space.root / f"{name}.png")
    (space.root / "photos").mkdir()
    old = np.asarray(Image.open(space.root / "old.png"))
    for k in range(2):
        Image.fromarray(photograph(old)[:, 20 * k :]).save(space.root / "photos" / f"{k}.jpg", quality=92)
    torch.manual_seed(3)
    space.classifiers_dir.mkdir(parents=True, exist_ok=True)
    save_file(build_network("cifar_resnet8", 4).state_dict(), space.classifiers_dir / "own.safetensors")
    about = {"arch": "cifar_resnet8", "labels": ["red", "green", "blue", "crate"], "size": 16, "name": "own"}
    (space.classifiers_dir / "own.json").write_text(json.dumps(about))
    done = run(["capture-sim", "--object", "crate"], space.root)
    assert done.returncode == 0, done.stderr
    return space.root


@pytest.fixture(scope="module")
def run_whole(tmp_path_factory):
    """A function (words, folder) that runs `toolkit WORDS` to its end, in a process that was started anew.

    Processes that are forked have one order of sets; this one has another.
    """
    said = tmp_path_factory.mktemp("whole") / "said.txt"
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", SERVE]
    with said.open("wb") as err, Popen(command, stdin=PIPE, stdout=PIPE, stderr=err, env=environment) as server:

        def ask(words, folder):
            server.stdin.write(json.dumps([str(folder), *words]).encode() + b"\n")
            server.stdin.flush()
            assert server.stdout.readline() == b"0\n", said.read_text()[-2000:]

        yield ask
        server.stdin.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_killed_command_ends_with_the_bytes_of_a_whole_run(furnished, run_whole, name, tmp_path):
    # both in turn at one place: some results name files by their whole path
    space, kept = tmp_path / "space", tmp_path / "kept"
    shutil.copytree(furnished, space)
    run_whole(COMMANDS[name].split(), space)
    space.rename(kept)
    shutil.copytree(furnished, space)
    kills = min(KILLS[name], MOST_KILLS)
    assert end_in_spite_of_kills(COMMANDS[name].split(), space, kills, is_forked=name not in ANEW) == kills
    count("kills", kills)
    expected, found = read_folder(kept), read_folder(space)
    assert sorted(found) == sorted(expected)
    assert [one for one in expected if found[one] != expected[one]] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["print", "capture-sim", "corrupt", "eval", "wrap", "retexture"])
def test_a_full_disk_and_a_folder_that_may_not_be_written_are_a_line(furnished, name, tmp_path):
    space = tmp_path / "space"
    shutil.copytree(furnished, space)
    before = read_folder(space)
    folders = [space, *(one for one in space.rglob("*") if one.is_dir())]
    for one in folders:
        one.chmod(0o555)
    refused = run(COMMANDS[name].split(), space, begin=be_nobody_special)
    assert read_folder(space) == before
    for one in folders:
        one.chmod(0o755)
    full = run(COMMANDS[name].split(), space, begin=fill_the_disk)
    for done, words in ((refused, "permission denied"), (full, "larger than this disk or account allows")):
        said = done.stderr.decode()
        assert done.returncode in (1, 2) and words in said and "Traceback" not in said, said[-2000:]
    left = read_folder(space)
    assert {file: left[file] for file in before} == before and not any("partial" in file for file in left)
    again = run(COMMANDS[name].split(), space)
    assert again.returncode == 0, again.stderr.decode()[-2000:]
