"""`--model set:NAME`: networks that boosters are trained on together, by one name."""

import json

import pytest
from hue_network import make_hue_classifier

from toolkit.core.errors import ToolkitError
from toolkit.models.find import SETS_DIR, expand_sets, find_classifier, read_set


def write_set(folder, **changes):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "several.json").write_text(json.dumps({"name": "several", "networks": ["resnet18", "two"]} | changes))


def test_the_built_in_set_is_read_and_names_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setenv("TOOLKIT_WEIGHTS", str(tmp_path))
    found = read_set("set:imagenet-small", None)
    assert found is not None and len(found.networks) == 8 and found.networks.count("resnet50") == 1
    assert all(read_set(f"set:{file.stem}", None) for file in SETS_DIR.glob("*.json"))
    missing = "mobilenet_v2_slim_224.onnx, mobilenet_v1_0.75_192.onnx, efficientnet_lite3_280.onnx"
    with pytest.raises(ToolkitError, match=f"set:imagenet-small: is without {missing}: put the files into"):
        expand_sets(["set:imagenet-small"], None)
    for name in missing.split(", "):
        (tmp_path / name).write_bytes(b"")
    names = [name for name, _ in expand_sets(["set:imagenet-small", "rig18"], None)]
    assert f"onnx:{tmp_path}/mobilenet_v1_0.75_192.onnx" in names and names[-1] == "rig18" and len(names) == 9


def test_a_set_of_the_workspace_has_turns_and_goes_first(tmp_path, monkeypatch):
    monkeypatch.delenv("TOOLKIT_WEIGHTS", raising=False)
    write_set(tmp_path, turns={"resnet18": 3})
    (tmp_path / "two.onnx").write_bytes(b"")
    assert expand_sets(["set:several"], tmp_path) == expand_sets(["several"], tmp_path) == [("resnet18", 3), ("two", 1)]
    (tmp_path / "several.json").rename(tmp_path / "imagenet-small.json")
    assert expand_sets(["set:imagenet-small"], tmp_path) == [("resnet18", 3), ("two", 1)]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"networks": ["resnet18", "python:os:getcwd"]}, "expected the name of a network"),
        ({"networks": ["resnet18", "../two"]}, "expected the name of a network"),
        ({"turns": {"three": 2}}, "turns: three: expected names that 'networks' lists"),
        ({"turns": {"two": 0}}, "greater than or equal to 1"),
        ({"networks": ["resnet18"]}, "at least 2"),
    ],
)
def test_a_wrong_set_is_a_line(changes, expected, tmp_path):
    write_set(tmp_path, **changes)
    with pytest.raises(ToolkitError) as caught:
        expand_sets(["several"], tmp_path)
    assert expected in str(caught.value) and "\n" not in str(caught.value)


def test_an_unknown_set_is_a_line_and_a_set_is_no_network(tmp_path):
    with pytest.raises(ToolkitError, match=r"imagenet-smal.*set:imagenet-small"):
        expand_sets(["set:imagenet-smal"], tmp_path)
    with pytest.raises(ToolkitError, match="is a set of 8 networks"):
        find_classifier("set:imagenet-small")


def test_turns_go_with_the_networks(tmp_path, monkeypatch):
    from toolkit.boosters.detectors import load_networks
    from toolkit.models import load

    monkeypatch.setattr(load, "load_classifiers", lambda models, *_: list(map(make_hue_classifier, models)))
    write_set(tmp_path, networks=["rig18", "resnet18"], turns={"resnet18": 2})
    found = load_networks(["several", "alexnet"], None, "cpu", tmp_path)
    assert [(one.name, one.turns) for one in found] == [("rig18", 1), ("resnet18", 2), ("alexnet", 1)]
