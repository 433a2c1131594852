"""Labels in the forms that people have them, and files that are no weights said for what they are."""

import json

import pytest
import torch
import torchvision
from typer.testing import CliRunner

from toolkit.core.errors import ToolkitError
from toolkit.models.labels import find_labels, read_labels_file
from toolkit.models.load import load_classifier

NAMES = ["bracket", "bolt", "washer"]
FORMS = {
    "list": NAMES,
    "indices": {"0": "bracket", "2": "washer", "1": "bolt"},
    "keras": {"0": ["n01", "bracket"], "1": ["n02", "bolt"], "2": ["n03", "washer"]},
    "fields": {"labels": NAMES, "crop_px": 200},
    "classes": {"classes": NAMES, "resize_px": 240},
    "class_to_idx": {"class_to_idx": {"washer": 2, "bolt": 1, "bracket": 0}},
    "to_idx": {"washer": 2, "bolt": 1, "bracket": 0},
    "id2label": {"id2label": {"0": "bracket", "1": "bolt", "2": "washer"}, "model_type": "vit"},
    "torchvision": {"meta": {"categories": NAMES, "num_params": 3}},
}


@pytest.fixture(scope="module")
def state():
    torch.manual_seed(0)
    return torchvision.models.squeezenet1_1(num_classes=3).state_dict()


def load(file):
    return load_classifier("squeezenet1_1", file, "cpu")


@pytest.mark.parametrize("form", FORMS)
def test_json_beside_the_weights(tmp_path, form):
    (tmp_path / "mine.json").write_text(json.dumps(FORMS[form]))
    found = read_labels_file(tmp_path / "mine.pth")
    assert found.labels == NAMES
    assert (found.crop_px, found.resize_px) == (
        200 if form == "fields" else None, 240 if form == "classes" else None
    )  # fmt: skip


def test_a_text_file_and_gaps_that_are_no_labels(tmp_path):
    (tmp_path / "mine.txt").write_text("\ufeffbracket\nbolt\n\n washer \n", encoding="utf-8")
    assert read_labels_file(tmp_path / "mine.pth").labels == NAMES
    assert find_labels({"0": "bracket", "2": "washer"}) is None
    assert find_labels({"epoch": 3, "best": 0.5}) is None and find_labels([]) is None


@pytest.mark.parametrize("wrap", ["classes", "class_to_idx", "meta"])
def test_inside_a_checkpoint(tmp_path, state, wrap):
    labels = {
        "classes": {"classes": NAMES},
        "class_to_idx": {"class_to_idx": {name: i for i, name in enumerate(NAMES)}},
        "meta": {"meta": {"categories": NAMES}},
    }
    torch.save({"state_dict": state, "epoch": 7, **labels[wrap]}, tmp_path / "mine.pth")
    assert load(tmp_path / "mine.pth").labels == NAMES
    (tmp_path / "mine.json").write_text('["a", "b", "c"]')
    assert load(tmp_path / "mine.pth").labels == ["a", "b", "c"]  # the file beside it counts first
    (tmp_path / "mine.json").write_text('["a", "b"]')
    with pytest.raises(ToolkitError, match=r"mine\.json: field 'labels': expected 3 names"):
        load(tmp_path / "mine.pth")


def test_a_network_needs_no_labels_to_be_weights(tmp_path, state):
    torch.save(state, tmp_path / "mine.pth")
    assert load(tmp_path / "mine.pth").labels == ["class 0", "class 1", "class 2"]


def refuse(file) -> str:
    with pytest.raises(ToolkitError) as caught:
        load(file)
    line = str(caught.value)
    assert "\n" not in line and "damaged" not in line
    assert "torch.save(model.state_dict(), 'NEW.pth')" in line
    return line


def test_programs_are_called_what_they_are(tmp_path):
    class Doubled(torch.nn.Module):
        def forward(self, x):
            return 2 * x

    torch.jit.script(Doubled()).save(str(tmp_path / "script.pt"))
    assert "is a TorchScript archive" in refuse(tmp_path / "script.pt")
    torch.save(torchvision.models.squeezenet1_1(num_classes=3), tmp_path / "module.pth")
    line = refuse(tmp_path / "module.pth")
    assert "a pickled module or other objects (torchvision.models.squeezenet.SqueezeNet)" in line
    for name, words in (("net.onnx", "an ONNX graph"), ("net.pt2", "a program of torch.export")):
        (tmp_path / name).write_bytes(b"x")
        assert words in refuse(tmp_path / name)


def test_the_command_line_names_its_flag(tmp_path):
    from toolkit.cli import app

    (tmp_path / "net.onnx").write_bytes(b"x")
    (tmp_path / "sim" / "mug" / "patched").mkdir(parents=True)
    (tmp_path / "sim" / "mug" / "patched" / "1.png").write_bytes(b"looked at later")
    result = CliRunner().invoke(app, ["eval", str(tmp_path), "--weights", str(tmp_path / "net.onnx")])
    assert "and name its network with --model" in str(result.exception)


@pytest.mark.parametrize("where", ["json", "txt", "toml", "checkpoint"])
def test_a_label_of_very_many_letters_is_a_line(tmp_path, state, where):
    names = ["bracket", "x" * 100_000, "washer"]
    torch.save({"state_dict": state} | ({"classes": names} if where == "checkpoint" else {}), tmp_path / "mine.pth")
    text = {"json": json.dumps(names), "txt": "\n".join(names), "toml": f"labels = {json.dumps(names)}"}
    if where in text:
        (tmp_path / f"mine.{where}").write_text(text[where])
    with pytest.raises(ToolkitError, match=r"mine\..*'labels\.1': expected a class of at most 1000 letters") as said:
        load(tmp_path / "mine.pth")
    assert len(str(said.value)) < 400
