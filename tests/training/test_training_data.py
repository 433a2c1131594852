"""What a classifier is trained on: folders in both layouts, renders, and what is wrong with them."""

import json

import numpy as np
import pytest
import torch
from colour_folder import write_colours
from PIL import Image
from typer.testing import CliRunner

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.training.classifier_config import PHOTOGRAPHS, SMALL_IMAGES
from toolkit.training.classifier_task import augment_batch
from toolkit.training.data import RenderCounts, list_classes, load_training_set, open_source
from toolkit.training.images import find_classes
from toolkit.training.renders import RenderUnit, render_unit

SQUARE = Preprocessing(16, 16, (0.5,) * 3, (0.25,) * 3)
COUNTS = RenderCounts(per_class=4, views=2, held_out=0.5, seed=0, px=32)


@pytest.fixture
def space(tmp_path):
    return make_workspace(tmp_path / "space")


def load(space, *data, keep=None):
    sources = [open_source(str(one), space, COUNTS) for one in data]
    return load_training_set(sources, list_classes(sources), SQUARE, keep or space.root / "keep", 1)


def test_train_and_test_folders_are_used_as_they_are(tmp_path, space):
    write_colours(tmp_path / "set" / "train", 5)
    write_colours(tmp_path / "set" / "test", 2, seed=1)
    data = load(space, tmp_path / "set")
    assert data.labels == ("blue", "green", "red")
    assert np.bincount(data.train.classes).tolist() == [5, 5, 5]
    assert np.bincount(data.held_out.classes).tolist() == [2, 2, 2]
    expected = np.asarray(Image.open(tmp_path / "set" / "train" / "green" / "003.png"))
    np.testing.assert_array_equal(data.train.images[5 + 3], expected)


def test_a_plain_folder_is_split_by_the_seed(tmp_path):
    folder = write_colours(tmp_path / "set", 10)
    found = [find_classes(folder, 0.3, seed) for seed in (0, 0, 1)]
    held_out = [{one.path for one in each.held_out} for each in found]
    assert held_out[0] == held_out[1] != held_out[2]
    for each in found:
        assert not {one.path for one in each.held_out} & {one.path for one in each.train}
        assert sorted(one.label for one in each.held_out) == ["blue"] * 3 + ["green"] * 3 + ["red"] * 3
        assert len(each.train) == 21


def test_bad_images_are_listed_and_the_rest_is_used(tmp_path, space):
    folder = write_colours(tmp_path / "set", 4)
    (folder / "red" / "broken.png").write_bytes(b"not an image")
    (folder / "red" / "empty.jpg").write_bytes(b"")
    (folder / "stray.png").write_bytes((folder / "red" / "000.png").read_bytes())
    Image.new("RGB", (2, 9)).save(folder / "blue" / "speck.png")
    data = load(space, folder)
    reasons = dict(data.skipped)
    assert "not an image" in reasons["set/red/broken.png"] and "empty" in reasons["set/red/empty.jpg"]
    assert "no class folder" in reasons["set/stray.png"] and "2×9 px, too small" in reasons["set/blue/speck.png"]
    assert len(data.skipped) == 4
    assert len(data.train.images) + len(data.held_out.images) == 12


def test_folders_that_cannot_be_trained_on(tmp_path, space):
    with pytest.raises(ToolkitError, match="does not exist: expected 'everyday', 'rig', cifar10:FOLDER, or a folder"):
        load(space, tmp_path / "nowhere")
    folder = write_colours(tmp_path / "set", 2)
    (folder / "yellow").mkdir()
    with pytest.raises(ToolkitError, match="yellow: a class without images"):
        load(space, folder)
    (folder / "yellow" / "bad.png").write_bytes(b"x")
    with pytest.raises(ToolkitError, match=r"class 'yellow': none of its images can be used; set/yellow/bad\.png: not"):
        load(space, folder)
    one = tmp_path / "one"
    (one / "cup").mkdir(parents=True)
    Image.new("RGB", (20, 20)).save(one / "cup" / "1.png")
    with pytest.raises(ToolkitError, match="needs at least two classes: found only 'cup'"):
        load(space, one)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ToolkitError, match=r"no images in it: expected CLASS/IMAGE\.jpg"):
        load(space, tmp_path / "empty")
    write_colours(tmp_path / "both" / "train", 2)
    write_colours(tmp_path / "both" / "val", 1)
    (tmp_path / "both" / "val" / "red").rename(tmp_path / "both" / "val" / "rot")
    with pytest.raises(ToolkitError, match=r"no class 'rot' in .*train: expected the same class folders"):
        load(space, tmp_path / "both")


