"""Networks from anybody: damaged files are a line, and never answers that nobody trained."""

import io
import json
import zipfile
from functools import lru_cache

import numpy as np
import pytest
from hostile_checks import LONGEST_LINE, count, limited
from hostile_inputs import damaged, documents
from hypothesis import given, settings
from hypothesis import strategies as st

torch = pytest.importorskip("torch")

from toolkit.core.errors import ToolkitError  # noqa: E402
from toolkit.models.programs import read_exported  # noqa: E402
from toolkit.models.weights import open_weights, read_state_dict  # noqa: E402
from toolkit.training.checkpoint import Checkpoint  # noqa: E402


def read(call):
    """What it gives, or None after a line; the test fails with any other error."""
    try:
        with limited(), torch.no_grad():
            return call()
    except ToolkitError as error:
        said = str(error)
        assert 0 < len(said) < LONGEST_LINE and "\n" not in said, said
        assert not any(words in said for words in ("weights_only", "Error:", "Exception", "torch.export:")), said
        return None


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("networks")


@lru_cache(maxsize=2)  # its keys are addresses, others each time
def save_weights(zipped: bool) -> bytes:
    buffer = io.BytesIO()
    torch.save({"fc.weight": torch.ones(4, 4), "fc.bias": torch.ones(4)}, buffer, _use_new_zipfile_serialization=zipped)
    return buffer.getvalue()


@given(data=st.data(), zipped=st.booleans())
def test_damaged_weights(place, data, zipped):
    file = place / "net.pth"
    file.write_bytes(data.draw(damaged(save_weights(zipped))))
    count("weights")
    read(lambda: read_state_dict(open_weights(file)))


@pytest.fixture(scope="module")
def program(place):
    """The parts of an exported program by name, and what it says to an image."""
    network = torch.nn.Sequential(torch.nn.Conv2d(3, 4, 3), torch.nn.Flatten(), torch.nn.Linear(144, 3))
    buffer, image = io.BytesIO(), torch.rand(1, 3, 8, 8)
    torch.export.save(torch.export.export(network.eval(), (image,)), buffer)
    with zipfile.ZipFile(buffer) as archive, torch.no_grad():
        return {name: archive.read(name) for name in archive.namelist()}, image, network(image)


@given(data=st.data())
def test_a_program_whose_weights_are_cut_gives_no_answers(place, program, data):
    """Its description is as it was: nothing but the whole weights may answer, and as they did."""
    parts, image, expected = program
    name = data.draw(st.sampled_from([name for name in parts if "/weight_" in name]))
    left = data.draw(st.integers(0, len(parts[name])))
    found = read_changed(place, parts, name, parts[name][:left])
    assert (found is None) == (left < len(parts[name]))
    assert found is None or torch.equal(found(image), expected)


@given(data=st.data())
def test_a_damaged_program(place, program, data):
    parts, _, _ = program
    name = data.draw(st.sampled_from([name for name in parts if name.endswith(".json")]))
    if data.draw(st.booleans()):
        content = json.dumps(data.draw(documents(json.loads(parts[name])))).encode()
    else:
        content = data.draw(damaged(parts[name]))
    read_changed(place, parts, name, content)


def test_a_name_of_two_lines_is_said_in_one(place, program):
    parts, _, _ = program
    name = next(name for name in parts if name.endswith("models/model.json"))
    assert read_changed(place, parts, name, json.dumps(json.loads(parts[name]) | {"a\nb": {}}).encode()) is None


def read_changed(place, parts, name, content):
    with zipfile.ZipFile(place / "net.pt2", "w") as archive:
        for one in parts:
            archive.writestr(one, content if one == name else parts[one])
    count("programs")
    made = read(lambda: read_exported(place / "net.pt2"))
    return None if made is None else made[0]


