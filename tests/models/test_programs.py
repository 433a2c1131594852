"""Exported programs and functions of the user's as classifiers; nothing in a file runs as code."""

import copy
import io
import json
import pickle
import sys
import zipfile

import numpy as np
import pytest
import torch
import torchvision
from one_line import error_of
from slow_cases import mark_slow

from toolkit.core.console import quietly
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.load import load_classifier
from toolkit.models.programs import load_program, wrap_module

PX = 64


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(0)
    return torchvision.models.squeezenet1_1(num_classes=3).eval()


@pytest.fixture(scope="module")
def exported(network, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exported")
    for name, count, free in (("free", 2, ({0: torch.export.Dim("b")},)), ("two", 2, None)):
        program = torch.export.export(network, (torch.rand(count, 3, PX, PX),), dynamic_shapes=free)
        torch.export.save(program, folder / f"{name}.pt2")
    return folder


def test_a_module_in_memory_becomes_a_classifier_and_stays_as_it_is(network):
    mean, std = (0.4, 0.5, 0.6), (0.2, 0.3, 0.4)
    module = copy.deepcopy(network).train()
    classifier = wrap_module(module, ["bracket", "bolt", "washer"], PX, mean, std, device="cpu")
    batch = torch.rand(2, 3, PX, PX)
    expected = network((batch - torch.tensor(mean).view(3, 1, 1)) / torch.tensor(std).view(3, 1, 1))
    assert torch.allclose(classifier.logits(batch), expected, atol=1e-5)
    assert (classifier.class_index("bolt"), classifier.name, classifier.preprocessing.crop_px) == (1, "SqueezeNet", PX)
    assert module.training and all(one.requires_grad for one in module.parameters())
    other = wrap_module(network, ["a", "b", "c"], PX, device="cpu", name="mine")
    assert other.name == "mine" and other.weights.sha256 == classifier.weights.sha256


@pytest.mark.parametrize(
    ("labels", "size", "words"), [(["a", "b"], PX, "each of the 3 outputs"), (["a", "b", "c"], 0, "size")]
)
def test_a_module_that_does_not_fit_what_is_said_of_it_is_one_line(network, labels, size, words):
    assert words in error_of(lambda: wrap_module(network, labels, size, device="cpu"))
    assert "field 'mean' has no item 3" in error_of(lambda: wrap_module(network, labels, PX, (0.5, 0.5)))


def test_a_module_in_place_of_a_name_is_told_how(network):
    assert "wrap_module(module, labels, size, mean, std)" in error_of(lambda: load_classifier(network))


@pytest.mark.parametrize("name", ["free", "two"])
def test_an_exported_program_answers_and_trains(network, exported, name):
    classifier = load_classifier(str(exported / f"{name}.pt2"), device="cpu")
    batch = torch.rand(5, 3, PX, PX, requires_grad=True)
    how = classifier.preprocessing
    mean, std = (torch.tensor(values).view(3, 1, 1) for values in (how.mean, how.std))
    expected = network((batch - mean) / std)
    found = classifier.logits(batch)
    assert torch.allclose(found, expected, atol=1e-5) and (how.crop_px, classifier.name) == (PX, name)
    gradients = [torch.autograd.grad(one[:, 1].sum(), batch)[0] for one in (found, expected)]
    assert torch.allclose(*gradients, atol=1e-6) and gradients[0].abs().max() > 1e-4


class NamesItsDevice(torch.nn.Module):
    def forward(self, images):
        places = torch.arange(3, device=images.device).to(images.device, images.dtype)
        return images.mean((2, 3)) + places


def test_a_program_runs_on_another_device_than_it_was_exported_on(tmp_path):
    """On `meta` as on a GPU: operations that make tensors name their device in the file."""
    file = tmp_path / "net.pt2"
    torch.export.save(torch.export.export(NamesItsDevice(), (torch.zeros(2, 3, PX, PX),)), file)
    module, _ = load_program(file, "meta")
    answers = module(torch.zeros(2, 3, PX, PX, device="meta"))
    assert answers.device.type == "meta" and answers.shape == (2, 3)


def test_a_program_without_a_description_says_how_its_images_are_normalised(exported, tmp_path, capsys):
    file = tmp_path / "net.pt2"
    file.write_bytes((exported / "two.pt2").read_bytes())
    with quietly():
        load_classifier(str(file), device="cpu")
    said = capsys.readouterr().err
    assert "net.pt2: no 'mean' and 'std' in a net.toml beside it" in said and "ImageNet's" in said
    file.with_suffix(".toml").write_text("mean = [0.5, 0.5, 0.5]\nstd = [0.5, 0.5, 0.5]\n")
    load_classifier(str(file), device="cpu")
    assert capsys.readouterr().err == ""


def rewrite(file, target, change):
    """The archive with `change(name, content)` instead of each file."""
    with zipfile.ZipFile(file) as source, zipfile.ZipFile(target, "w") as out:
        for name in source.namelist():
            out.writestr(name, change(name, source.read(name)))
    return target


class Payload:
    def __reduce__(self):
        return (exec, ("import builtins; builtins.ran = True",))


def in_program(change):
    def apply(name, content):
        if not name.endswith("models/model.json"):
            return content
        program = json.loads(content)
        change(program)
        return json.dumps(program).encode()

    return apply


def set_target(program):
    program["graph_module"]["graph"]["nodes"][0]["target"] = "torch.os.system"


def set_file_target(program):
    program["graph_module"]["graph"]["nodes"][0]["target"] = "torch.ops.aten.from_file.default"


def set_size(program):
    values = program["graph_module"]["graph"]["sym_int_values"]
    values["evil"] = {"as_expr": {"expr_str": "exec(chr(49))", "hint": None}}


def set_name(program):
    program["graph_module"]["graph"]["nodes"][0]["name"] = "x = __import__('os')"


def pickle_weights(name, content):
    if name.endswith("weights/model_weights_config.json"):
        payload = json.loads(content)
        next(iter(payload["config"].values()))["use_pickle"] = True
        return json.dumps(payload).encode()
    return pickle.dumps(Payload()) if name.endswith("weights/weight_0") else content


def pickle_samples(name, content):
    if name.endswith("sample_inputs/model.pt"):
        buffer = io.BytesIO()
        torch.save(Payload(), buffer)
        return buffer.getvalue()
    return content


EVIL = {
    "operator": (in_program(set_target), "the operator 'torch.os.system'"),
    "operator on files": (in_program(set_file_target), "the operator 'torch.ops.aten.from_file.default'"),
    "size": (in_program(set_size), "the text 'exec(chr(49))'"),
    "name": (in_program(set_name), "the text 'x = __import__"),
    "pickled weights": (pickle_weights, "as a pickled object"),
}


@pytest.mark.parametrize("case", EVIL)
def test_code_in_an_exported_program_does_not_run(exported, tmp_path, case):
    change, expected = EVIL[case]
    file = rewrite(exported / "free.pt2", tmp_path / "evil.pt2", change)
    line = error_of(lambda: load_classifier(str(file), device="cpu"))
    assert expected in line and "not loaded for safety" in line
    import builtins

    assert not hasattr(builtins, "ran")


def test_guards_and_samples_that_are_code_are_left_out(exported, tmp_path):
    import builtins

    def add_guard(program):
        program["guards_code"] = ["exec('import builtins; builtins.ran = True') or True"]

    for change in (in_program(add_guard), pickle_samples):
        file = rewrite(exported / "free.pt2", tmp_path / "evil.pt2", change)
        assert len(load_classifier(str(file), device="cpu").labels) == 3
        assert not hasattr(builtins, "ran")


def in_graph(change):
    return in_program(lambda program: change(program["graph_module"]["graph"]))


def add_size(text):
    def change(graph):
        graph["sym_int_values"]["evil"] = {"as_expr": {"expr_str": text, "hint": None}}

    return in_graph(change)


def in_weights(change):
    """`change(entry)` for the first weight's description."""

    def apply(name, content):
        if not name.endswith("weights/model_weights_config.json"):
            return content
        payload = json.loads(content)
        change(next(iter(payload["config"].values())))
        return json.dumps(payload).encode()

    return apply


def shorten(bytes_left):
    return lambda name, content: content[:bytes_left] if name.endswith("weights/weight_0") else content


def allocate(graph):
    node = next(node for node in graph["nodes"] if node["target"].endswith("relu_.default"))
    node["target"] = "torch.ops.aten.pad.default"
    node["inputs"].append({"name": "pad", "arg": {"as_ints": [0, 10**6, 0, 10**4]}, "kind": 1})


HOSTILE = {
    "an empty weight": (shorten(0), "is cut off: 0 bytes of"),
    "half a weight": (shorten(400), "is cut off: 400 bytes of"),
    "a weight of 10^12": (in_weights(lambda entry: entry["tensor_meta"]["sizes"].__setitem__(0, {"as_int": 10**12})),
                          "is cut off"),
    "a weight of another kind": (in_weights(lambda entry: entry["tensor_meta"].update(dtype=8)), "is cut off"),
    "no description of weights": (in_weights(dict.clear), "do not fit together"),
    "powers": (add_size("Pow(9, Pow(9, 9))"), "the text 'Pow(9, Pow(9, 9))'"),
    "powers of powers": (add_size("Pow(" * 9 + "9" + ", 9)" * 9), "the text 'Pow(Pow("),
    "another power": (add_size("9**9**9**9"), "the text '9**9"),
    "20,000 operations": (in_graph(lambda graph: graph.update(nodes=graph["nodes"] * 400)), "are read"),
    "a tree without an end": (lambda name, content: b"[" * 100_000 if name.endswith("model.json") else content,
                              "do not fit together"),
    "no object": (lambda name, content: b"[]" if name.endswith("model.json") else content, "no object of JSON"),
    "80 GB": (in_graph(allocate), "it takes more than 2 GB"),
}  # fmt: skip


@pytest.mark.parametrize("case", mark_slow(HOSTILE, "20,000 operations"))
def test_a_hostile_program_is_one_line_and_gives_no_answers(exported, tmp_path, case):
    change, expected = HOSTILE[case]
    file = rewrite(exported / "two.pt2", tmp_path / "bad.pt2", change)
    line = error_of(lambda: load_classifier(str(file), device="cpu"))
    assert expected in line and "torch.export:" not in line and "Error" not in line


def test_a_program_that_was_blown_up_is_refused_before_it_is_read(exported, tmp_path):
    with zipfile.ZipFile(tmp_path / "bomb.pt2", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("n/models/model.json", b" " * (100 << 20))
    assert "its parts are compressed" in error_of(lambda: load_classifier(str(tmp_path / "bomb.pt2")))


def test_files_that_are_no_exported_programs(tmp_path):
    (tmp_path / "noise.pt2").write_bytes(b"\x00noise" * 40)
    assert "not a program of torch.export" in error_of(lambda: load_classifier(str(tmp_path / "noise.pt2")))
    with zipfile.ZipFile(tmp_path / "old.pt2", "w") as archive:
        archive.writestr("serialized_exported_program.json", "{}")
    assert "torch.export 2.9 or later" in error_of(lambda: load_classifier(str(tmp_path / "old.pt2")))
    assert "no such file" in error_of(lambda: load_classifier(str(tmp_path / "none.pt2")))


def test_torch_logs_no_traceback_of_a_program_that_it_cannot_read(exported, tmp_path, capfd):
    with zipfile.ZipFile(exported / "two.pt2") as whole, zipfile.ZipFile(tmp_path / "later.pt2", "w") as archive:
        for name in whole.namelist():
            archive.writestr(name, b"99" if name.endswith(".data/version") else whole.read(name))
    assert "the program is damaged" in error_of(lambda: load_classifier(str(tmp_path / "later.pt2")))
    said = capfd.readouterr()
    assert (said.out, said.err) == ("", "")


SOURCE = """
import torch
from toolkit.imaging.preprocessing import Preprocessing
from torchvision.transforms._presets import ImageClassification

class Net(torch.nn.Module):
    def __init__(self, change=lambda x: x):
        super().__init__()
        torch.manual_seed(1)
        self.linear = torch.nn.Linear(3, 4)
        torch.nn.init.normal_(self.linear.weight)
        self.change = change

    def forward(self, x):
        return self.change(self.linear(x.mean((2, 3))))

HOW = {"size": 32, "mean": [0.5, 0.5, 0.5], "std": [0.2, 0.2, 0.2], "labels": ["a", "b", "c", "d"]}
def good(): return Net(), HOW
def kit(): return Net(), Preprocessing(40, 32, (0.5, 0.5, 0.5), (0.2, 0.2, 0.2))
def torchvisions(): return Net(), ImageClassification(crop_size=32, resize_size=40)
def softmaxed(): return Net(lambda y: y.softmax(1)), HOW
def bare(): return Net()
def swapped(): return HOW, Net()
def no_size(): return Net(), {"mean": [0.5, 0.5, 0.5]}
def wrong_field(): return Net(), {"size": "big"}
def number(): return Net(), 3
def fails(): raise RuntimeError("no weights here")
def nan(): return Net(lambda y: y * float("nan")), HOW
def listed(): return Net(lambda y: [y, y]), HOW
def mapped(): return Net(lambda y: {"logits": y}), HOW
def detector(): return Net(lambda y: [{"boxes": y, "scores": y, "labels": y}]), HOW
def flat(): return Net(lambda y: y.flatten()), HOW
def dense(): return Net(lambda y: y[:, :, None, None].expand(-1, -1, 5, 5)), HOW
class Later(Net):
    asked = 0
    def forward(self, x):
        answers = self.linear(x.mean((2, 3)))
        self.asked += 1
        return answers if self.asked == 1 else self.change(answers)
def set_nan(y):
    y[1:, 2] = float("nan")
    return y
def fail(y): raise ValueError("no more\\nof it")
class Gone(BaseException): pass
def leave(y=None): raise Gone("for good")
def later_nan(): return Later(set_nan), HOW
def later_list(): return Later(lambda y: [1.0, 2.0]), HOW
def later_shape(): return Later(lambda y: y[:, :3]), HOW
def later_fewer(): return Later(lambda y: y[:1]), HOW
def later_labels(): return Later(lambda y: y.argmax(1)), HOW
def later_fails(): return Later(fail), HOW
def later_leaves(): return Later(leave), HOW
def leaves(): leave()
def exits(): raise SystemExit(3)
def leaves_at_once(): return Net(leave), HOW
def unnamed(): return Net(), {"size": 32}
def few(): return Net(lambda y: y[:, :3]), HOW
def stuck(): return Net(lambda y: y @ y), HOW
"""


@pytest.fixture
def code(tmp_path, monkeypatch):
    (tmp_path / "my_networks.py").write_text(SOURCE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_networks", raising=False)
    yield
    sys.modules.pop("my_networks", None)


def load(function):
    return load_classifier(f"python:my_networks:{function}", device="cpu")


def test_a_function_of_ones_own(code):
    classifier = load("good")
    batch = torch.rand(3, 3, 32, 32, requires_grad=True)
    expected = classifier.module.linear((batch.mean((2, 3)) - 0.5) / 0.2)
    assert torch.allclose(classifier.logits(batch), expected, atol=1e-5)
    assert classifier.logits(batch).requires_grad and classifier.labels == list("abcd")
    assert (classifier.name, classifier.arch) == ("good", "python:my_networks:good")
    assert load("kit").preprocessing == Preprocessing(40, 32, (0.5, 0.5, 0.5), (0.2, 0.2, 0.2))
    assert load("torchvisions").preprocessing.resize_px == 40
    assert np.allclose(load("softmaxed").logits(batch).detach(), expected.log_softmax(1).detach(), atol=1e-5)


def test_its_hash_is_of_weights_and_code(code, tmp_path):
    before = load("good").weights.sha256
    assert load("good").weights.sha256 == before
    for old, new in (("manual_seed(1)", "manual_seed(2)"), ("x.mean", "0.9 * x.mean")):
        (tmp_path / "my_networks.py").write_text(SOURCE.replace(old, new))
        sys.modules.pop("my_networks")
        assert load("good").weights.sha256 != before


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        ("bare", "expected a torch.nn.Module and its preprocessing, in a tuple; found Net"),
        ("swapped", "found tuple of 2: dict, Net"),
        ("no_size", "or a dict with 'size'; found mean"),
        ("wrong_field", "field 'size'"),
        ("number", "found int"),
        ("fails", "RuntimeError: no weights here"),
        ("leaves", "leaves of my_networks ended with an error: Gone: for good"),
        ("leaves_at_once", "it fails at two images of 32 px: Gone: for good"),
        ("exits", "exits of my_networks ended with an error: SystemExit: 3"),
        ("missing", "'my_networks' has no function 'missing'"),
        ("nan", "not a number"),
        ("listed", "gives a list of 2 for 2 images: expected 2×classes in a single tensor"),
        ("mapped", "gives a dict for 2 images: expected 2×classes"),
        ("detector", "a detector?"),
        ("flat", "gives 8 for 2 images: expected 2×classes"),
        ("dense", "gives 2×4×5×5 for 2 images: expected 2×classes"),
        ("few", "each of the 3 outputs"),
        ("stuck", "it fails at two images of 32 px: RuntimeError"),
    ],
)
def test_what_a_function_may_not_return(code, function, expected):
    line = error_of(lambda: load(function))
    assert expected in line and "my_networks" in line


def test_functions_that_are_not_there(code):
    assert "python:MODULE:FUNCTION" in error_of(lambda: load_classifier("python:my_networks"))
    missing = "there is no module 'no_such_module': expected no_such_module.py in this folder"
    assert missing in error_of(lambda: load_classifier("python:no_such_module:f"))


@pytest.fixture
def captured(tmp_path):
    """Three images of one class in an ImageFolder."""
    from PIL import Image

    from toolkit.captures.read import read_captures

    for k in range(3):
        file = tmp_path / "shots" / "a" / f"{k}.png"
        file.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(np.full((40, 40, 3), 80 + 40 * k, np.uint8)).save(file)
    return read_captures(tmp_path / "shots").captures


@pytest.mark.parametrize(
    ("function", "expected", "where"),
    [
        ("later_nan", "the network's output is not a number", "a/1.png"),
        ("later_list", "gives a list of 2 for 4 images: expected 4×4", "a/0.png or the 2 images after it"),
        ("later_shape", "gives 4×3 for 4 images: expected 4×4", "a/0.png or"),
        ("later_fewer", "gives 1×4 for 4 images: expected 4×4", "a/0.png or"),
        ("later_labels", "gives 4 for 4 images: expected 4×4", "a/0.png or"),
        ("later_leaves", "fails at 4 images of 32 px: Gone: for good", "a/0.png or"),
        ("later_fails", "fails at 4 images of 32 px: ValueError: no more of it", "a/0.png or"),
    ],
)
def test_one_that_turns_bad_later_is_named_with_the_image(code, captured, function, expected, where):
    from toolkit.evaluation.predict import predict_captures

    classifier = load(function)
    line = error_of(lambda: predict_captures(captured, {"shots": 0}, classifier))
    assert line.startswith(f"model python:my_networks:{function}: ") and expected in line and where in line


def test_classes_without_names_are_named_by_the_function(code):
    line = error_of(lambda: load("unnamed").class_index("bolt"))
    assert "the 4 classes of this network have no names: return {'size': …, 'labels': ['…', …]} as the" in line
    assert "beside" not in line
    assert (
        "my_networks.py: the 'labels' that its function returns: expected a name for each of the 3 outputs"
        in error_of(lambda: load("few"))
    )
