"""From request to files, through kills."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from killed_runs import files_below, stopped_at, train_killed
from PIL import Image
from tiny_network import tiny_classifier, tiny_config, train_tiny, write_photos

from toolkit.boosters.patch import PatchTask
from toolkit.core.console import quietly
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.records import read_patch

KILLED = """
import sys
from pathlib import Path
from dying import die, die_at_checkpoint
import toolkit.objects.records as records
from tiny_network import train_tiny

if sys.argv[1] == "checkpoint":
    die_at_checkpoint(6)
else:
    records.write_json = die  # between the patch's picture and its record
train_tiny(Path(sys.argv[2]), Path(sys.argv[3]), checkpoint_every_s=0)
"""


@pytest.fixture
def photos(tmp_path):
    return write_photos(tmp_path / "photos", 10)


def run(folder: Path, photos: Path, **changes):
    names = ("restart", "out", "name", "class_name", "checkpoint_every_s")
    options = {key: changes.pop(key) for key in names if key in changes}
    with quietly():
        return train_tiny(folder, photos, tiny_config(**changes), **options)


def test_patch_record_and_preview_are_written_and_nothing_else_is_left(tmp_path, photos):
    made = run(tmp_path / "w", photos)
    assert files_below(tmp_path / "w") == ["print/patches/jet.json", "print/patches/jet.png", "print/previews/jet.png"]
    assert not (tmp_path / "w/print/patches/.training").exists()
    record = read_patch(made.files.png).record
    assert (record.class_name, record.class_index, record.n_px) == ("jet", 3, 16)
    assert record.networks[0].sha256 == "ab" * 32
    assert record.settings["steps"] == 12
    assert record.settings["affine"]["share"] == [0.2, 0.42]
    assert record.data["train"] == 8
    assert record.data["held_out"] == 2
    assert record.final["loss"] > 0
    assert record.final["tiny_held_out_patched_n"] == 128
    assert record.final["tiny_held_out_bare_n"] == 2
    own = [file for file in Workspace(tmp_path / "w").patches().values() if file.is_relative_to(tmp_path)]
    assert [file.stem for file in own] == ["jet"], "a preview is no patch"
    with Image.open(made.files.preview) as picture:
        assert picture.width > 900


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(tmp_path, photos):
    first, again = (run(tmp_path / name, photos) for name in ("a", "b"))
    other = run(tmp_path / "c", photos, seed=1)
    assert first.files.png.read_bytes() == again.files.png.read_bytes()
    assert first.files.preview.read_bytes() == again.files.preview.read_bytes()
    assert first.patch.record.final == again.patch.record.final
    assert not np.array_equal(first.patch.pixels, other.patch.pixels)


@pytest.mark.slow
@pytest.mark.parametrize("when", ["checkpoint", "record"])
def test_kill_9_then_the_same_command_ends_as_if_never_killed(tmp_path, photos, when, capsys, one_thread):
    train_killed(KILLED, when, tmp_path / "killed", photos)
    left = files_below(tmp_path / "killed")
    assert any(name.endswith(".partial") for name in left) == (when == "checkpoint")
    resumed = train_tiny(tmp_path / "killed", photos)
    told = capsys.readouterr().err
    whole = run(tmp_path / "whole", photos)
    assert resumed.resumed_from == (5 if when == "checkpoint" else 12)
    assert f"going on after step {resumed.resumed_from} of 12; restart begins again" in told
    assert resumed.files.png.read_bytes() == whole.files.png.read_bytes()
    assert resumed.patch.record == whole.patch.record
    assert files_below(tmp_path / "killed") == files_below(tmp_path / "whole"), "nothing lost, nothing twice"


def test_ctrl_c_keeps_what_is_done(tmp_path, photos):
    with stopped_at(PatchTask, 3):
        run(tmp_path / "w", photos)
    assert run(tmp_path / "w", photos).resumed_from == 3


def test_a_finished_patch_is_not_trained_again_unless_asked(tmp_path, photos, monkeypatch):
    first = run(tmp_path / "w", photos)
    stamp = first.files.png.stat().st_mtime_ns
    monkeypatch.setattr(PatchTask, "loss", lambda *arguments: pytest.fail("trained again"))
    again = run(tmp_path / "w", photos)
    assert again.was_finished
    assert again.files.png.stat().st_mtime_ns == stamp
    monkeypatch.undo()
    assert not run(tmp_path / "w", photos, restart=True).was_finished


def test_a_changed_picture_is_trained_again(tmp_path, photos):
    made = run(tmp_path / "w", photos)
    made.files.png.write_bytes(made.files.preview.read_bytes())
    assert np.array_equal(run(tmp_path / "w", photos).patch.pixels, made.patch.pixels)


def stop_half_way(folder: Path, photos: Path, monkeypatch, **changes) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(PatchTask, "finish", lambda *arguments: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            run(folder, photos, **changes)


@pytest.mark.slow
def test_another_request_does_not_mix_with_an_old_checkpoint(tmp_path, photos, monkeypatch, capsys):
    stop_half_way(tmp_path / "w", photos, monkeypatch)
    other = train_tiny(tmp_path / "w", photos, tiny_config(lr=0.05))
    assert other.resumed_from == 0
    assert "unfinished run with other inputs" in capsys.readouterr().err
    clean = run(tmp_path / "clean", photos, lr=0.05)
    assert np.array_equal(other.patch.pixels, clean.patch.pixels)
    assert run(tmp_path / "w", photos).resumed_from == 12, "the first is still there to go on with"


def test_changed_images_begin_anew(tmp_path, photos, monkeypatch):
    stop_half_way(tmp_path / "w", photos, monkeypatch)
    write_photos(photos, 1, seed=99)
    assert run(tmp_path / "w", photos).resumed_from == 0


def test_a_damaged_checkpoint_is_one_clear_line_and_restart_begins_anew(tmp_path, photos, monkeypatch):
    stop_half_way(tmp_path / "w", photos, monkeypatch)
    file = next((tmp_path / "w/print/patches/.training/jet").glob("*.safetensors"))
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(ToolkitError, match=r"is damaged .*run the same again with restart"):
        run(tmp_path / "w", photos)
    assert run(tmp_path / "w", photos, restart=True).resumed_from == 0


def test_several_networks_are_recorded_and_validated_each(tmp_path, photos):
    second = replace(tiny_classifier(1), labels=["jet", "cat", "dog", "sports car"], arch="tiny")
    made = train_tiny(tmp_path / "w", photos, tiny_config(3), networks=[tiny_classifier(), second])
    assert len(made.patch.record.networks) == len(made.validations) == 2
    assert {"tiny_held_out_patched_top1", "tiny_2_held_out_patched_top1"} <= set(made.patch.record.final)


def test_out_and_name(tmp_path, photos):
    made = run(tmp_path / "w", photos, out=tmp_path / "elsewhere", name="my-jet", steps=2)
    assert files_below(tmp_path / "elsewhere") == ["my-jet.json", "my-jet.png", "previews/my-jet.png"]
    assert made.patch.record.name == "my-jet"
    assert not (tmp_path / "w").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"size_px": 33}, "size_px 33: expected 8 to 32"),
        ({"size_px": 0}, "size_px 0: expected at least 8"),
        ({"class_name": "jett"}, "no class called 'jett': did you mean jet"),
        ({"class_name": "4"}, "out of range"),
        ({"name": "../jet"}, "name '../jet': expected letters"),
    ],
)
def test_a_request_that_cannot_be_met_is_one_clear_line(tmp_path, photos, change, words):
    with pytest.raises(ToolkitError, match=words) as caught:
        run(tmp_path / "w", photos, **change)
    assert "\n" not in str(caught.value)


def test_labels_with_spaces_become_file_names(tmp_path, photos):
    made = run(tmp_path / "w", photos, steps=1, class_name="sports car")
    assert made.files.png.name == "sports_car.png"
    assert made.patch.record.class_name == "sports car"


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_one_clear_line(tmp_path, photos):
    (tmp_path / "w").mkdir(mode=0o500)
    with pytest.raises(ToolkitError, match="permission denied"):
        run(tmp_path / "w", photos)


def test_a_full_disk_is_one_clear_line_and_the_run_goes_on_after(tmp_path, photos, monkeypatch):
    import errno

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(ToolkitError, match="the disk is full"):
            run(tmp_path / "w", photos)
    assert run(tmp_path / "w", photos).patch.record.final["loss"] > 0
