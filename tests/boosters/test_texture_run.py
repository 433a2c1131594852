"""From request to files, through kills."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from texture_parts import TEXELS, crate_request, make_crate
from tiny_network import tiny_classifier, write_photos

from toolkit.boosters import texture as texture_run
from toolkit.boosters.patch_steps import Descent
from toolkit.boosters.texture import train_texture
from toolkit.boosters.texture_config import Optimiser
from toolkit.core.errors import ToolkitError
from toolkit.objects.load import load_object, read_mesh
from toolkit.objects.records import read_texture

HELPERS = Path(__file__).parents[1] / "helpers"
KILLED = """
import os, signal, sys
from pathlib import Path
import torch
torch.set_num_threads(1)
import toolkit.boosters.texture as run, toolkit.objects.records as textures
from texture_parts import crate_request
from tiny_network import tiny_classifier
from toolkit.core.workspace import Workspace

when, folder = sys.argv[1], Path(sys.argv[2])
write, count = run.write_checkpoint, 0

def write_then_die(file, checkpoint):
    global count
    count += 1
    if count == 4:
        (file.parent / f".{file.name}.{os.getpid()}.partial").write_bytes(b"half of a checkp")
        os.kill(os.getpid(), signal.SIGKILL)
    write(file, checkpoint)

def die(*arguments):
    os.kill(os.getpid(), signal.SIGKILL)

if when == "checkpoint":
    run.write_checkpoint = write_then_die
else:
    textures.write_json = die  # between the texture's picture and its record
run.train_texture(crate_request(optimiser=sys.argv[3]), [tiny_classifier()], Workspace(folder), workers=0,
                  checkpoint_every_s=0)
