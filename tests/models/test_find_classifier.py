"""`--model NAME`: the workspace's classifiers, the bundled one and torchvision's, each with its own weights."""

import json
import shutil
from pathlib import Path

import pytest
import torch
import torchvision
from safetensors.torch import load_file, save_file

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.evaluation.survey import list_models, survey_models
from toolkit.models import find, load
from toolkit.models.find import find_classifier, list_own, pair_weights
from toolkit.models.load import load_best, load_classifier, read_bundled
from toolkit.training import machine
from toolkit.training.classifier_task import halve_weights, summarise_answers

LABELS = ["racer", "warplane", "coffee mug"]


def write_own(folder, name, **changes):
    """A classifier of three classes in the kit's own format, in half precision."""
    torch.manual_seed(len(name))
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.safetensors"
    save_file(halve_weights(torchvision.models.squeezenet1_1(num_classes=3).state_dict()), file)
    record = {
        "schema_version": 1, "name": name, "arch": "squeezenet1_1", "trained_on": "renders of 3 kinds of things",
        "labels": LABELS, "resize_px": 146, "crop_px": 128, "mean": [0.4, 0.5, 0.6], "std": [0.2, 0.2, 0.2],
        "filter_name": "BICUBIC", "data": {}, "seed": 0, "settings": {}, "final": {}, "sha256": sha256_file(file),
        "toolkit_version": "0",
        "held_out": {
            "n": 50, "correct": 45, "accuracy": 0.9, "ci95": [0.78, 0.96], "per_class": {}, "confusions": [],
            "what": "",
        },
    }  # fmt: skip
    file.with_suffix(".json").write_text(json.dumps(record | changes))
    return file


@pytest.fixture
def nothing_bundled(tmp_path, monkeypatch):
    """The folder of bundled classifiers, empty; no weights on this machine, no network."""
    folder = tmp_path / "bundled"
    for module in (find, load):
        monkeypatch.setattr(module, "BUNDLED_DIR", folder)
    monkeypatch.delenv("TOOLKIT_WEIGHTS", raising=False)
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "cache"))

    def no_network(*_, **__):
        raise OSError("Network is unreachable")

    monkeypatch.setattr(torch.hub, "download_url_to_file", no_network)
    return folder


def test_one_of_the_workspace_by_its_name(tmp_path):
    file = write_own(tmp_path, "mine")
    own = load_classifier("mine", device="cpu", folder=tmp_path)
    assert (own.name, own.arch, own.labels, own.is_imagenet) == ("mine", "squeezenet1_1", LABELS, False)
    assert (own.preprocessing.resize_px, own.preprocessing.crop_px) == (146, 128)
    assert own.preprocessing.mean == (0.4, 0.5, 0.6) and own.preprocessing.filter_name == "BICUBIC"
    assert own.describe() == ("mine (squeezenet1_1 trained on renders of 3 kinds of things; 3 classes, not ImageNet's)")
    half = load_file(file)["features.0.weight"]
    assert half.dtype == torch.float16
    assert torch.equal(own.module.features[0].weight, half.float())
    by_file = load_classifier(None, file, "cpu")  # the record tells the network
    batch = torch.rand(1, 3, 128, 128)
    assert torch.equal(by_file.logits(batch), own.logits(batch))
    assert by_file.name == "mine"


def test_without_name_and_weights_it_is_a_resnet():
    assert find_classifier() == find.Found("resnet18", None)
    assert find_classifier("mobilenet_v2") == find.Found("mobilenet_v2", None)


def test_a_plain_state_dict_with_a_labels_file_is_a_resnet_as_before(tmp_path):
    file = tmp_path / "mine.pth"
    torch.save(torchvision.models.resnet18(num_classes=2).state_dict(), file)
    file.with_suffix(".json").write_text('{"labels": ["mug", "bowl"]}')
    classifier = load_classifier(None, file, "cpu")
    assert (classifier.arch, classifier.name, classifier.labels) == ("resnet18", "resnet18", ["mug", "bowl"])
    assert classifier.describe() == "resnet18 (resnet18, mine.pth; 2 classes, not ImageNet's)"


def test_names_and_files_that_do_not_go_together(tmp_path, nothing_bundled):
    file = write_own(tmp_path / "own", "mine")
    folder = file.parent
    with pytest.raises(ToolkitError, match="mine has its own weights: leave one out"):
        load_classifier("mine", file, "cpu", folder=folder)
    with pytest.raises(ToolkitError, match=r"no model called 'mime': did you mean mine\?"):
        load_classifier("mime", device="cpu", folder=folder)
    with pytest.raises(ToolkitError, match=r"model rig18: .*rig18\.safetensors is missing from this installation"):
        load_classifier("rig18", device="cpu", folder=folder)
    file.with_suffix(".json").unlink()
    with pytest.raises(ToolkitError, match=r"no record mine\.json with the field 'arch' beside it"):
        load_classifier("mine", device="cpu", folder=folder)


def test_files_of_weights_go_to_the_networks_that_bring_none(tmp_path, nothing_bundled):
    mine, graph = write_own(tmp_path, "mine"), tmp_path / "net.onnx"
    graph.touch()
    names, files = ["resnet18", f"onnx:{graph}", "mine", "timm:edgenext_small"], [Path("a.pth"), Path("b.pth")]
    assert pair_weights(names, files, tmp_path) == [
        ("resnet18", files[0]), (names[1], None), ("mine", None), ("timm:edgenext_small", files[1])
    ]  # fmt: skip
    assert pair_weights(names, None, tmp_path) == [(name, None) for name in names]
    assert pair_weights(None, [mine]) == [(None, mine)] and pair_weights(None, None) == [(None, None)]
    assert pair_weights(["mobilenet_v2"], files[:1]) == [("mobilenet_v2", files[0])]
    with pytest.raises(ToolkitError, match=r"4 of model and 3 of weights: expected a file for each of the 2 that"):
        pair_weights(names, [*files, mine], tmp_path)
    with pytest.raises(ToolkitError, match=r"2 of model and 1 of weights: they bring theirs"):
        pair_weights(["mine", "mine"], [mine], tmp_path)
    with pytest.raises(ToolkitError, match=r"no such file"):
        pair_weights(["resnet18", "onnx:nowhere.onnx"], [mine], tmp_path)


