"""Patches of many classes on the engines: the same bytes, a bad one alone, and a stopped one that goes on."""

from dataclasses import replace

import pytest
from hue_network import BlindToGreen, make_hue_classifier, write_photos

from toolkit.boosters.patch import PatchTask
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.engine import EngineConfig
from toolkit.rooms.benchmarks.patch_sets import class_patches
from toolkit.training.processes import Processes

POOL = EngineConfig(workers=2)
pytestmark = pytest.mark.usefixtures("forked_workers")


@pytest.mark.slow
def test_workers_write_the_same_bytes_and_nothing_twice(train):
    patches, skipped, files = train("here")
    assert len(files) == 9 and not skipped
    for name, engine in (("one", EngineConfig(workers=1)), ("two", POOL)):
        assert train(name, engine) == (patches, [], files)
    again, _, same = train("two", POOL)
    assert same == files and [(one.label, one.patched) for one in again] == [
        ("red", None), ("green", None), ("blue", None),
    ]  # fmt: skip


@pytest.mark.parametrize("engine", [None, pytest.param(POOL, marks=pytest.mark.slow)])
def test_a_patch_that_cannot_be_trained_is_listed_and_the_others_are_there(train, engine):
    blind = replace(make_hue_classifier(), module=BlindToGreen().eval())
    patches, ((name, reason),), files = train("blind", engine, blind)
    assert [one.label for one in patches] == ["red", "blue"] and "green.png" not in files
    assert name == "hues-16/green" and "at step 1 is not a finite number" in reason and "\n" not in reason
    with pytest.raises(ToolkitError, match="not a finite number"):
        train("only", engine, blind, classes=(1,))


@pytest.mark.slow
def test_a_half_trained_patch_goes_on_in_a_worker(train, tmp_path, monkeypatch):
    """That the worker has read the checkpoint is seen where it is damaged."""
    _, _, files = train("whole")
    steps = []

    def stop(task, step, real=PatchTask.loss):
        steps.append(step)
        if len(steps) == 9:
            raise KeyboardInterrupt
        return real(task, step)

    with monkeypatch.context() as patch:
        patch.setattr(PatchTask, "loss", stop)
        with pytest.raises(KeyboardInterrupt):
            train("stopped")
    (half,) = (tmp_path / "stopped").glob("print/patches/hues-16/.training/green/*.safetensors")
    content = half.read_bytes()
    half.write_bytes(content[:-1])
    patches, ((name, reason),), _ = train("stopped", POOL)
    assert [one.label for one in patches] == ["red", "blue"] and name == "hues-16/green" and "is damaged" in reason
    half.write_bytes(content)
    patches, skipped, found = train("stopped", POOL)
    assert (found, skipped) == (files, []) and [one.patched is None for one in patches] == [True, False, True]


@pytest.mark.slow
def test_begun_anew_all_are_trained_again(train):
    train("space")
    patches, _, _ = train("space", POOL, restart=True)
    assert all(one.patched is not None for one in patches)


@pytest.mark.slow
def test_a_machine_without_the_disk_sends_the_files(train, monkeypatch):
    """As a unit on Ray does, here without Ray."""
    _, _, files = train("here")
    monkeypatch.setattr(
        class_patches, "train_unit",
        lambda *inputs, real=class_patches.train_unit: real(*inputs[:-1], False),
    )  # fmt: skip
    patches, _, sent = train("sent")
    assert sent == files and all(one.patched is not None for one in patches)


def test_processes_of_torchrun_take_no_workers(train, monkeypatch):
    monkeypatch.setattr(class_patches, "current", lambda: Processes(0, 2))
    with pytest.raises(FieldError, match="engine and workers share patches, torchrun shares each patch: choose either"):
        train("both", POOL)


@pytest.mark.slow
def test_the_command_takes_workers_and_lists_what_failed(tmp_path, monkeypatch):
    from typer.testing import CliRunner

    from toolkit.cli import app
    from toolkit.core.workspace import make_workspace

    space, data = make_workspace(tmp_path / "space"), write_photos(tmp_path / "data")
    blind = replace(make_hue_classifier(), module=BlindToGreen().eval())
    monkeypatch.setattr("toolkit.models.load.load_classifier", lambda *args, **kwargs: blind)
    words = ["train-patches", "--data", data, "--size-px", "16", "--steps", "2", "--workspace", space.root]
    done = CliRunner().invoke(app, [*map(str, words), "--workers", "2"])
    assert done.exit_code == 1 and "skipped patches-16/green: the loss" in done.stderr.replace("\n", " "), done.output
    assert "3 classes, 2 patches in" in done.stdout.replace("\n", " ")
