"""Detectors told by the shapes of their outputs, against a decode written down here in NumPy."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from one_line import error_of
from tiny_detectors import CLASSES, LABELS, PLACES, SIDE, write_detector

from toolkit.models.decoders import DECODERS, decode_end2end, guess_decoder, published_labels
from toolkit.models.detector import box_iou
from toolkit.models.load_detector import is_detector, load_detector

onnxruntime = pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install '.[onnx]'")
pytestmark = pytest.mark.usefixtures("forked_trials")
SHARED = Path(__file__).parents[2].parent / "shared"
ULTRALYTICS = sorted((SHARED / "detectors/ultralytics").glob("*.onnx"))


def ask(file, square, mean=0.0, std=1.0):
    """What ONNX Runtime itself says of one (side, side, 3) uint8 square."""
    session = onnxruntime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    pixels = ((square.astype(np.float32) / 255 - mean) / std).transpose(2, 0, 1)[None].astype(np.float32)
    return session.run(None, {"images": pixels})


def letterbox(image, side):
    """Ultralytics' own: the picture in the middle, grey of 114 round it; and how it lies."""
    height, width = image.shape[:2]
    gain = min(side / height, side / width)
    wide, high = round(width * gain), round(height * gain)
    left, top = round((side - wide) / 2 - 0.1), round((side - high) / 2 - 0.1)
    small = cv2.resize(image, (wide, high), interpolation=cv2.INTER_LINEAR)
    border = (top, side - high - top, left, side - wide - left)
    return cv2.copyMakeBorder(small, *border, cv2.BORDER_CONSTANT, value=(114,) * 3), gain, left, top


def suppress(boxes, scores, classes, most_iou):
    order, kept = np.argsort(-scores, kind="stable"), []
    for k in order:
        same = [j for j in kept if classes[j] == classes[k]]
        if not same or box_iou(boxes[same], boxes[k]).max() <= most_iou:
            kept.append(k)
    return kept


def decode(outputs, family, side, least=0.0):
    """Boxes, scores from `least` on and classes in the square's pixels, by falling score."""
    if family == "yolov8":
        rows = outputs[0][0].T
        x, y, w, h = rows[:, :4].T
        boxes, scores = np.stack([x - w / 2, y - h / 2, x + w / 2, y + h / 2], 1), rows[:, 4:]
    elif family == "detr":
        x, y, w, h = outputs[1][0].T * side
        boxes, scores = np.stack([x - w / 2, y - h / 2, x + w / 2, y + h / 2], 1), 1 / (1 + np.exp(-outputs[0][0]))
    else:
        rows = outputs[0][0]
        return rows[:, :4], rows[:, 4], rows[:, 5].astype(int)
    sure = scores.max(1) >= least  # a box suppresses none that is surer
    boxes, scores = boxes[sure], scores[sure]
    best, classes = scores.max(1), scores.argmax(1)
    kept = suppress(boxes, best, classes, 0.7) if family == "yolov8" else np.argsort(-best)
    return boxes[kept], best[kept], classes[kept]


def picture(height=20, width=30, seed=1):
    rng = np.random.default_rng(seed)
    return cv2.resize(rng.integers(0, 256, (5, 5, 3), np.uint8), (width, height), interpolation=cv2.INTER_CUBIC)


@pytest.mark.parametrize("family", ["yolov8", "end2end", "detr"])
def test_a_graph_is_known_by_its_shape_and_read_as_numpy_reads_it(tmp_path, family):
    file = write_detector(tmp_path / "net.onnx", family)
    assert is_detector(f"onnx:{file}")
    detector, image = load_detector(f"onnx:{file}", device="cpu"), picture()
    assert detector.decoder.family == family and detector.labels == LABELS
    if family == "detr":  # these are trained on stretched pictures
        square, gains, corner = cv2.resize(image, (SIDE, SIDE)), (SIDE / 30, SIDE / 20), (0, 0)
    else:
        square, gain, left, top = letterbox(image, SIDE)
        gains, corner = (gain, gain), (left, top)
    boxes, scores, classes = decode(ask(file, square), family, SIDE)
    boxes = ((boxes.reshape(-1, 2, 2) - corner) / gains).reshape(-1, 4).clip(0, [30, 20, 30, 20])
    found, _ = detector.detect([image, picture(seed=2)])
    assert len(found) == len(scores) > 1
    assert np.allclose(found.scores, scores, atol=1e-5) and found.classes.tolist() == classes.tolist()
    assert np.allclose(found.boxes, boxes, atol=1e-3)


