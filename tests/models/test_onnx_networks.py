"""A classifier in an ONNX file: answers as ONNX Runtime, trains as torch does, and says in one line what it cannot."""

from pathlib import Path

import numpy as np
import pytest
import torch
from one_line import error_of
from safetensors.torch import save_file
from slow_cases import mark_slow

from toolkit.models.load import load_classifier

onnx = pytest.importorskip("onnx", reason="needs onnx: pip install '.[onnx]'")
runtime = pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install '.[onnx]'")
pytest.importorskip("onnx2torch", reason="needs onnx2torch: pip install '.[onnx]'")
from onnx import TensorProto, helper, numpy_helper  # noqa: E402

pytestmark = pytest.mark.usefixtures("forked_trials")
SHARED = Path(__file__).parents[2].parent / "shared"
NETWORKS = sorted((SHARED / "networks").glob("*.onnx"))
CLASSES, PX = 5, 32
DESCRIPTION = "size = {}\nmean = [0.5, 0.5, 0.5]\nstd = [0.5, 0.5, 0.5]\n"


def make_graph(shape=("b", 3, PX, PX), classes=CLASSES, ending=None, kind=TensorProto.FLOAT, shuffle=False):
    """Convolution, smooth activation, mean, matrix; `shuffle` puts in Reshapes that are fixed to the batch of one."""
    rng = np.random.default_rng(0)
    weights = {
        "kernel": rng.normal(0, 0.4, (8, 3, 5, 5)), "matrix": rng.normal(0, 1, (8, classes)),
        "groups": np.array([4, 2, 14 * 14]), "back": np.array([2, -1, 4, 14, 14]), "flat": np.array([1, 8, 196]),
    }  # fmt: skip
    nodes = [
        helper.make_node("Conv", ["image", "kernel"], ["c"], strides=[2, 2]),
        helper.make_node("Sigmoid", ["c"], ["s"]),
    ]
    last = "s"
    if shuffle:
        nodes += [
            helper.make_node("Reshape", ["s", "groups"], ["g"]),
            helper.make_node("Transpose", ["g"], ["t"], perm=[1, 0, 2]),
            helper.make_node("Reshape", ["t", "back"], ["r"]),
            helper.make_node("Split", ["r"], ["one", "two"], axis=0),
            helper.make_node("Concat", ["one", "two"], ["both"], axis=2),
            helper.make_node("Reshape", ["both", "flat"], ["f"]),
            helper.make_node("ReduceMean", ["f"], ["m"], axes=[2], keepdims=0),
        ]
    else:
        nodes.append(helper.make_node("ReduceMean", [last], ["m"], axes=[2, 3], keepdims=0))
    nodes.append(helper.make_node("MatMul", ["m", "matrix"], ["logits" if ending is None else "n"]))
    if ending is not None:
        nodes.append(helper.make_node(ending, ["n"], ["logits"]))
    stored = [
        numpy_helper.from_array(value.astype(np.int64 if value.dtype == np.int64 else np.float32), name)
        for name, value in weights.items()
    ]
    graph = helper.make_graph(
        nodes, "net", [helper.make_tensor_value_info("image", kind, shape)],
        [helper.make_tensor_value_info("logits", TensorProto.FLOAT, [shape[0], classes])], stored,
    )  # fmt: skip
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 11)], ir_version=7)


def write(folder, model, description=DESCRIPTION.format(PX), name="net"):
    onnx.save(model, folder / f"{name}.onnx")
    if description is not None:
        (folder / f"{name}.toml").write_text(description)
    return folder / f"{name}.onnx"


def load(file):
    return load_classifier(f"onnx:{file}", device="cpu")


def ask_runtime(file, batch):
    """The answers of ONNX Runtime alone, image for image, as the file stands."""
    session = runtime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    name = session.get_inputs()[0].name
    return np.concatenate([session.run(None, {name: one[None].numpy()})[0] for one in (batch - 0.5) / 0.5])


@pytest.mark.parametrize(
    "file", mark_slow(NETWORKS, *NETWORKS[:1]) or [pytest.param(None, marks=pytest.mark.skip(reason="needs ../shared"))]
)
def test_real_networks(file, tmp_path):
    session = runtime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    size = session.get_inputs()[0].shape[2]
    (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / file.with_suffix(".toml").name).write_text(DESCRIPTION.format(size))
    classifier = load(tmp_path / file.name)
    assert classifier.is_imagenet and not classifier.untrainable
    batch = torch.rand(3, 3, size, size, generator=torch.Generator().manual_seed(1))
    expected = ask_runtime(file, batch)
    with torch.no_grad():
        assert np.abs(classifier.logits(batch).numpy() - expected).max() < 1e-4
    assert np.abs(classifier.logits(batch.requires_grad_()).detach().numpy() - expected).max() < 1e-4
    check_gradient(classifier, batch.detach()[:1])


