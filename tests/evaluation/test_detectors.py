"""Detectors: what is decoded, what counts as found, average precision as pycocotools counts it."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from one_line import error_of
from typer.testing import CliRunner

from toolkit.evaluation.detect import ScoredBoxes, average_precision, mean_average_precision, recall_at
from toolkit.models.decoders import decode_fastestdet, decode_yolox
from toolkit.models.detector import Detections, box_iou, detector_class
from toolkit.models.weights import WeightsFile

pytestmark = pytest.mark.usefixtures("forked_trials")
SHARED = Path(__file__).parents[2].parent / "shared"
DETECTORS = sorted((SHARED / "detectors").glob("*.onnx"))
needs_shared = pytest.mark.skipif(not DETECTORS, reason="needs ../shared/detectors")


def test_average_precision_is_that_of_pycocotools():
    coco = pytest.importorskip("pycocotools.coco", reason="needs pycocotools: pip install pycocotools")
    cocoeval = pytest.importorskip("pycocotools.cocoeval")
    rng = np.random.default_rng(4)
    truths, answers, ours = [], [], []
    for image in range(1, 31):
        box = np.array([*rng.uniform(0, 60, 2), *rng.uniform(20, 60, 2)])  # x, y, width, height
        truths.append({"id": image, "image_id": image, "category_id": 1, "bbox": box.tolist(), "iscrowd": 0,
                       "area": float(box[2] * box[3])})  # fmt: skip
        corners = np.array([*box[:2], *(box[:2] + box[2:])])
        n = rng.integers(0, 6)
        moved = corners + rng.normal(0, [[6], [2], [9], [1], [20]][:n] if n else 1, (n, 4))
        moved[:, 2:] = np.maximum(moved[:, 2:], moved[:, :2] + 1)
        scores = np.sort(rng.uniform(0, 1, n))[::-1].round(6)
        for one, score in zip(moved, scores, strict=True):
            answers.append({"image_id": image, "category_id": 1, "score": float(score),
                            "bbox": [*one[:2].tolist(), *(one[2:] - one[:2]).tolist()]})  # fmt: skip
        ours.append(ScoredBoxes(scores, box_iou(moved, corners)))
    data = coco.COCO()
    data.dataset = {"images": [{"id": one["image_id"]} for one in truths], "annotations": truths,
                    "categories": [{"id": 1, "name": "thing"}], "info": {}}  # fmt: skip
    data.createIndex()
    judge = cocoeval.COCOeval(data, data.loadRes(answers), "bbox")
    judge.evaluate()
    judge.accumulate()
    judge.summarize()
    assert average_precision(ours, 0.5) == pytest.approx(judge.stats[1], abs=1e-9)
    assert average_precision(ours, 0.75) == pytest.approx(judge.stats[2], abs=1e-9)
    assert mean_average_precision(ours) == pytest.approx(judge.stats[0], abs=1e-9)
    assert 0.1 < judge.stats[0] < judge.stats[1] < 0.95
    assert recall_at(ours) == pytest.approx(judge.eval["recall"][0, 0, 0, 2], abs=1e-9)


def test_yolox_boxes_lie_where_its_paper_says():
    size, outputs = 64, torch.zeros(1, 84, 5 + 3)  # 8² + 4² + 2² places
    place = 64 + 4 * 1 + 2  # row 1, column 2 of the grid of stride 16
    outputs[0, place] = torch.tensor([0.25, 0.5, np.log(2.0), np.log(1.5), 0.8, 0.1, 0.9, 0.0])
    boxes, scores = decode_yolox(outputs, size)
    centre, sides = ((2 + 0.25) * 16, (1 + 0.5) * 16), (32, 24)
    expected = [centre[0] - 16, centre[1] - 12, centre[0] + 16, centre[1] + 12]
    assert sides == (32, 24) and boxes[0, place].tolist() == pytest.approx(expected, abs=1e-4)
    assert scores[0, place].tolist() == pytest.approx([0.08, 0.72, 0], abs=1e-6)


def test_fastestdet_boxes_lie_where_its_code_says():
    outputs = torch.zeros(1, 5 + 2, 4, 4)
    outputs[0, :, 1, 3] = torch.tensor([0.5, np.arctanh(0.5), np.arctanh(-0.25), 0.0, np.log(3.0), 0.2, 0.8])
    boxes, scores = decode_fastestdet(outputs, 64)
    x, y, width, height = (3 + 0.5) / 4 * 64, (1 - 0.25) / 4 * 64, 0.5 * 64, 0.75 * 64
    expected = [x - width / 2, y - height / 2, x + width / 2, y + height / 2]
    assert boxes[0, 1 * 4 + 3].tolist() == pytest.approx(expected, abs=1e-4)
    assert scores[0, 7, 1].item() == pytest.approx(0.5**0.6 * 0.8**0.4)


@needs_shared
@pytest.mark.parametrize("file", DETECTORS, ids=lambda file: file.stem)
def test_real_detectors_find_an_airliner_wherever_it_lies(file):
    from PIL import Image

    from toolkit.models.load_detector import is_detector, load_detector

    photo = SHARED / "images/nips2017"
    image = np.asarray(Image.open(sorted(photo.rglob("n04552348/*"))[0]).convert("RGB"))
    assert is_detector(f"onnx:{file}")
    detector = load_detector(f"onnx:{file}", device="cpu")
    first, again = detector.detect([image, np.ascontiguousarray(image[:, ::-1])])
    assert detector.labels[first.classes[0]] == "airplane" and first.scores[0] > 0.6
    assert np.all(first.boxes >= 0) and np.all(first.boxes <= image.shape[0])
    mirrored = first.boxes[0][[2, 1, 0, 3]] * [-1, 1, -1, 1] + [image.shape[1], 0, image.shape[1], 0]
    assert box_iou(again.boxes[:3], mirrored).max() > 0.7


@needs_shared
def test_its_loss_has_the_gradient_of_finite_differences():
    from toolkit.models.load_detector import load_detector

    detector = load_detector(f"onnx:{SHARED / 'detectors/yolox_nano.onnx'}", device="cpu")
    index = detector_class(detector, "warplane")
    assert detector.labels[index] == "airplane" and detector.labels[detector_class(detector, "Car")] == "car"
    image = torch.rand(1, 3, 416, 416, generator=torch.Generator().manual_seed(0)).requires_grad_()
    boxes = torch.tensor([[100.0, 120.0, 300.0, 260.0]])
    gradient = torch.autograd.grad(detector.losses(image, boxes, index).sum(), image)[0]
    along, step = gradient / gradient.norm(), 0.002
    with torch.no_grad():
        ends = [detector.losses(image + sign * step * along, boxes, index).double() for sign in (1, -1)]
    assert float((ends[0] - ends[1]) / (2 * step)) == pytest.approx(float(gradient.norm()), rel=0.05)


@needs_shared
def test_detector_and_classifier_are_not_taken_for_each_other():
    from toolkit.models.load import load_classifier
    from toolkit.models.load_detector import is_detector, load_detector

    line = error_of(lambda: load_classifier(f"onnx:{SHARED / 'detectors/yolox_nano.onnx'}", device="cpu"))
    assert "gives 2×3549×85 for 2 images: expected 2×classes (a detector? 'toolkit eval' takes" in line
    network = f"onnx:{next((SHARED / 'networks').glob('*.onnx'))}"
    assert not is_detector(network)
    line = error_of(lambda: load_detector(network, device="cpu"))
    assert "gives 2×1000 for 2 images" in line and "it looks like a classifier" in line
    line = error_of(lambda: load_classifier("torchvision:fasterrcnn_resnet50_fpn", device="cpu"))
    assert "is a detector" in line
    assert "expected onnx:FILE or a name of torchvision" in error_of(lambda: load_detector("resnet18"))


@needs_shared
def test_labels_of_another_number_in_one_line(tmp_path):
    from toolkit.models.load_detector import load_detector

    file = tmp_path / "net.onnx"
    file.write_bytes((SHARED / "detectors/fastestdet.onnx").read_bytes())
    file.with_suffix(".toml").write_text('labels = ["plane", "car"]')
    assert "each of the 80 outputs" in error_of(lambda: load_detector(f"onnx:{file}", device="cpu"))
    file.with_suffix(".toml").write_text('decoder = "yolox"')
    assert "which is not a yolox" in error_of(lambda: load_detector(f"onnx:{file}", device="cpu"))
    file.with_suffix(".toml").write_text('decoder = "ssd"')
    assert "field 'decoder'" in error_of(lambda: load_detector(f"onnx:{file}", device="cpu"))


def test_torchvisions_detectors_answer_as_themselves(tmp_path):
    import torchvision

    from toolkit.models.load_detector import is_detector, load_detector

    name = "ssdlite320_mobilenet_v3_large"
    torch.manual_seed(0)
    module = torchvision.models.get_model(name, weights=None, weights_backbone=None, num_classes=91).eval()
    torch.save(module.state_dict(), tmp_path / "ssd.pth")
    assert is_detector(f"torchvision:{name}") and is_detector(name) and not is_detector("resnet18")
    detector = load_detector(f"torchvision:{name}", tmp_path / "ssd.pth", "cpu")
    image = np.random.default_rng(0).integers(0, 256, (90, 120, 3), np.uint8)
    with torch.no_grad():
        expected = module([torch.from_numpy(image).permute(2, 0, 1) / 255])[0]
    seen = detector.detect([image])[0]
    assert len(seen) > 0 and np.allclose(seen.scores, expected["scores"][: len(seen)], atol=1e-5)
    assert np.allclose(seen.boxes, expected["boxes"][: len(seen)], atol=1e-3)
    assert detector.labels[detector_class(detector, "airliner")] == "airplane"
    batch = torch.rand(2, 3, 96, 96, requires_grad=True)
    losses = detector.losses(batch, torch.tensor([[10.0, 10.0, 60.0, 60.0]] * 2), 5)
    assert losses.shape == (2,) and torch.autograd.grad(losses.sum(), batch)[0].abs().max() > 0
    assert not detector.module.training


class Oracle:
    """Sees the dark square of an image as a car, with the score that its brightness has."""

    name, arch, labels, device, untrainable, image_px = "oracle", "oracle", ["cup", "car"], "cpu", "", 0
    weights = WeightsFile(Path("oracle.pth"), "ab" * 32, "oracle.pth")

    def __init__(self, boxes):
        self.boxes, self.asked = boxes, 0

    def detect(self, images):
        found = []
        for _ in images:
            box, index, score = self.boxes[self.asked]
            self.asked += 1
            found.append(Detections(np.array([box], np.float32), np.array([index]), np.array([score], np.float32)))
        return found


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    """A workspace with one box of a `racer`, shot bare from three sides, and the same files as `patched`."""
    import shutil

    import trimesh

    from toolkit.captures.shoot import shoot_plan
    from toolkit.cli import app
    from toolkit.core.workspace import make_workspace, open_workspace
    from toolkit.rig.plan import read_plan

    root = tmp_path_factory.mktemp("space")
    make_workspace(root)
    trimesh.creation.box((200, 120, 80)).export(root / "rig/objects/crate.obj")
    (root / "rig/objects/crate.toml").write_text('class = "racer"\nmesh = "crate.obj"\nlength_mm = 200\n')
    words = ["plan", "--object", "crate", "--count", "3", "--resolution", "160", "120", "--workspace", str(root)]
    assert CliRunner().invoke(app, words).exit_code == 0
    space = open_workspace(root)
    shoot_plan(space, read_plan(space.plan_file), ["crate"], ["unpatched"])
    source = root / "captures/sim"
    lines = (source / "manifest.jsonl").read_text()
    shutil.copytree(source / "crate/unpatched", source / "crate/patched")
    boosted = lines.replace("unpatched", "patched").replace(
        '"booster_sha256": null', f'"booster_sha256": "{"ab" * 32}"'
    )
    (source / "manifest.jsonl").write_text(lines + boosted)
    return space


def test_the_mask_is_that_of_the_projected_corners(shot):
    import cv2

    from toolkit.captures.manifest import read_manifest
    from toolkit.captures.read import read_captures
    from toolkit.captures.truth import outline_captures
    from toolkit.objects.load import load_object

    captures = read_captures(shot.captures_dir).captures
    masks, unknown = outline_captures(captures, shot)
    assert not unknown and len(masks) == 6
    corners = load_object(shot.object_specs()["crate"]).mesh.vertices
    records = read_manifest(shot.captures_dir / "sim")
    for one in captures:
        record = records[one.path_in_source]
        pixels = record.camera.project(np.array(record.T_world_camera), corners)
        truth = masks[one.path]
        box = [*pixels.min(0), *pixels.max(0)]
        assert np.abs(np.array(truth.box) - box).max() <= 1
        hull = cv2.convexHull(pixels.astype(np.float32))  # a box is convex
        assert truth.mask.sum() == pytest.approx(cv2.contourArea(hull), rel=0.02)


def test_the_coco_file_is_read_by_pycocotools(shot, tmp_path):
    coco = pytest.importorskip("pycocotools.coco", reason="needs pycocotools: pip install pycocotools")
    from toolkit.captures.read import read_captures
    from toolkit.captures.truth import outline_captures
    from toolkit.cli import app

    file = tmp_path / "instances.json"
    done = CliRunner().invoke(app, ["coco", "--workspace", str(shot.root), "--out", str(file), "--json"])
    assert done.exit_code == 0 and json.loads(done.stdout)["images"] == 6
    data = coco.COCO(str(file))
    masks, _ = outline_captures(read_captures(shot.captures_dir).captures, shot)
    assert [one["name"] for one in data.loadCats(data.getCatIds())] == ["car"]
    from pycocotools import mask as masking

    for number in data.getAnnIds():
        (note,) = data.loadAnns(number)
        truth = masks[data.loadImgs(note["image_id"])[0]["file_name"]]
        assert np.array_equal(data.annToMask(note).astype(bool), truth.mask)
        assert note["area"] == truth.mask.sum() and note["bbox"] == masking.toBbox(data.annToRLE(note)).tolist()


def test_found_and_not_found_are_paired(shot):
    from toolkit.captures.read import read_captures
    from toolkit.captures.truth import outline_captures
    from toolkit.evaluation import EvalConfig
    from toolkit.evaluation.detect import evaluate_detector

    captures = read_captures(shot.captures_dir).captures
    masks, _ = outline_captures(captures, shot)
    boxes = [masks[one.path].box for one in captures]
    aside = (0, 0, 10, 10)
    # patched: found, found, too weak; unpatched: aside, other class, found
    answers = [(boxes[0], 1, 0.9), (boxes[1], 1, 0.6), (boxes[2], 1, 0.1)]
    answers += [(aside, 1, 0.9), (boxes[4], 0, 0.9), (boxes[5], 1, 0.8)]
    assert [one.variant for one in captures] == ["patched"] * 3 + ["unpatched"] * 3
    done = evaluate_detector(shot.captures_dir, shot, Oracle(answers), EvalConfig(run="oracle"))
    found = {one.variant: one for one in done.groups}
    assert (found["patched"].n_found, found["unpatched"].n_found) == (2, 1)
    assert found["patched"].recall50 == 1 and found["unpatched"].recall50 == pytest.approx(1 / 3)
    assert found["patched"].ap50_95 == pytest.approx(1)
    (pair,) = [one for one in done.summary["pairs"] if one["object"] == "crate"]
    assert (pair["n_pairs"], pair["gained"], pair["lost"]) == (3, 2, 1)
    with (done.run_dir / "detections.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["found"] for row in rows] == ["1", "1", "0", "0", "0", "1"] and rows[0]["true_label"] == "car"
    page = (done.run_dir / "report.html").read_text()
    assert page.count("data:image/jpeg") == 6 and "patched found in 2 of 3 poses, unpatched in 1" in page
    again = evaluate_detector(shot.captures_dir, shot, Oracle(answers[::-1]), EvalConfig(run="oracle"))
    assert again.run_dir.name == "oracle-2"


def test_a_booster_of_other_networks_that_hides_the_object_is_said(shot, monkeypatch):
    from toolkit.captures.read import read_captures
    from toolkit.captures.truth import outline_captures
    from toolkit.evaluation import EvalConfig, detect
    from toolkit.evaluation.results import Training
    from toolkit.objects.records import NetworkRecord

    captures = read_captures(shot.captures_dir).captures
    masks, _ = outline_captures(captures, shot)
    boxes = [masks[one.path].box for one in captures]
    networks = (NetworkRecord(arch="resnet18", weights="a.pth", sha256="cd" * 32),)

    def evaluate(scores, seen=False):
        training = Training("sim", "crate", "patched", "crate", "ab" * 32, networks, seen, "racer")
        monkeypatch.setattr(detect, "find_training", lambda *_: (training,))
        oracle = Oracle([(box, 1, score) for box, score in zip(boxes, scores, strict=True)])
        done = detect.evaluate_detector(shot.captures_dir, shot, oracle, EvalConfig(run="lost", replace=True))
        return [note for note in done.notes if "Train it on this detector too" in note]

    # patched three times, unpatched three times
    (note,) = evaluate([0.9, 0.1, 0.1, 0.9, 0.9, 0.1])
    assert "with the patch oracle finds the object in 1 of 3 images, without it in 2" in note
    assert not evaluate([0.9, 0.1, 0.1, 0.9, 0.9, 0.1], seen=True)
    assert not evaluate([0.9, 0.9, 0.1, 0.9, 0.1, 0.1])


def test_what_has_no_box_is_listed(shot, tmp_path):
    import shutil

    from toolkit.evaluation.detect import evaluate_detector

    shutil.copytree(shot.captures_dir / "sim/crate", tmp_path / "captures/photos/crate")
    line = error_of(lambda: evaluate_detector(tmp_path / "captures", shot, Oracle([])))
    assert "no image with a known box" in line and "the manifest has no camera pose" in line
    Oracle.labels = ["cup", "dog"]
    try:
        assert "knows none of the objects" in error_of(lambda: evaluate_detector(shot.captures_dir, shot, Oracle([])))
    finally:
        Oracle.labels = ["cup", "car"]
