"""Best and random images, fixed patterns, and the sets that they are written to."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.network import Classifier
from toolkit.models.weights import WeightsFile
from toolkit.objects.records import read_patch
from toolkit.rooms.benchmarks.patch_sets import read_patch_set
from toolkit.rooms.benchmarks.patch_sets.baselines import BaselineConfig
from toolkit.rooms.benchmarks.patch_sets.baselines.make import make_baseline

LABELS = ["cat", "dog", "sports car", "jet"]
IMAGE_PX = 32


@pytest.fixture
def classifier():
    torch.manual_seed(3)
    module = torch.nn.Sequential(
        torch.nn.Conv2d(3, 8, 5, 2), torch.nn.Softplus(), torch.nn.AdaptiveAvgPool2d(3), torch.nn.Flatten(),
        torch.nn.Linear(72, len(LABELS)),
    )  # fmt: skip
    how = Preprocessing(36, IMAGE_PX, (0.5, 0.4, 0.3), (0.25, 0.2, 0.3))
    return Classifier(
        "tiny", module.eval(), LABELS, how, WeightsFile(Path("tiny.pth"), "ab" * 32, "tiny.pth"), "cpu", False
    )


@pytest.fixture
def space(tmp_path):
    return make_workspace(tmp_path / "space")


@pytest.fixture
def data(tmp_path):
    """Twelve images of each of three classes, in two orientations."""
    rng = np.random.default_rng(1)
    for label in ("cat", "dog", "sports_car"):
        folder = tmp_path / "data" / "train" / label
        folder.mkdir(parents=True)
        for k in range(12):
            coarse = rng.integers(0, 256, (3, 4, 3), np.uint8)
            size = (60, 44) if k % 2 else (40, 52)
            Image.fromarray(coarse).resize(size, Image.Resampling.BICUBIC).save(folder / f"{k:02d}.png")
    return tmp_path / "data"


def make(kind, classifier, space, data=None, **more):
    return make_baseline(BaselineConfig(kind=kind, data=data and str(data), **more), classifier, space)


def loss_by_torch(classifier, file, index):
    """The same by other hands: torchvision's transforms, its normalisation and its cross entropy."""
    from torchvision.transforms import CenterCrop, Compose, Normalize, Resize, ToTensor

    how = classifier.preprocessing
    steps = Compose([Resize(how.resize_px), CenterCrop(how.crop_px), ToTensor(), Normalize(how.mean, how.std)])
    with torch.no_grad():
        logits = classifier.module(steps(Image.open(file).convert("RGB"))[None])
    return float(torch.nn.functional.cross_entropy(logits, torch.tensor([index])))


def torchvision_square(file, size_px):
    from torchvision.transforms.functional import center_crop, pil_to_tensor, resize

    picture = Image.open(file).convert("RGB")
    square = center_crop(pil_to_tensor(picture), min(picture.size))
    return resize(square, [size_px, size_px], antialias=True).permute(1, 2, 0).numpy().astype(int)


def test_the_best_image_is_the_one_with_the_lowest_loss(classifier, space, data, monkeypatch):
    monkeypatch.setattr(
        "toolkit.rooms.benchmarks.patch_sets.baselines.make.BATCH", 5
    )  # more than one batch, the last not full
    made = make("best-image", classifier, space, data, sizes_px=(16, 24))
    assert [(one.name, one.made, one.found) for one in made.sets] == [("best-image-16", 3, 0), ("best-image-24", 3, 0)]
    assert made.skipped == ()
    patches = read_patch_set(space, "best-image-16", LABELS)
    assert sorted(patches.patches) == [0, 1, 2]
    for index, folder in enumerate(("cat", "dog", "sports_car")):
        losses = {
            file: loss_by_torch(classifier, file, index) for file in sorted((data / "train" / folder).glob("*.png"))
        }
        best = min(losses, key=losses.get)
        record = patches.patches[index].record
        assert record.data["image"] == f"{folder}/{best.name}"
        assert record.data["compared"] == record.data["found"] == 12
        assert record.final["loss"] == pytest.approx(losses[best], abs=1e-5)
        assert record.networks[0].sha256 == "ab" * 32
        expected = torchvision_square(best, 16)
        assert np.abs(expected - patches.patches[index].pixels).max() <= 2, "its central square, antialiased; rounding"
        again = read_patch(space.root / "print/patches/best-image-24" / f"{record.name}.png")
        assert again.record.data["image"] == record.data["image"]