def check_gradient(classifier, image, steps=3, rtol=0.02):
    """The directional derivative of a logit along its own gradient, by central differences."""
    image = image.clone().requires_grad_()
    gradient = torch.autograd.grad(classifier.logits(image)[0, 1], image)[0]
    for k in range(steps):
        # along the gradient, and along it with random parts left out
        kept = torch.rand(gradient.shape, generator=torch.Generator().manual_seed(k)) < (1 if k == 0 else 0.5)
        along = gradient * kept / (gradient * kept).norm()
        step = 0.003
        with torch.no_grad():  # by ONNX Runtime
            ends = [classifier.logits(image + sign * step * along)[0, 1].double() for sign in (1, -1)]
        assert float((ends[0] - ends[1]) / (2 * step)) == pytest.approx(float((gradient * along).sum()), rel=rtol)


def test_a_graph_of_our_own_answers_and_trains(tmp_path):
    file = write(tmp_path, make_graph())
    classifier = load(file)
    batch = torch.rand(4, 3, PX, PX, generator=torch.Generator().manual_seed(2))
    expected = ask_runtime(file, batch)
    with torch.no_grad():
        assert np.abs(classifier.logits(batch).numpy() - expected).max() < 1e-5
    assert np.ptp(expected, axis=0).max() > 1e-3  # it tells the images apart
    assert np.abs(classifier.logits(batch.requires_grad_()).detach().numpy() - expected).max() < 1e-5
    check_gradient(classifier, batch.detach()[:1])
    assert (classifier.arch, classifier.name, classifier.labels[0]) == ("onnx:net.onnx", "net", "class 0")


def test_a_fixed_batch_is_made_free(tmp_path):
    file = write(tmp_path, make_graph((1, 3, PX, PX), shuffle=True))
    classifier = load(file)
    assert not classifier.module.is_single and not classifier.untrainable
    batch = torch.rand(5, 3, PX, PX, generator=torch.Generator().manual_seed(2))
    expected = ask_runtime(file, batch)
    with torch.no_grad():
        assert np.abs(classifier.logits(batch).numpy() - expected).max() < 1e-5
    assert np.abs(classifier.logits(batch.requires_grad_()).detach().numpy() - expected).max() < 1e-5


def test_channels_last_probabilities_and_bgr(tmp_path):
    plain = load(write(tmp_path, make_graph(ending="Softmax")))
    batch = torch.rand(2, 3, PX, PX, generator=torch.Generator().manual_seed(2))
    bare = load(write(tmp_path, make_graph(), name="bare"))
    with torch.no_grad():
        assert torch.allclose(plain.logits(batch), bare.logits(batch).log_softmax(1), atol=1e-4)
    turned = make_graph((1, PX, PX, 3))
    turned.graph.node.insert(0, helper.make_node("Transpose", ["image"], ["nchw"], perm=[0, 3, 1, 2]))
    turned.graph.node[1].input[0] = "nchw"
    last = load(write(tmp_path, turned, name="last"))
    words = "size = 32\nmean = [0.1, 0.5, 0.9]\nstd = [0.5, 0.4, 0.3]\nchannels = "
    first = load(write(tmp_path, make_graph(), words + '"RGB"', name="rgb"))
    swapped = load(write(tmp_path, make_graph(), words + '"BGR"', name="bgr"))
    with torch.no_grad():
        assert torch.allclose(last.logits(batch), bare.logits(batch), atol=1e-5)
        assert torch.allclose(swapped.logits(batch), first.logits(batch.flip(1)), atol=1e-5)
        assert not torch.allclose(swapped.logits(batch), first.logits(batch), atol=1e-3)
    assert first.preprocessing.describe() + ", channels BGR" == swapped.preprocessing.describe()
    check_gradient(last, batch[:1])