"""


@pytest.fixture
def space(tmp_path, make_crate_space):
    return make_crate_space(tmp_path / "w")


def run(space, request=None, said=None, **options):
    say = (lambda line: None) if said is None else said.append
    request = request or crate_request()
    return train_texture(request, [tiny_classifier()], space, quiet=True, say=say, workers=0, **options)


def files_below(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.mark.slow
def test_texture_record_glb_and_turntable_are_written_and_nothing_else_is_left(space):
    made = run(space)
    assert files_below(space.textures_dir) == [
        "crate-crate.uv.npz", "crate.glb", "crate.json", "crate.png", "previews/crate.png",
    ]  # fmt: skip
    record = read_texture(made.files.png).record
    assert (record.name, record.class_name, record.class_index, record.n_px) == ("crate", "jet", 3, TEXELS)
    assert record.settings["gradient"] == "shaded"
    assert record.objects[0].unwrapped
    assert record.final["tiny_held_out_patched_n"] == 4
    mesh = read_mesh(made.files.glb("crate"))
    assert len(mesh.faces) == len(load_object(space.object_spec("crate")).mesh.faces)
    assert made.validations[0].clear.patched.n == 4


@pytest.mark.slow
def test_the_loss_falls(space):
    """A network of random weights sees its class more surely at the end than at the start, on views not trained on."""
    request = crate_request(24, descent=Descent(steps=24, batch=4, lr=0.1))
    made = run(space, request)
    start = crate_request(1, descent=Descent(steps=1, batch=4, lr=1e-6))
    first = run(space, replace(start, name="first"))
    assert made.texture.record.final["loss"] < first.texture.record.final["loss"]


@pytest.mark.slow
@pytest.mark.parametrize("optimiser", ["sign", "sgd", "adam"])
def test_a_killed_and_resumed_run_ends_where_an_uninterrupted_one_does(tmp_path, space, make_crate_space, optimiser):
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        whole = run(space, crate_request(optimiser=optimiser))
        other = make_crate_space(tmp_path / "killed")
        for when in ("checkpoint", "record") if optimiser == "sign" else ("checkpoint",):
            ended = subprocess.run(
                [sys.executable, "-c", KILLED, when, str(other.root), optimiser],
                env=os.environ | {"PYTHONPATH": str(HELPERS)}, capture_output=True,
            )  # fmt: skip
            assert ended.returncode == -signal.SIGKILL, ended.stderr.decode()[-2000:]
        said = []
        resumed = run(other, crate_request(optimiser=optimiser), said)
        assert any("going on after step" in line for line in said)
        assert resumed.resumed_from > 0
        assert np.array_equal(resumed.texture.pixels, whole.texture.pixels)
        assert resumed.texture.record.final == whole.texture.record.final
        assert files_below(other.textures_dir) == files_below(space.textures_dir)
    finally:
        torch.set_num_threads(threads)


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done(space, monkeypatch):
    whole = run(space, crate_request(name="whole"))
    steps, count = texture_run.train_steps, 0

    def interrupted(*arguments, **options):
        nonlocal count
        for step in steps(*arguments, **options):
            count += 1
            if count == 3:
                raise KeyboardInterrupt
            yield step

    monkeypatch.setattr(texture_run, "train_steps", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(space)
    monkeypatch.undo()
    assert (made := run(space)).resumed_from == 2
    assert np.array_equal(made.texture.pixels, whole.texture.pixels)


@pytest.mark.slow
def test_a_finished_texture_is_not_trained_again_unless_asked(space):
    made = run(space)
    assert run(space).was_finished
    assert not run(space, restart=True).was_finished
    made.files.glb("crate").unlink()
    assert not run(space).was_finished
    assert not run(space, crate_request(gradient="linear")).was_finished


@pytest.mark.slow
def test_other_settings_give_other_textures(space):
    first = run(space).texture.pixels
    for change in ({"gradient": "linear"}, {"optimiser": "adam"}, {"exposure": None}):
        assert not np.array_equal(first, run(space, crate_request(name="other", **change)).texture.pixels)


@pytest.mark.slow
def test_several_objects_share_one_texture(space):
    spec = (space.objects_dir / "crate.toml").read_text()
    (space.objects_dir / "box.toml").write_text(spec.replace('name = "crate"', 'name = "box"').replace("100", "80"))
    made = run(space, crate_request(objects=("crate", "box"), views=replace(crate_request().views, studios=2)))
    assert made.texture.record.name == "jet"
    assert [one.name for one in made.texture.record.objects] == ["crate", "box"]
    assert made.files.glb("box").name == "jet-box.glb" and made.files.glb("box").is_file()


@pytest.mark.slow
def test_photographs_stand_behind_the_object(space, tmp_path):
    photos = write_photos(tmp_path / "photos", 3)
    made = run(space, crate_request(backgrounds=photos, background_share=1.0))
    assert made.texture.record.data["backgrounds"]["used"] == 3
    assert not np.array_equal(made.texture.pixels, run(space, crate_request(name="studio")).texture.pixels)


@pytest.mark.parametrize("name", ["sign", "sgd", "adam"])
def test_optimisers_go_down_a_bowl(name):
    """The least of |θ - 0.7|² is at 0.7, wherever one begins."""
    theta = torch.rand(3, 4, 4, generator=torch.Generator().manual_seed(1))
    optimiser = Optimiser(name, theta, 0, {})
    for step in range(300):
        optimiser.step(theta - 0.7, 0.05 * (1 - step / 300))
    assert (theta - 0.7).abs().max() < 0.02


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"objects": ()}, "at least one object"),
        ({"objects": ("crate", "crate")}, "each object once"),
        ({"size_px": 4}, "8 to 1024"),
        ({"optimiser": "lion"}, "optimiser"),
        ({"gradient": "exact"}, "gradient"),
        ({"background_share": 0.5}, "needs photographs"),
        ({"reuse": 0}, "--reuse 0"),
    ],
)
def test_a_request_that_cannot_be_is_refused(change, message):
    with pytest.raises(ToolkitError, match=message):
        crate_request(**change)


def test_objects_of_several_classes_need_a_class(space):
    spec = (space.objects_dir / "crate.toml").read_text()
    (space.objects_dir / "box.toml").write_text(spec.replace('"crate"', '"box"').replace("box.obj", "crate.obj"))
    with pytest.raises(ToolkitError, match=r"several classes.*--class"):
        run(space, crate_request(objects=("crate", "box"), class_name=None))


def test_the_atlas_of_the_parts_is_the_one_that_the_variant_wears(space):
    from toolkit.rig.variants import paint_object

    made = run(space)
    item = load_object(space.object_spec("crate"))
    worn = paint_object(item, made.texture, made.texture.pixels)
    assert np.array_equal(worn.uv[worn.faces], make_crate(space)[1].corner_uv)