def test_batches_decide_nothing(classifier, space, data, monkeypatch):
    make("best-image", classifier, space, data, sizes_px=(16,))
    monkeypatch.setattr("toolkit.rooms.benchmarks.patch_sets.baselines.make.BATCH", 1)
    make("best-image", classifier, space, data, sizes_px=(16,), set_name="one-by-one")
    sets = [read_patch_set(space, name, LABELS) for name in ("best-image-16", "one-by-one-16")]
    assert sets[0].sha256 == sets[1].sha256


def test_random_images_are_drawn_by_seed_and_class(classifier, space, data):
    for seed in range(8):
        make("random-image", classifier, space, data, sizes_px=(16,), seed=seed, set_name=f"seed{seed}")
    chosen = [
        [patch.record.data["image"] for patch in read_patch_set(space, f"seed{seed}-16", LABELS).patches.values()]
        for seed in range(8)
    ]
    for of_class in zip(*chosen, strict=True):
        assert len(set(of_class)) > 3, "of twelve images, eight draws do not hit the same"
    assert len({Path(image).name for image in chosen[0]} | {Path(image).name for image in chosen[1]}) > 1
    make("random-image", classifier, space, data, sizes_px=(16,), class_names=("dog",), set_name="alone")
    alone = read_patch_set(space, "alone-16", LABELS).patches[1]
    assert alone.record.data["image"] == chosen[0][1], "the other classes do not matter"


def test_fixed_patterns_have_the_published_mean_and_deviation(classifier, space):
    make("fixed-pattern", classifier, space, sizes_px=(32, 16))
    make("fixed-pattern", classifier, space, sizes_px=(32,), seed=1, set_name="other")
    patches, other = (read_patch_set(space, name, LABELS) for name in ("fixed-pattern-32", "other-32"))
    pixels = patches.stack(np.arange(4))
    assert pixels.mean() == pytest.approx(0.5, abs=0.005)
    assert pixels.std() == pytest.approx(0.1, abs=0.003)
    flat = np.concatenate([pixels.reshape(4, -1), other.stack(np.arange(4)).reshape(4, -1)])
    assert np.abs(np.corrcoef(flat) - np.eye(8)).max() < 0.1, "classes and seeds are independent"
    assert patches.patches[0].record.networks == []


def test_a_second_run_does_nothing_and_an_interrupted_one_goes_on(classifier, space, data, monkeypatch):
    from toolkit.rooms.benchmarks.patch_sets.baselines import make as module

    written = []
    real = module.write_patch

    def write_two(folder, pixels, record):
        if len(written) == 2:
            raise KeyboardInterrupt
        written.append(record["name"])
        return real(folder, pixels, record)

    monkeypatch.setattr(module, "write_patch", write_two)
    with pytest.raises(KeyboardInterrupt):
        make("best-image", classifier, space, data, sizes_px=(16,))
    monkeypatch.setattr(module, "write_patch", real)
    assert [(one.made, one.found) for one in make("best-image", classifier, space, data, sizes_px=(16,)).sets] == [
        (1, 2)
    ]
    folder = space.root / "print/patches/best-image-16"
    before = {file: file.stat().st_mtime_ns for file in folder.iterdir()}
    assert len(before) == 6
    monkeypatch.setattr("toolkit.rooms.benchmarks.patch_sets.baselines.make.measure_losses", None)
    assert [(one.made, one.found) for one in make("best-image", classifier, space, data, sizes_px=(16,)).sets] == [
        (0, 3)
    ]
    assert {file: file.stat().st_mtime_ns for file in folder.iterdir()} == before


def test_what_changed_is_made_anew(classifier, space, data):
    make("best-image", classifier, space, data, sizes_px=(16,))
    folder = space.root / "print/patches/best-image-16"
    record = json.loads((folder / "cat.json").read_text())
    (folder / "dog.png").write_bytes(b"")  # as a kill between picture and record leaves them: not a pair
    Image.new("RGB", (50, 50), "red").save(data / "train" / record["data"]["image"])
    (data / "train" / "sports_car" / "00.png").unlink()
    assert [(one.made, one.found) for one in make("best-image", classifier, space, data, sizes_px=(16,)).sets] == [
        (3, 0)
    ]
    assert [(one.made, one.found) for one in make("best-image", classifier, space, data, sizes_px=(16,)).sets] == [
        (0, 3)
    ]