def test_labels_and_imagenets_background(tmp_path):
    names = 'labels = ["a", "b", "c", "d", "e"]\nname = "letters"'
    named = load(write(tmp_path, make_graph(), f"{DESCRIPTION.format(PX)}{names}"))
    assert named.labels == list("abcde") and named.name == "letters"
    bare = load(write(tmp_path, make_graph(), name="bare"))
    assert "5 classes of this network have no names: list them as 'labels'" in error_of(lambda: bare.class_index("a"))
    assert bare.class_index("class 3") == 3
    wide = load(write(tmp_path, make_graph(classes=1001), name="tf"))
    assert wide.labels[:2] == ["background", "tench"] and not wide.is_imagenet
    assert load(write(tmp_path, make_graph(classes=1000), None, "thousand")).is_imagenet
    wrong = write(tmp_path, make_graph(), 'size = 32\nlabels = ["a", "b"]', "wrong")
    assert "expected a name for each of the 5 outputs of wrong.onnx, found 2" in error_of(lambda: load(wrong))


def quantised():
    """Weights in 8 bits, made floats again before the convolution."""
    model = make_graph()
    kernel = numpy_helper.to_array(model.graph.initializer[0])
    model.graph.initializer[0].CopyFrom(numpy_helper.from_array((kernel * 50).round().astype(np.int8), "kernel8"))
    model.graph.initializer.append(numpy_helper.from_array(np.float32(0.02), "scale"))
    model.graph.node.insert(0, helper.make_node("DequantizeLinear", ["kernel8", "scale"], ["kernel"]))
    return model


def test_int8_weights_judge_and_cannot_train(tmp_path):
    from toolkit.boosters.pixels import resolve_targets

    file = write(tmp_path, quantised())
    classifier, batch = load(file), torch.rand(2, 3, PX, PX)
    with torch.no_grad():
        assert np.abs(classifier.logits(batch).numpy() - ask_runtime(file, batch)).max() < 1e-5
    line = error_of(lambda: resolve_targets([classifier], 1))
    assert "it can judge" in line and "quantised to integers" in line and "onnx:net.onnx" in line


def edited(change):
    model = make_graph()
    change(model.graph)
    return model


def two_inputs(graph):
    graph.input.append(helper.make_tensor_value_info("mask", TensorProto.FLOAT, [1, 1, PX, PX]))
    graph.node.append(helper.make_node("Identity", ["mask"], ["unused"]))


def unknown_operator():
    model = make_graph()
    model.graph.node[1].op_type, model.graph.node[1].domain = "MadeUp", "org.example"
    model.opset_import.append(helper.make_opsetid("org.example", 1))
    return model


def endless(graph):
    """A loop whose condition stays true."""
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["on"]), helper.make_node("Add", ["x", "x"], ["y"])], "body",
        [helper.make_tensor_value_info("i", TensorProto.INT64, []),
         helper.make_tensor_value_info("go", TensorProto.BOOL, []),
         helper.make_tensor_value_info("x", TensorProto.FLOAT, None)],
        [helper.make_tensor_value_info("on", TensorProto.BOOL, []),
         helper.make_tensor_value_info("y", TensorProto.FLOAT, None)],
    )  # fmt: skip
    graph.initializer.append(helper.make_tensor("true", TensorProto.BOOL, [], [True]))
    graph.node[-1].output[0] = "before"
    graph.node.append(helper.make_node("Loop", ["", "true", "before"], ["logits"], body=body))


def huge(graph):
    """Six gigabytes of zeros."""
    graph.initializer.append(numpy_helper.from_array(np.array([40_000, 40_000]), "sides"))
    graph.node[-1].output[0] = "before"
    graph.node.extend(
        [
            helper.make_node("ConstantOfShape", ["sides"], ["zeros"]),
            helper.make_node("ReduceMean", ["zeros"], ["zero"], keepdims=0),
            helper.make_node("Add", ["before", "zero"], ["logits"]),
        ]
    )


def busy(graph):
    """One constant of sixty products of two large matrices, worked out as the session starts."""
    graph.initializer.append(numpy_helper.from_array(np.array([6000, 6000]), "sides"))
    graph.node[-1].output[0] = "before"
    graph.node.append(helper.make_node("ConstantOfShape", ["sides"], ["p0"]))
    graph.node.extend(helper.make_node("MatMul", ["p0", f"p{k}"], [f"p{k + 1}"]) for k in range(60))
    graph.node.append(helper.make_node("ReduceMean", ["p60"], ["zero"], keepdims=0))
    graph.node.append(helper.make_node("Add", ["before", "zero"], ["logits"]))