def test_what_is_packed_is_kept_until_the_files_change(tmp_path, space):
    folder = write_colours(tmp_path / "set", 3)
    first = load(space, folder)
    (place,) = (space.root / "keep").iterdir()
    stamp = (place / "about.json").stat().st_mtime_ns
    assert (first.train.sha256, first.held_out.sha256) == hashes(load(space, folder))
    assert (place / "about.json").stat().st_mtime_ns == stamp
    Image.new("RGB", (16, 16)).save(folder / "red" / "000.png")
    assert hashes(load(space, folder)) != hashes(first)
    assert len(list((space.root / "keep").iterdir())) == 2
    for damaged in (space.root / "keep").glob("*/train.raw"):
        damaged.write_bytes(b"")
    with pytest.raises(ToolkitError, match=r"train\.raw is damaged: .*train with restart"):
        load(space, folder)


def hashes(data):
    return data.train.sha256, data.held_out.sha256


def test_renders_of_the_rig(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path)
    sources = [open_source("rig", space, COUNTS)]
    crates = [unit for unit in sources[0].train if unit.label == "crate"]
    held_out = [unit for unit in sources[0].held_out if unit.label == "crate"]
    assert len(crates) == 2 and len(held_out) == 1  # 4 images to train on and 2 held out, 2 a studio
    assert not {unit.seed for unit in crates} & {unit.seed for unit in held_out}
    first, again, other = render_unit(crates[0]), render_unit(crates[0]), render_unit(crates[1])
    assert first.shape == (2, 32, 32, 3) and first.dtype == np.uint8
    np.testing.assert_array_equal(first, again)
    assert np.abs(first.astype(int) - other).mean() > 5
    assert first.std() > 5


def test_renders_are_of_the_mesh_with_its_colours(tmp_path, make_crate_space):
    """Colours that an OBJ keeps in an MTL and a picture beside it are part of what the renders rest on."""
    space = make_crate_space(tmp_path)
    mesh = space.objects_dir / "crate.obj"
    mesh.write_text("mtllib crate.mtl\nvt 0 0\nusemtl wood\n" + mesh.read_text().replace("\nf ", "\nf ").strip() + "\n")
    keys = []

    def note(file: str, content: bytes) -> None:
        (space.objects_dir / file).write_bytes(content)
        keys.append(open_source("rig", space, COUNTS).key)

    note("crate.mtl", b"newmtl wood\nKd 0.8 0.5 0.2\n")
    note("crate.mtl", b"newmtl wood\nKd 0.1 0.5 0.2\n")
    note("crate.obj", mesh.read_bytes() + b"# another word\n")
    assert keys[0] != keys[1] == keys[2]


@pytest.mark.slow
def test_renders_are_made_by_processes_and_kept(tmp_path, make_crate_space):
    from toolkit.training.renders import render_shards

    space = make_crate_space(tmp_path)
    units = [RenderUnit(str(space.object_spec("crate")), "crate", (0, k), 2, 24) for k in range(3)]
    shards = [tmp_path / "shards" / unit.name for unit in units]
    shards[0].parent.mkdir()
    shards[0].write_bytes(b"from an earlier run")
    counted = []
    render_shards(units, tmp_path / "shards", 1, counted.append)
    assert counted == [2, 2]  # only what is missing
    assert shards[0].read_bytes() == b"from an earlier run"
    pictures = [np.load(shard) for shard in shards[1:]]
    assert all(one.shape == (2, 24, 24, 3) and one.std() > 5 for one in pictures)
    assert not np.array_equal(*pictures)
    np.testing.assert_allclose(pictures[0].astype(int), render_unit(units[1]), atol=2)