@given(at=st.integers(0))
def test_a_checkpoint_in_which_a_bit_has_flipped_is_refused_or_whole(place, at):
    checkpoint = Checkpoint(place / "run", "ab" * 32)
    arrays = {"pixels": np.arange(12, dtype=np.float32).reshape(3, 4), "step": np.array(7)}
    checkpoint.write(arrays, "test", 7)
    content = bytearray(checkpoint.file.read_bytes())
    at %= 8 * len(content)
    content[at // 8] ^= 1 << at % 8
    checkpoint.file.write_bytes(content)
    count("flipped bits")
    found = read(lambda: checkpoint.read("test"))
    # a bit of what is said beside the numbers, such as how many steps were done, may be another
    assert found is None or all(np.array_equal(found[name], arrays[name]) for name in arrays)


SIDES = st.sampled_from((-5, 0, 1, 3, 3000, 40_000, 10**7, 2**31, 2**62))


def make_graph(operation: str, side: int) -> bytes:
    """Of images of 8 px: their means, to which a number is added that much work may lead to."""
    from onnx import TensorProto, helper, numpy_helper

    sides = {"ConstantOfShape": [side, side], "Tile": [1, 1, side, side], "Range": side, "MatMul": [side, side],
             "Loop": side}[operation]  # fmt: skip
    stored = {"sides": np.array(sides, np.int64), "none": np.int64(0), "step": np.int64(1), "on": np.array(True)}
    nodes = [helper.make_node("ReduceMean", ["image"], ["means"], axes=[2, 3], keepdims=0)]
    if operation == "Loop":
        numbers = {"i": TensorProto.INT64, "go": TensorProto.BOOL, "x": TensorProto.FLOAT}
        body = helper.make_graph(
            [helper.make_node("Identity", ["go"], ["still"]), helper.make_node("Neg", ["x"], ["y"])], "body",
            [helper.make_tensor_value_info(name, kind, None) for name, kind in numbers.items()],
            [helper.make_tensor_value_info(name, kind, None)
             for name, kind in (("still", TensorProto.BOOL), ("y", TensorProto.FLOAT))],
        )  # fmt: skip
        nodes.append(helper.make_node("Loop", ["sides", "on", "means"], ["much"], body=body))
    elif operation == "MatMul":
        nodes.append(helper.make_node("ConstantOfShape", ["sides"], ["p0"]))
        nodes += [helper.make_node("MatMul", ["p0", f"p{k}"], [f"p{k + 1}" if k < 30 else "much"]) for k in range(31)]
    else:
        given = {"ConstantOfShape": ["sides"], "Tile": ["image", "sides"], "Range": ["none", "sides", "step"]}
        nodes.append(helper.make_node(operation, given[operation], ["some"]))
        nodes.append(helper.make_node("Cast", ["some"], ["much"], to=TensorProto.FLOAT))
    nodes.append(helper.make_node("ReduceMean", ["much"], ["number"], keepdims=0))
    nodes.append(helper.make_node("Add", ["means", "number"], ["out"]))
    graph = helper.make_graph(
        nodes, "net", [helper.make_tensor_value_info("image", TensorProto.FLOAT, ["b", 3, 8, 8])],
        [helper.make_tensor_value_info("out", TensorProto.FLOAT, ["b", 3])],
        [numpy_helper.from_array(value, name) for name, value in stored.items()],
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 11)], ir_version=7)
    return model.SerializeToString()


def read_graph(place, content):
    from toolkit.models import onnx_graphs as graphs

    (place / "net.onnx").write_bytes(content)
    count("graphs")
    return read(lambda: graphs.try_graph(graphs.read_onnx(place / "net.onnx"), 8, 1))


@pytest.mark.slow
@pytest.mark.parametrize("operation", ["ConstantOfShape", "Tile", "Range", "Loop", "MatMul"])
@settings(max_examples=settings.default.max_examples // 5)  # each in a process of its own
@given(side=SIDES)
def test_a_graph_that_asks_for_much(place, operation, side):
    pytest.importorskip("onnxruntime")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("toolkit.models.onnx_graphs.TRYING_S", 4.0)
        read_graph(place, make_graph(operation, side))


def test_a_graph_that_asks_for_little_is_read(place):
    pytest.importorskip("onnxruntime")
    assert read_graph(place, make_graph("ConstantOfShape", 3)) is True


@given(data=st.data())
def test_a_damaged_graph(place, data):
    from toolkit.models.onnx_graphs import read_onnx

    pytest.importorskip("onnx")
    (place / "net.onnx").write_bytes(data.draw(damaged(make_graph("Tile", 1))))
    count("graphs")
    read(lambda: read_onnx(place / "net.onnx"))