def say_strings(graph):
    graph.node[-1].output[0] = "before"
    graph.node.append(helper.make_node("Cast", ["before"], ["logits"], to=TensorProto.STRING))
    graph.output[0].type.tensor_type.elem_type = TensorProto.STRING


def misfit(graph):
    graph.initializer.append(numpy_helper.from_array(np.zeros((7, 11), np.float32), "odd"))
    graph.node[-1].input[1] = "odd"


HOSTILE = {
    "a loop without an end": (endless, "has no answer after 2 s"),
    "work without an end": (busy, "has no answer after 2 s"),
    "six gigabytes": (huge, "too much memory"),
    "no output": (lambda graph: graph.ClearField("output"), "it has no output"),
    "strings": (say_strings, "its output 'logits' is no tensor of numbers"),
    "a scalar": (lambda graph: graph.node[2].attribute[0].CopyFrom(helper.make_attribute("axes", [0, 1, 2, 3])), ""),
    "misfit": (misfit, ""),
}


@pytest.mark.parametrize(("case", "batch"), [*((case, 1) for case in HOSTILE), ("a scalar", "b"), ("misfit", "b")])
def test_a_hostile_graph_is_one_line(tmp_path, monkeypatch, case, batch):
    import toolkit.models.onnx_graphs
    from toolkit.core.child import run_python

    change, expected = HOSTILE[case]
    monkeypatch.setattr(toolkit.models.onnx_graphs, "run_python", run_python)
    if change in (endless, busy):
        monkeypatch.setattr(toolkit.models.onnx_graphs, "TRYING_S", 2.0)
    model = make_graph((batch, 3, PX, PX))
    change(model.graph)
    (tmp_path / "net.onnx").write_bytes(model.SerializeToString())
    line = error_of(lambda: load(tmp_path / "net.onnx"))
    assert expected in line and "net.onnx" in line
    assert not any(words in line for words in ("[ONNXRuntimeError]", "Non-zero", "Error:", "Status Message"))


@pytest.mark.parametrize("side", [-5, 1, 10**7, 2**62])
def test_a_side_that_cannot_be_is_one_line(tmp_path, side):
    file = write(tmp_path, make_graph((1, 3, side, side)), description=None)
    assert "takes images of" in error_of(lambda: load(file))


BAD = {
    "two inputs": (lambda: edited(two_inputs), None, "has 2 inputs (image, mask): expected a batch"),
    "any size": (lambda: make_graph(("b", 3, "h", "w")), None, "images of any size: say which in net.toml"),
    "unknown operator": (unknown_operator, None, "its operator org.example.MadeUp is none of ONNX's"),
    "grey images": (lambda: make_graph(("b", 1, PX, PX)), None, "expected colour images, of 3 channels"),
    "oblong": (lambda: make_graph(("b", 3, PX, 48)), None, "expected square images"),
    "a vector": (lambda: make_graph(("b", 12)), None, "expected a batch of colour images"),
    "bytes": (lambda: make_graph(kind=TensorProto.UINT8), None, "is of uint8: expected float"),
    "batch of eight": (lambda: make_graph((8, 3, PX, PX)), None, "takes exactly 8 images at once"),
    "other size": (make_graph, "size = 64", "takes images of 32 px, and its description says 64"),
    "unknown channels": (make_graph, 'channels = "HSV"', "field 'channels'"),
    "not a number": (lambda: edited(make_nan), None, "not a number"),
}


def make_nan(graph):
    matrix = numpy_helper.to_array(graph.initializer[1]) * np.float32(np.nan)
    graph.initializer[1].CopyFrom(numpy_helper.from_array(matrix, "matrix"))


@pytest.mark.parametrize("case", BAD)
def test_bad_files_in_one_line(tmp_path, case):
    make, description, expected = BAD[case]
    (tmp_path / "net.onnx").write_bytes(make().SerializeToString())
    if description is not None:
        (tmp_path / "net.toml").write_text(description)
    line = error_of(lambda: load(tmp_path / "net.onnx"))
    assert expected in line and "net" in line


def test_any_size_that_is_said(tmp_path):
    file = write(tmp_path, make_graph(("b", 3, "h", "w")), "size = 48")
    assert load(file).preprocessing.crop_px == 48


def test_no_file_damaged_file_and_two_descriptions(tmp_path):
    assert "no such file" in error_of(lambda: load(tmp_path / "none.onnx"))
    (tmp_path / "noise.onnx").write_bytes(b"\x01noise" * 50)
    assert "not an ONNX graph, or damaged" in error_of(lambda: load(tmp_path / "noise.onnx"))
    file = write(tmp_path, make_graph())
    file.with_suffix(".json").write_text("{}")
    assert "delete either" in error_of(lambda: load(file))
    assert "has its own weights" in error_of(lambda: load_classifier(f"onnx:{file}", tmp_path / "x.pth", "cpu"))