@pytest.mark.parametrize("family", ["yolov8", "end2end", "detr"])
def test_its_gradient_is_that_of_finite_differences(tmp_path, family):
    pytest.importorskip("onnx2torch", reason="needs onnx2torch: pip install '.[onnx]'")
    detector = load_detector(f"onnx:{write_detector(tmp_path / 'net.onnx', family)}", device="cpu")
    assert not detector.untrainable
    image = torch.rand(2, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(0)).requires_grad_()

    def measure(batch):
        boxes, scores = detector.predict(batch)
        return (scores[..., 1].log() + 0.1 * boxes.sum(-1)).sum()

    gradient = torch.autograd.grad(measure(image), image)[0]
    along, step = gradient / gradient.norm(), 1e-2
    with torch.no_grad():
        ends = [measure(image + sign * step * along).double() for sign in (1, -1)]
    assert float((ends[0] - ends[1]) / (2 * step)) == pytest.approx(float(gradient.norm()), rel=0.02)


@pytest.mark.parametrize("family", ["yolov8", "end2end", "detr"])
def test_steps_along_its_loss_make_the_object_found(tmp_path, family):
    pytest.importorskip("onnx2torch", reason="needs onnx2torch: pip install '.[onnx]'")
    detector = load_detector(f"onnx:{write_detector(tmp_path / 'net.onnx', family)}", device="cpu")
    place, image = torch.tensor([[6.0, 6.0, 26.0, 26.0]]), torch.full((1, 3, SIDE, SIDE), 0.5)
    losses = []
    for _ in range(60):
        image.requires_grad_()
        loss = detector.losses(image, place, 1).sum()
        gradient = torch.autograd.grad(loss, image)[0]
        losses.append(float(loss))
        image = (image.detach() - 0.02 * gradient.sign()).clamp(0, 1)
    pixels = image[0].permute(1, 2, 0).mul(255).round().byte().numpy()
    (seen,) = detector.detect([pixels])
    assert losses[-1] < losses[0] - 0.5
    assert max(seen.scores[seen.classes == 1]) > 0.9


def test_a_selecting_graph_is_trained_on_all_its_places(tmp_path):
    pytest.importorskip("onnx2torch", reason="needs onnx2torch: pip install '.[onnx]'")
    detector = load_detector(f"onnx:{write_detector(tmp_path / 'net.onnx', 'end2end')}", device="cpu")
    boxes, scores = detector.predict(torch.rand(2, 3, SIDE, SIDE))
    assert boxes.shape == (2, PLACES, 4) and scores.shape == (2, PLACES, CLASSES)
    seen = detector.detect([picture(SIDE, SIDE)])[0]
    pixels = torch.from_numpy(picture(SIDE, SIDE)).permute(2, 0, 1)[None].float() / 255
    assert detector.predict(pixels)[1].max().item() == pytest.approx(float(seen.scores[0]), abs=1e-5)


def test_the_toml_says_how_pictures_are_fitted(tmp_path):
    file = write_detector(tmp_path / "net.onnx", "yolov8")
    file.with_suffix(".toml").write_text(
        f'labels = {LABELS}\nletterbox = "corner"\nfill = 0\nchannels = "BGR"\nmean = [0.1, 0.1, 0.1]\n'
        "std = [0.5, 0.5, 0.5]"
    )
    detector, image = load_detector(f"onnx:{file}", device="cpu"), picture(20, 32)
    assert detector.decoder.describe().endswith("BGR, letterbox corner, fill 0")
    square = np.zeros((SIDE, SIDE, 3), np.uint8)
    square[:20] = image[..., ::-1]
    boxes, scores, _ = decode(ask(file, square, 0.1, 0.5), "yolov8", SIDE)
    found = detector.detect([image])[0]
    assert np.allclose(found.scores, scores, atol=1e-5)
    assert np.allclose(found.boxes, boxes.clip(0, [32, 20, 32, 20]), atol=1e-3)
    file.with_suffix(".toml").write_text('letterbox = "left"')
    assert "field 'letterbox'" in error_of(lambda: load_detector(f"onnx:{file}", device="cpu"))


