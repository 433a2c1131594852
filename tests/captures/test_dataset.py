"""The Dataset against Pillow, by hand and in a DataLoader's workers; the table against the CSV."""

import csv

import numpy as np
import pytest
import torch
from PIL import Image
from tiny_network import IMAGE_PX, tiny_classifier
from torch.utils.data import DataLoader

from toolkit.captures.shoot import ShootSettings, shoot_plan
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.evaluation.ground_truth import load_captures
from toolkit.evaluation.predictions_csv import predictions_table
from toolkit.rig.plan import open_plan


def write_photo(file, seed, size=(64, 48)):
    file.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    Image.fromarray(pixels).save(file)


@pytest.fixture
def space(tmp_path):
    """Photographs sorted by hand: two objects named for classes, two variants, two poses."""
    space = make_workspace(tmp_path / "lab")
    places = [(o, v, p) for o in ("cat", "sports_car") for v in ("patched", "unpatched") for p in (1, 2)]
    for seed, (name, variant, pose) in enumerate(places):
        write_photo(space.captures_dir / "real" / name / variant / f"pose_{pose}.png", seed)
    return space


def crop_by_hand(file):
    """Short side to 36 px, middle 32 px, as `tiny_network` wants it."""
    picture = Image.open(file).convert("RGB").resize((48, 36), Image.Resampling.BILINEAR)
    left, top = (48 - IMAGE_PX) // 2, (36 - IMAGE_PX) // 2
    picture = picture.crop((left, top, left + IMAGE_PX, top + IMAGE_PX))
    return torch.from_numpy(np.asarray(picture).astype(np.float32) / 255).permute(2, 0, 1)


def test_samples_are_pillows_crops_with_class_and_place(space):
    dataset = load_captures(space, tiny_classifier())
    assert len(dataset) == 8 and dataset.refused == ()
    for image, target, info in (dataset[index] for index in range(8)):
        assert image.dtype == torch.float32
        assert torch.equal(image, crop_by_hand(space.captures_dir / info["path"]))
        assert info["path"] == f"real/{info['object']}/{info['variant']}/pose_{info['pose_id']}.png"
        assert target == {"cat": 0, "sports_car": 2}[info["object"]]
        assert info["T_world_camera"].isnan().all()


@pytest.mark.parametrize("workers", [0, 2])
def test_a_data_loader_joins_them_in_order(space, workers):
    dataset = load_captures(space, tiny_classifier(), variants=["patched"])
    batches = list(DataLoader(dataset, batch_size=3, num_workers=workers))
    assert [len(images) for images, _, _ in batches] == [3, 1]
    images, targets, info = batches[0]
    assert images.shape == (3, 3, IMAGE_PX, IMAGE_PX) and targets.tolist() == [0, 0, 2]
    assert info["pose_id"].tolist() == [1, 2, 1] and info["variant"] == ["patched"] * 3
    assert info["T_world_camera"].shape == (3, 4, 4)
    assert torch.equal(images[2], crop_by_hand(space.captures_dir / info["path"][2]))


def test_the_camera_of_a_shot_is_the_plans(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path / "lab")
    plan = open_plan(space)
    shoot_plan(space, plan, ["crate"], ["unpatched"], ShootSettings(image_format="png"))
    classifier = tiny_classifier()
    classifier.labels[1] = "crate"
    found = {info["pose_id"]: info["T_world_camera"] for _, _, info in load_captures(space, classifier)}
    for pose in plan.objects["crate"]:
        assert np.allclose(found[pose.id].numpy(), pose.matrix(), atol=1e-3)


def test_a_transform_is_the_last_step(space):
    plain, turned = (
        load_captures(space, tiny_classifier()),
        load_captures(space, tiny_classifier(), transform=torch.neg),
    )
    assert torch.equal(turned[3][0], -plain[3][0])


def test_an_image_that_cannot_be_read_is_named(space):
    (space.captures_dir / "real" / "cat" / "patched" / "pose_1.png").write_bytes(b"no picture")
    dataset = load_captures(space, tiny_classifier())
    with pytest.raises(ToolkitError, match=r"real/cat/patched/pose_1.png: .*remove it"):
        dataset[0]
    assert dataset[1][1] == 0


def test_a_link_out_of_the_folder_is_listed_and_no_sample(space, tmp_path):
    write_photo(tmp_path / "elsewhere.png", 99)
    (space.captures_dir / "real" / "cat" / "patched" / "pose_3.png").symlink_to(tmp_path / "elsewhere.png")
    dataset = load_captures(space, tiny_classifier())
    assert len(dataset) == 8
    assert [path for path, _ in dataset.refused] == ["real/cat/patched/pose_3.png"]


def test_the_logits_are_those_of_the_evaluation(space):
    classifier = tiny_classifier()
    (space.captures_dir / "real" / "cat" / "patched" / "broken.png").write_bytes(b"no picture")
    result = evaluate_captures(space.captures_dir, space, classifier)
    table = predictions_table(result)
    rows = list(csv.DictReader((result.run_dir / "predictions.csv").open()))
    assert list(table.columns) == list(rows[0]) and len(table) == len(rows) == 9
    assert table.path.tolist() == [row["path"] for row in rows]

    (space.captures_dir / "real" / "cat" / "patched" / "broken.png").unlink()
    read = table[table.status == "ok"].set_index("path")
    for image, target, info in load_captures(space, classifier):
        probabilities = classifier.logits(image[None]).softmax(1)[0]
        row = read.loc[info["path"]]
        assert row.top1_index == int(probabilities.argmax())
        assert row.true_prob == pytest.approx(float(probabilities[target]), rel=1e-4)
        assert row.correct_top1 == (row.top1_index == target)


def test_what_is_not_known_is_na(space):
    (space.captures_dir / "real" / "cat" / "patched" / "broken.png").write_bytes(b"no picture")
    run_dir = evaluate_captures(space.captures_dir, space, tiny_classifier()).run_dir
    table = predictions_table(str(run_dir))
    broken = table[table.path.str.endswith("broken.png")].iloc[0]
    assert broken.isna().sum() == 8 and broken.true_label == "cat" and broken.status != "ok"
    shares = table.groupby(["object", "variant"]).correct_top1.mean()
    assert shares.shape == (4,) and shares.between(0, 1).all()


def test_a_folder_without_predictions_is_named(tmp_path):
    with pytest.raises(ToolkitError, match=r"holds no predictions.csv: expected .*eval/RUN"):
        predictions_table(tmp_path)


def test_without_pandas_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(ToolkitError, match=r"pip install '\.\[pandas\]'"):
        predictions_table(tmp_path)