def test_weights_that_are_not_the_records(tmp_path):
    file = write_own(tmp_path, "mine")
    shutil.copy(write_own(tmp_path, "other"), file)
    with pytest.raises(ToolkitError, match=r"mine\.safetensors: its hash .* does not match the .* of mine\.json"):
        load_classifier("mine", device="cpu", folder=tmp_path)


def test_the_workspaces_rig18_wins_over_the_bundled_one(tmp_path, nothing_bundled):
    write_own(nothing_bundled, "rig18")
    assert list_own(tmp_path / "own") == {"rig18": nothing_bundled / "rig18.safetensors"}
    own = write_own(tmp_path / "own", "rig18")
    assert find_classifier("rig18", folder=tmp_path / "own").weights == own
    assert find_classifier("rig18").weights == nothing_bundled / "rig18.safetensors"


def test_the_demo_takes_imagenet_where_it_can_and_else_says_so(tmp_path, nothing_bundled, monkeypatch):
    with pytest.raises(ToolkitError, match=r"no weights for resnet18: .*Network is unreachable"):
        load_best("cpu")
    write_own(nothing_bundled, "rig18")
    classifier, why = load_best("cpu")
    assert classifier.name == "rig18" and not classifier.is_imagenet
    assert why == "no weights of resnet18 on this machine, and none could be downloaded"
    assert torch.randn(1).isfinite()
    folder = tmp_path / "weights"
    folder.mkdir()
    torch.save(torchvision.models.resnet18().state_dict(), folder / "resnet18-random.pth")
    monkeypatch.setenv("TOOLKIT_WEIGHTS", str(folder))
    classifier, why = load_best("cpu")
    assert classifier.is_imagenet and classifier.name == "resnet18" and "on this machine" in why
    assert classifier.describe() == "resnet18 (ImageNet's 1000 classes, weights resnet18-random.pth)"


def test_the_doctor_names_the_bundled_classifier(nothing_bundled):
    assert read_bundled() is None
    assert machine._bundled().state == "note"
    file = write_own(nothing_bundled, "rig18")
    check = machine._bundled()
    assert check.state == "ok" and "not ImageNet, 90% of 50 held-out images correct" in check.found
    file.write_bytes(b"changed")
    check = machine._bundled()
    assert check.state == "missing" and "does not match its record" in check.found


def test_half_precision_keeps_what_it_cannot_hold():
    state = {"a": torch.tensor([1.0, 0.1]), "b": torch.tensor([1e6]), "n": torch.tensor(3)}
    halved = halve_weights(state)
    assert (
        halved["a"].dtype == torch.float16 and halved["b"].dtype == torch.float32 and halved["n"].dtype == torch.int64
    )
    assert float(halved["b"]) == 1e6


def test_answers_are_counted():
    import numpy as np

    held_out = summarise_answers(["a", "b"], np.array([0, 0, 0, 1]), np.array([0, 1, 1, 1]), "")
    assert (held_out.n, held_out.correct, held_out.accuracy) == (4, 2, 0.5)
    assert {name: (one.n, one.correct) for name, one in held_out.per_class.items()} == {"a": (3, 1), "b": (1, 1)}
    assert held_out.confusions == [("a", "b", 2)]
    assert summarise_answers(["a", "b"], np.zeros(0, int), np.zeros(0, int), "").accuracy is None


@pytest.fixture
def ran(tmp_path, monkeypatch):
    """A file that is there once `evil.py` of the current folder was imported."""
    (tmp_path / "evil.py").write_text("open('ran', 'w').close()\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "ran"


@pytest.mark.parametrize("arch", ["python:evil:boom", "torchvision:python:evil:boom"])
@pytest.mark.parametrize("suffix", [".json", ".toml"])
def test_a_file_beside_weights_names_no_code(tmp_path, ran, arch, suffix):
    file = tmp_path / "own" / "mine.safetensors"
    file.parent.mkdir()
    save_file({"fc.weight": torch.zeros(2, 2)}, file)
    said = {".json": json.dumps({"arch": arch}), ".toml": f'architecture = "{arch}"'}
    file.with_suffix(suffix).write_text(said[suffix])
    expected = rf"mine{suffix}: field 'arch(itecture)?': a file may not name code, .*, found \"{arch}\": correct"
    for model, weights in (("mine", None), (str(file), None), (None, file)):
        with pytest.raises(ToolkitError, match=expected):
            load_classifier(model, weights, "cpu", file.parent)
    (row,) = survey_models(["mine"], "cpu", file.parent)
    assert row.classes is None and "a file may not name code" in row.why_not
    assert not ran.exists()


@pytest.mark.parametrize("suffix", (*find.SUFFIXES, ".pt2", ".onnx"))
def test_the_name_of_a_file_is_no_code(tmp_path, ran, nothing_bundled, suffix):
    folder = tmp_path / "own"
    folder.mkdir()
    file = folder / f"python:evil:boom{suffix}"
    file.write_bytes(b"no weights")
    (row,) = survey_models(list_models(folder), "cpu", folder)
    assert row.model == str(file) and row.why_not
    with pytest.raises(ToolkitError):
        load_classifier(str(file), device="cpu")
    assert not ran.exists()