def test_shapes_that_mean_no_detector():
    assert guess_decoder([(1, 84, 8400)], 640) == "yolov8" and guess_decoder([(None, 84, None)], None) == "yolov8"
    assert guess_decoder([(1, 300, 6)], 640) == "end2end" and guess_decoder([(1, 8400, 85)], 640) == "yolox"
    assert guess_decoder([(1, 8400, 6)], 640) == "yolox"  # of one class
    assert guess_decoder([(1, 300, 4), (1, 300, 91)], 560) == "detr"
    for shapes in (
        [(1, 1000)],
        [(1, 116, 8400), (1, 32, 160, 160)],
        [(1, 25200, 85)],
        [(1, 8400, 4), (1, 8400, 80)],
        [],
    ):
        assert guess_decoder(shapes, 640) is None
    assert published_labels(91)[1] == "person" and published_labels(91)[90] == "toothbrush"
    assert {one.family for one in DECODERS.values()} == set(DECODERS)


def test_a_class_without_a_name_in_one_line(tmp_path):
    rows = torch.tensor([[[0.0, 0, 9, 9, 0.9, 2], [0, 0, 9, 9, 0, -1]]])
    assert decode_end2end(rows, SIDE, 3)[1][0].tolist() == [[0, 0, pytest.approx(0.9)], [0, 0, 0]]
    assert "gives class 2, and its labels name 2" in error_of(lambda: decode_end2end(rows, SIDE, 2))
    file = write_detector(tmp_path / "net.onnx", "yolov8")
    file.with_suffix(".toml").write_text('labels = ["cup"]')
    assert "each of the 3 outputs" in error_of(lambda: load_detector(f"onnx:{file}", device="cpu"))
    file.with_suffix(".toml").write_text('decoder = "detr"')
    assert "gives 2×7×21 for 2 images of 32 px, which is not a detr: expected b×21×(5 + classes) of YOLOX" in (
        error_of(lambda: load_detector(f"onnx:{file}", device="cpu"))
    )


MINE = """
import torch

class Net(torch.nn.Module):
    def forward(self, x):
        level = x.mean((2, 3))[:, :, None]
        box = torch.tensor([8.0, 8.0, 8.0, 8.0]).view(1, 4, 1).expand(len(x), 4, 21)
        return torch.cat([box, level.expand(-1, 3, 21)], 1)

def seeker():
    return Net(), {"size": 32, "decoder": "yolov8", "labels": ["red", "green", "blue"]}

def wrong():
    return torch.nn.Flatten(), {"size": 32, "decoder": "yolov8"}
"""


def test_a_function_of_ones_own_is_a_detector_where_it_names_a_decoder(tmp_path, monkeypatch):
    (tmp_path / "my_seekers.py").write_text(MINE)
    monkeypatch.chdir(tmp_path)
    assert is_detector("python:my_seekers:seeker")
    detector = load_detector("python:my_seekers:seeker", device="cpu")
    image = np.zeros((32, 32, 3), np.uint8)
    image[..., 1] = 204
    (found,) = detector.detect([image])
    assert detector.labels[found.classes[0]] == "green" and found.scores[0] == pytest.approx(0.8)
    assert found.boxes.tolist() == [[4, 4, 12, 12]] and detector.arch == "python:my_seekers:seeker"
    assert "gives 2×3072" in error_of(lambda: load_detector("python:my_seekers:wrong", device="cpu"))


@pytest.mark.skipif(not ULTRALYTICS, reason="needs ../shared/detectors/ultralytics")
@pytest.mark.parametrize("file", ULTRALYTICS, ids=lambda file: file.stem)
def test_it_finds_what_its_float_graph_finds_by_a_reference_decode(file):
    from PIL import Image

    assert is_detector(f"onnx:{file}")
    detector = load_detector(f"onnx:{file}", device="cpu")
    assert not detector.untrainable
    photos = sorted((SHARED / "images/nips2017").rglob("*.jpg"))[::90][:6]
    family, total, found, ours_total = detector.decoder.family, 0, 0, 0
    for photo in photos:
        image = np.asarray(Image.open(photo).convert("RGB"))[:220]  # no square
        square, gain, left, top = letterbox(image, 640)
        boxes, scores, classes = decode(ask(file, square), family, 640, 0.25)
        sure = scores >= 0.25
        boxes = (boxes[sure] - [left, top, left, top]) / gain
        ours = detector.detect([image])[0]
        ours_total += int((ours.scores >= 0.25).sum())
        for box, kind in zip(boxes, classes[sure], strict=True):
            same = ours.boxes[(ours.classes == kind) & (ours.scores >= 0.25)]
            total, found = total + 1, found + bool(len(same) and box_iou(same, box).max() >= 0.5)
    assert total >= 5 and found >= 0.9 * total and ours_total <= total / 0.9