def test_a_bad_image_is_passed_over_and_listed_also_the_next_time(classifier, space, data):
    content = (data / "train/dog/03.png").read_bytes()
    (data / "train/dog/03.png").write_bytes(content[: len(content) // 2])
    Image.new("RGB", (5, 4)).save(data / "train/dog/04.png")
    for _ in range(2):
        made = make("best-image", classifier, space, data, sizes_px=(16,))
        assert [path for path, _ in made.skipped] == ["dog/03.png", "dog/04.png"]
        assert "truncated" in made.skipped[0][1]
        assert "too small" in made.skipped[1][1]
    assert [(one.made, one.found) for one in made.sets] == [(0, 3)]
    record = read_patch(space.root / "print/patches/best-image-16/dog.png").record
    assert record.data["compared"] == 10
    for seed in range(30):  # one of them draws a bad one first
        made = make("random-image", classifier, space, data, sizes_px=(16,), seed=seed, set_name=f"s{seed}")
        assert made.sets[0].made == 3
        if made.skipped:
            break
    assert {path for path, _ in made.skipped} <= {"dog/03.png", "dog/04.png"}
    assert made.skipped


def test_a_class_with_no_good_image_is_named_and_the_others_are_made(classifier, space, data):
    for file in (data / "train/dog").iterdir():
        file.write_bytes(b"no image")
    for kind in ("best-image", "random-image"):
        made = make(kind, classifier, space, data, sizes_px=(16,))
        assert len(made.skipped) == 13
        assert made.skipped[-1] == ("class 'dog'", "none of its images can be read")
        assert sorted(read_patch_set(space, f"{kind}-16", LABELS).patches) == [0, 2]


def test_classes_are_those_of_the_data_or_all_or_those_that_are_named(classifier, space, data):
    make("fixed-pattern", classifier, space, sizes_px=(16,), set_name="all")
    make("fixed-pattern", classifier, space, data, sizes_px=(16,), set_name="data")
    make("fixed-pattern", classifier, space, sizes_px=(16,), set_name="named", class_names=("jet", "3", "dog"))
    sets = [sorted(read_patch_set(space, f"{name}-16", LABELS).patches) for name in ("all", "data", "named")]
    assert sets == [[0, 1, 2, 3], [0, 1, 2], [1, 3]]


def test_a_set_made_another_way_is_neither_overwritten_nor_mixed(classifier, space, data):
    make("fixed-pattern", classifier, space, sizes_px=(16,), class_names=("cat",))
    make("fixed-pattern", classifier, space, sizes_px=(16,), class_names=("dog",))
    assert sorted(read_patch_set(space, "fixed-pattern-16", LABELS).patches) == [0, 1]
    with pytest.raises(ToolkitError, match=r"fixed-pattern-16 holds pictures made with seed 0, not 7: .*with set_name"):
        make("fixed-pattern", classifier, space, sizes_px=(16,), seed=7)
    with pytest.raises(ToolkitError, match=r"with method 'fixed pattern of Gaussian noise', not 'random training"):
        make("random-image", classifier, space, data, sizes_px=(16,), set_name="fixed-pattern")
    make("best-image", classifier, space, data, sizes_px=(16,))
    weights = replace(classifier.weights, sha256="cd" * 32)
    with pytest.raises(ToolkitError, match="with network 'tiny abababababab', not 'tiny cdcdcdcdcdcd'"):
        make("best-image", replace(classifier, weights=weights), space, data, sizes_px=(16,))


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        ({"kind": "bar-code"}, "kind bar-code: expected qr, apriltag, word, best-image, random-image or fixed-pattern"),
        ({"kind": "best-image"}, "best-image: expected training images.*name them with data"),
        ({"kind": "random-image", "data": "nowhere"}, "nowhere: does not exist"),
        ({"kind": "qr", "class_names": ("horse",)}, "no .* called 'horse'"),
        ({"kind": "best-image", "data": "data", "class_names": ("jet",)}, "class 'jet' has no images in data/train"),
        (
            {"kind": "qr"},
            r"images of 32 px, which \w+ sees, are too small: at least 46 \(21 modules and 1 white at each",
        ),
        ({"kind": "apriltag", "sizes_px": (19,)}, r"sizes_px 19: expected 20 \(8 modules"),
        ({"kind": "fixed-pattern", "sizes_px": (16, 7)}, "sizes_px 7: expected 8 to 32 px"),
        ({"kind": "fixed-pattern", "sizes_px": (33,)}, "sizes_px 33: expected 8 to 32 px"),
        ({"kind": "apriltag", "border": 0}, "border 0: expected 1 or more white modules"),
        ({"kind": "fixed-pattern", "border": 2}, "border 2: fixed-pattern is no code"),
        ({"kind": "qr", "set_name": "../away"}, "set_name '../away': expected letters"),
    ],
)
def test_bad_input_is_one_clear_line(request_, message, classifier, space, data, monkeypatch):
    monkeypatch.chdir(data.parent)
    with pytest.raises(ToolkitError, match=message) as told:
        make_baseline(BaselineConfig(**request_), classifier, space)
    assert "\n" not in str(told.value)
    assert not list((space.root / "print" / "patches").iterdir()), "nothing is begun"
