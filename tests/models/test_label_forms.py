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
    "from one": {"1": "bracket", "2": "bolt", "3": "washer"},
    "class_to_idx from one": {"class_to_idx": {"washer": 3, "bolt": 2, "bracket": 1}},
    "coco": {"categories": [{"id": 7, "name": "washer"}, {"id": 1, "name": "bracket"}, {"id": 3, "name": "bolt"}]},
    "named": [{"name": "bracket"}, {"name": "bolt"}, {"name": "washer"}],
    "idx2label": {"idx2label": {"1": "bracket", "2": "bolt", "3": "washer"}},
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


@pytest.mark.parametrize(
    "text",
    [
        "0 bracket\n1 bolt\n2 washer\n", "2: washer\n0: bracket\n1: bolt\n", "1,bracket\n2,bolt\n3,washer\n",
        "n01440764 bracket\nn01443537 bolt\nn01484850 washer\n",
        "bolt 1\nwasher 2\nbracket 0\n", "bracket,1\nbolt,2\nwasher,3\n",
    ],
)  # fmt: skip
def test_numbers_and_ids_beside_the_names_of_a_text_are_left_out(tmp_path, text):
    (tmp_path / "mine.txt").write_text(text)
    assert read_labels_file(tmp_path / "mine.pth").labels == NAMES


@pytest.mark.parametrize(
    "text",
    [
        "1 cent\n2 cent\n",
        "0 bracket\nbolt\n",
        "7: a\n9: b\n",
        "digit 0\ndigit 1\n",
        "area 1\nzone 2\n",
        "Boeing 707\nA 320\n",
    ],
)
def test_names_with_a_number_stay(tmp_path, text):
    (tmp_path / "mine.txt").write_text(text)
    assert read_labels_file(tmp_path / "mine.pth").labels == text.splitlines()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("mine.json", '{"0": "bracket", "2": "washer"}', "the 2 keys from 0 to 2 leave gaps"),
        ("mine.json", '{"classes": {"a": "x"}}', "field 'classes' is no list of names"),
        ("mine.json", '{"meta": {"categories": [1, 2]}}', "field 'categories' is no list of names"),
        ("mine.txt", "\n", "mine.txt is empty: expected the name of a class on each line"),
        ("mine.yaml", "names: [a, b]", r"mine\.yaml is not read: put the names.*lines of mine\.txt"),
        ("mine.csv", "0,a", r"mine\.csv is not read"),
    ],
)
def test_labels_that_are_there_and_cannot_be_used_are_an_error(tmp_path, name, content, words):
    (tmp_path / name).write_text(content)
    with pytest.raises(ToolkitError, match=words) as caught:
        read_labels_file(tmp_path / "mine.pth")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content"),
    [("mine.yaml", "lr: 0.1\nepochs: 3\n"), ("mine.csv", "epoch,loss,top1\n1,0.5,0.2\n2,0.4,0.3\n")],
)
def test_settings_and_logs_of_the_training_are_no_labels(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    assert read_labels_file(tmp_path / "mine.pth").labels is None


def test_a_description_and_a_text_of_names_go_together(tmp_path):
    (tmp_path / "mine.txt").write_text("\n".join(NAMES))
    (tmp_path / "mine.json").write_text('{"crop_px": 200}')
    found = read_labels_file(tmp_path / "mine.pth")
    assert (found.labels, found.crop_px) == (NAMES, 200)
    (tmp_path / "mine.json").write_text('["a", "b", "c"]')
    with pytest.raises(ToolkitError, match=r"mine\.json and .*mine\.txt both name the classes of mine\.pth"):
        read_labels_file(tmp_path / "mine.pth")


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
    with pytest.raises(ToolkitError, match=r"mine\.json: field 'labels': expected a name for each of the 3 outputs"):
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


@pytest.fixture
def weights(tmp_path):
    torch.save(torchvision.models.squeezenet1_1(num_classes=3).state_dict(), tmp_path / "mine.pth")
    return tmp_path / "mine.pth"


@pytest.mark.parametrize(
    "text",
    [
        "{0: 'bracket',\n 1: 'bolt',\n 2: 'washer'}\n",
        '["bracket", "bolt", "washer"]',
        "['bracket',\n'bolt',\n'washer']",
    ],
)
def test_a_list_that_was_printed_is_read(weights, text):
    weights.with_suffix(".txt").write_text(text)
    assert load_classifier("squeezenet1_1", weights, "cpu").labels == NAMES


def test_a_printed_list_that_is_none_is_one_line(weights):
    weights.with_suffix(".txt").write_text("{0: 'bracket', 1: print('x')}")
    with pytest.raises(ToolkitError, match=r"mine\.txt: expected the name of a class on each line"):
        load_classifier("squeezenet1_1", weights, "cpu")


def test_a_byte_order_mark_before_json_is_passed_over(weights):
    weights.with_suffix(".json").write_bytes(b"\xef\xbb\xbf" + json.dumps(NAMES).encode())
    assert load_classifier("squeezenet1_1", weights, "cpu").labels == NAMES


@pytest.mark.parametrize(
    "name",
    ["labels.txt", "classes.txt", "class_names.json", "mine.pth.txt", "mine_labels.txt", "mine.pbtxt", "mine.csv"],
)
def test_names_in_another_file_are_refused_where_there_are_no_others(weights, name):
    (weights.parent / name).write_text("id,name\n0,big bracket\n1,bolt\n2,washer\n")
    with pytest.raises(ToolkitError, match=rf"{name} is not read.*mine\.txt"):
        load_classifier("squeezenet1_1", weights, "cpu")
    weights.with_suffix(".json").write_text(json.dumps(NAMES))
    assert load_classifier("squeezenet1_1", weights, "cpu").labels == NAMES


def test_other_files_beside_weights_are_no_labels(weights):
    for name in (
        "mine.json",
        "config.json",
        "readme.txt",
        "mine.log",
        "other.pth",
        "notes_labels.md",
        "mine-labels.pth",
    ):
        (weights.parent / name).write_text("{}")
    assert load_classifier("squeezenet1_1", weights, "cpu").labels == ["class 0", "class 1", "class 2"]