def test_a_spec_with_a_number_for_its_class_is_refused(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path)
    spec = space.object_spec("crate")
    spec.write_text(spec.read_text().replace('class = "crate"', "class = 7"))
    with pytest.raises(ToolkitError, match=r"crate\.toml: field 'class' is the number 7"):
        open_source("rig", space, COUNTS)


def test_everyday_objects_are_other_ones_when_held_out(space):
    source = open_source("everyday", space, COUNTS)
    labels = {unit.label for unit in source.train}
    assert {"racer", "warplane", "coffeepot", "eggnog"} <= labels and len(labels) > 30
    assert len(source.train) == 2 * len(labels) and len(source.held_out) == len(labels)
    assert not {unit.seed for unit in source.train} & {unit.seed for unit in source.held_out}
    assert len({unit.name for unit in (*source.train, *source.held_out)}) == 3 * len(labels)


def test_the_command_lists_bad_images_and_exits_with_one(tmp_path):
    from toolkit.cli import app

    folder = write_colours(tmp_path / "set", 6)
    (folder / "red" / "broken.png").write_bytes(b"not an image")
    make_workspace(tmp_path / "space")
    arguments = ["train-classifier", "--data", str(folder), "--name", "mine", "--arch", "squeezenet1_1", "--quiet"]
    arguments += ["--image-px", "32", "--epochs", "1", "--batch", "8", "--workspace", str(tmp_path / "space")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 1, done.output
    assert "skipped set/red/broken.png: not an image" in done.output
    assert "mine.safetensors: squeezenet1_1, 3 classes" in done.output
    assert "held-out images: " in done.output and "95 % interval" in done.output
    assert "next: toolkit eval captures/ --model mine" in done.output
    again = CliRunner().invoke(app, [*arguments, "--json"])
    result = json.loads(again.stdout)
    assert result["was_finished"] and result["record"]["name"] == "mine" and len(result["skipped"]) == 1


@pytest.mark.parametrize("how", [PHOTOGRAPHS, SMALL_IMAGES])
def test_augmented_images_vary_within_bounds_by_the_seed(how):
    flat = torch.arange(0, 256, 8, dtype=torch.uint8).repeat_interleave(2).view(1, 1, 1, 64)
    images = flat.expand(6, 3, 64, 64).contiguous()
    one, same, other = (augment_batch(images, np.random.default_rng(seed), 48, how) for seed in (3, 3, 4))
    assert one.shape == (6, 3, 48, 48) and one.min() >= 0 and one.max() <= 1
    assert torch.equal(one, same) and not torch.equal(one, other)
    slopes = (one[..., -8:].mean((1, 2, 3)) - one[..., :8].mean((1, 2, 3))).sign().tolist()
    assert {-1.0, 1.0} <= set(slopes) or set(slopes) in ({-1.0}, {1.0})
    assert all(slope != 0 for slope in slopes)  # the ramp stays a ramp, mirrored or not


def test_without_variation_the_middle_is_cut():
    from toolkit.training.classifier_config import Augmentation

    still = Augmentation((1.0, 1.0), 0, 0, (1, 1), (1, 1), (1, 1), 0, 0, (0, 0), (0, 0))
    images = torch.from_numpy(np.random.default_rng(0).integers(0, 256, (4, 3, 20, 20), dtype=np.uint8))
    seen = augment_batch(images, np.random.default_rng(0), 20, still)
    for image, result in zip(images.float() / 255, seen, strict=True):
        assert min(float((result - image).abs().max()), float((result - image.flip(-1)).abs().max())) < 1e-4