def test_missing_package(tmp_path, monkeypatch):
    import sys

    file = write(tmp_path, make_graph())
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    assert "pip install '.[onnx]'" in error_of(lambda: load(file))


def test_weights_beside_the_file_count_in_its_hash(tmp_path):
    model = make_graph()
    onnx.save(model, tmp_path / "net.onnx", save_as_external_data=True, location="net.bin", size_threshold=0)
    (tmp_path / "net.toml").write_text(DESCRIPTION.format(PX))
    before = load(tmp_path / "net.onnx")
    content = bytearray((tmp_path / "net.bin").read_bytes())
    content[:4] = np.float32(2).tobytes()
    (tmp_path / "net.bin").write_bytes(content)
    assert load(tmp_path / "net.onnx").weights.sha256 != before.weights.sha256


def test_a_patch_comes_out_as_against_the_same_network_in_torch(tmp_path):
    from dataclasses import replace

    from tiny_network import tiny_config, train_tiny, write_photos
    from torch import nn

    words = f'{DESCRIPTION.format(PX)}labels = ["cat", "dog", "jet", "mug", "car"]'
    model = make_graph()
    classifier = load(write(tmp_path, model, words))
    kernel, matrix = (torch.from_numpy(numpy_helper.to_array(one).copy()) for one in model.graph.initializer[:2])
    layers = nn.Sequential(nn.Conv2d(3, 8, 5, 2, bias=False), nn.Sigmoid(), nn.AdaptiveAvgPool2d(1), nn.Flatten(),
                           nn.Linear(8, 5, bias=False)).requires_grad_(False)  # fmt: skip
    layers[0].weight.copy_(kernel)
    layers[4].weight.copy_(matrix.T)
    photos, pixels = write_photos(tmp_path / "photos", 6), []
    for name, network in (("onnx", classifier), ("torch", replace(classifier, module=layers))):
        trained = train_tiny(tmp_path / name, photos, tiny_config(20), networks=[network])
        assert trained.patch.record.networks[0].arch == "onnx:net.onnx"
        pixels.append(trained.patch.pixels.astype(float))
    assert np.abs(pixels[0] - pixels[1]).mean() < 0.5 < np.abs(pixels[0] - 128).mean()


def test_grad_cam_finds_its_layers(tmp_path):
    from toolkit.evaluation.saliency import NoSaliency, find_feature_map

    find_feature_map(load(write(tmp_path, make_graph())))
    with pytest.raises(NoSaliency, match="quantised"):
        find_feature_map(load(write(tmp_path, quantised(), name="small")))


def test_a_state_dict_by_its_file(tmp_path):
    import torchvision

    state = torchvision.models.squeezenet1_1(num_classes=3).state_dict()
    save_file(state, tmp_path / "mine.safetensors")
    line = error_of(lambda: load_classifier(str(tmp_path / "mine.safetensors"), device="cpu"))
    assert "mine.toml with 'architecture'" in line
    (tmp_path / "mine.toml").write_text('architecture = "squeezenet1_1"\nsize = 64\nlabels = ["a", "b", "c"]')
    mine = load_classifier(str(tmp_path / "mine.safetensors"), device="cpu")
    assert mine.labels == ["a", "b", "c"] and mine.arch == "squeezenet1_1"
    assert (mine.preprocessing.resize_px, mine.preprocessing.crop_px) == (64, 64)
    named = load_classifier("torchvision:squeezenet1_1", tmp_path / "mine.safetensors", "cpu")
    assert named.labels == mine.labels
    assert "no model called 'resnet81': did you mean" in error_of(
        lambda: load_classifier("torchvision:resnet81", device="cpu")
    )


@pytest.mark.parametrize("description", [None, f"size = {PX}\n"])
def test_that_no_normalisation_is_said_is_a_note_of_the_network(tmp_path, description):
    """A graph that normalises itself is wrong of nearly all images: its results have to say what may be the reason."""
    (note,) = load(write(tmp_path, make_graph(), description)).notes
    assert "no 'mean' and 'std'" in note and "its answers are wrong" in note
    assert load(write(tmp_path, make_graph(), name="said")).notes == ()
