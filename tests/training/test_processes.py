"""Two processes of torchrun have the gradients of one, to rounding; the first alone speaks and writes."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shared_training
import torch
from colour_folder import write_colours
from forked import TOOLKIT, run_two
from tiny_network import write_photos
from tiny_regressor import CONFIG, Regressor

from toolkit import __version__, cli
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.training import classifier_task, processes
from toolkit.training.loop import fit
from toolkit.training.processes import Processes, joined

HELPERS = Path(__file__).parents[1] / "helpers"


def torchrun(*command, cwd=None) -> subprocess.CompletedProcess:
    path = os.pathsep.join([str(HELPERS), str(HELPERS.parents[1]), os.environ.get("PYTHONPATH", "")])
    start = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    return subprocess.run(
        [*start, *map(str, command)], env=os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
        capture_output=True, text=True, timeout=900, cwd=cwd, check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def colours(tmp_path_factory):
    return write_colours(tmp_path_factory.mktemp("images") / "colours", 36)


PATCHED = {
    shared_training.PatchTask: ["adjust_gradients"],
    shared_training.TextureTask: ["adjust_gradients"],
    shared_training.ClassifierTask: ["adjust_gradients", "_draw_batch", "finish"],
    classifier_task: ["choose_precision", "start_network"],
}


@pytest.mark.slow
def test_two_processes_have_the_gradients_of_one(make_crate_space, colours, tmp_path, monkeypatch):
    """Of a patch before two networks, a texture, a classifier with batch normalisation and a robust one, every step."""
    for owner, names in PATCHED.items():
        for name in names:
            monkeypatch.setattr(owner, name, getattr(owner, name))  # put back afterwards
    photos = write_photos(tmp_path / "photos", 10)
    spaces = [make_crate_space(tmp_path / name) for name in ("one", "two")]
    program = (HELPERS / "shared_training.py").read_text()
    both = run_two(program, spaces[1].root, colours, photos, tmp_path / "found")
    assert [one.returncode for one in both] == [0, 0], [one.stderr.decode() for one in both]
    assert [one.stdout for one in both] == [b"process 0 is done\n", b""], "the others say nothing"
    alone = shared_training.train_all(spaces[0], colours, photos)
    with np.load(tmp_path / "found-0.npz") as stored:
        shared = dict(stored)
    assert alone.keys() == shared.keys()
    kinds = ("patch", "texture", "classifier", shared_training.ROBUST)
    for step in (f"{kind} {k} " for kind in kinds for k in range(shared_training.STEPS)):
        names = [name for name in alone if name.startswith(step)]
        largest = max(np.abs(alone[name]).max() for name in names)
        assert largest > 1e-4
        for name in names:
            assert np.abs(shared[name] - alone[name]).max() <= 1e-5 * largest, name


@pytest.mark.slow
def test_the_command_speaks_and_writes_once(colours, tmp_path):
    """Started by torchrun where it trains; before and after by us."""
    space = make_workspace(tmp_path / "space")
    command = ["train-classifier", "--data", colours, "--name", "own", "--arch", "shufflenet_v2_x0_5"]
    command += ["--image-px", "32", "--epochs", "1", "--device", "cpu", "--workspace", space.root]
    refused = run_two(TOOLKIT, *command, "--batch", "15")
    errors = [line for one in refused for line in one.stderr.decode().splitlines() if line.startswith("error:")]
    assert refused[0].returncode and errors == [
        "error: --batch 15: expected a multiple of 2, the processes that share it"
    ]
    done = torchrun("-m", "toolkit", *command, "--batch", "16")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("own.safetensors: shufflenet_v2_x0_5, 3 classes") == 1
    assert done.stderr.count("to train on") == 1
    assert sorted(file.name for file in space.classifiers_dir.iterdir()) == ["own.json", "own.safetensors"]
    again = run_two(TOOLKIT, *command, "--batch", "16")
    assert [one.returncode for one in again] == [0, 0]
    assert b"nothing to do" in again[0].stdout and not again[1].stdout


@pytest.mark.parametrize(("rank", "printed"), [("0", __version__), ("1", "")])
def test_another_command_is_run_by_the_first_process_alone(rank, printed, monkeypatch, capsys):
    for name, value in {"TORCHELASTIC_RUN_ID": "x", "WORLD_SIZE": "2", "RANK": rank}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("sys.argv", ["toolkit", "--version"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    assert capsys.readouterr().out.removeprefix("toolkit ").strip() == printed


def test_parts_make_up_the_batch():
    parts = [Processes(rank, 3).share(np.arange(12)) for rank in range(3)]
    assert np.array_equal(np.concatenate(parts), np.arange(12)) and {len(one) for one in parts} == {4}


@pytest.mark.parametrize(("batch", "count"), [(16, 3), (2, 4)])
def test_a_batch_that_cannot_be_divided_is_refused(batch, count):
    with pytest.raises(FieldError, match=f"batch {batch}: expected a multiple of {count}, the processes that share it"):
        Processes(0, count).check(batch, torch.device("cpu"))


def test_more_processes_than_gpus_are_refused(monkeypatch):
    monkeypatch.setenv("LOCAL_WORLD_SIZE", "2")
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    with pytest.raises(FieldError, match="device cuda: 2 processes on a machine with 1 GPU: start as many as it has"):
        Processes(0, 2).check(16, torch.device("cuda"))


def test_a_training_that_cannot_be_shared_is_refused(monkeypatch):
    monkeypatch.setattr(processes, "_current", Processes(0, 2))
    with pytest.raises(ToolkitError, match="cannot be shared by processes: start it without torchrun"):
        fit(Regressor(), CONFIG)


@pytest.mark.parametrize(
    ("rank", "agent", "words"),
    [
        ("1", "True", "timed out"),
        ("0", "False", "1/2 clients joined"),
    ],
)
def test_processes_that_do_not_meet_say_so(rank, agent, words, monkeypatch):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    names = {"RANK": rank, "WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}
    for name, value in {**names, "TORCHELASTIC_RUN_ID": "x", "TORCHELASTIC_USE_AGENT_STORE": agent}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(processes, "MEETING_S", 1)
    with pytest.raises(ToolkitError, match=f"the processes cannot connect at 127.0.0.1:{port} .*{words}"), joined():
        pass
