"""Read ONNX graphs, free them of a fixed batch size, try them in a child process, and run them by ONNX Runtime.

A graph may come from anybody, and may run for ever or take all memory. A child process tries it first, with limits on
time and memory, on a single image and on two. Then it runs in this process, as a child for every batch would copy
images and hold the graph twice. Loops may depend on the image, so every run has a timeout.
"""

import ast
import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from toolkit.core.child import LATE, is_memory_full, limit_cores, limit_memory, run_python
from toolkit.core.errors import ToolkitError, describe_failure, foreign_code
from toolkit.core.extras import import_package
from toolkit.core.files import sha256_bytes, sha256_file
from toolkit.models.labels import find_labels
from toolkit.models.weights import LOADING_BYTES, TRYING_BYTES, WeightsFile, open_weights

if TYPE_CHECKING:
    from onnx import ModelProto, NodeProto, ValueInfoProto
    from onnxruntime import InferenceSession

QUANTISED = ("QuantizeLinear", "DequantizeLinear", "DynamicQuantizeLinear", "QLinearConv", "QLinearMatMul",
             "ConvInteger", "MatMulInteger")  # fmt: skip
FLOAT, STRING, FLOAT16 = 1, 8, 10
"""Numbers of `TensorProto.DataType`."""
MOST_NAMES = 200_000
"""Most letters of the names of classes."""
MOST_MISFITS = 500
"""Most shapes that are freed of the batch size: each takes a shape inference of the whole graph."""
SAME_ANSWER = 1e-3
"""Share of the largest output by which two ways of running a graph may differ: above rounding, below a fault."""
START_S, IMAGE_S, TRYING_S = 20.0, 10.0, 60.0
"""Timeouts of a run, for each of its images more, and of a graph's trial on a core."""


@dataclass(frozen=True)
class OnnxGraph:
    """An ONNX network that takes a batch of square colour images.

    Attributes:
        file: its file; the hash covers files with weights beside it.
        model: the graph.
        input_name: name of the input.
        is_nhwc: whether the images' channels come last.
        size: side of the images; None: any.
        batch: number of images at once; None: any.
        is_half: whether it takes numbers of 16 bits.
        is_quantised: whether it computes in integers.
    """

    file: WeightsFile
    model: "ModelProto"
    input_name: str
    is_nhwc: bool
    size: int | None
    batch: int | None
    is_half: bool
    is_quantised: bool


import_extra = partial(import_package, extra="onnx", what="an ONNX file")


def load_model(path: Path) -> "ModelProto":
    """Read a graph with the weights that lie beside it; nothing in it is run.

    Raises:
        ToolkitError: the file cannot be read, or gives something other than numbers.
    """
    onnx = import_extra("onnx")

    def explain(error: Exception) -> ToolkitError:
        if isinstance(error, OSError):
            return ToolkitError(f"cannot read {path}: {error.strerror or error}")
        return ToolkitError(f"cannot read {path}: not an ONNX graph, or damaged: export it again")

    with foreign_code(explain):
        # weights of large graphs lie in files beside: read the graph first, and see whether they are there
        beside = _list_beside(onnx.load(str(path), load_external_data=False))
        missing = [name for name in beside if not (path.parent / name).is_file()]
        if missing:
            raise ToolkitError(f"{path}: its weights lie in '{missing[0]}', which is not beside it: copy that file too")
        # a damaged graph may ask for far more memory than its files hold
        size = sum(file.stat().st_size for file in (path, *map(path.with_name, beside)))
        with limit_memory(LOADING_BYTES + 3 * size):
            model = onnx.load(str(path))
            onnx.checker.check_model(model)
    for entry in model.graph.output:
        if entry.type.WhichOneof("value") != "tensor_type" or entry.type.tensor_type.elem_type == STRING:
            raise ToolkitError(f"{path}: its output '{entry.name}' is no tensor of numbers: export it with numbers")
    if not model.graph.output:
        raise ToolkitError(f"{path}: it has no output: expected numbers for each image: export it again")
    return model


def list_inputs(model: "ModelProto") -> "list[ValueInfoProto]":
    """List the inputs of a graph that are not among its weights."""
    stored = {tensor.name for tensor in model.graph.initializer}
    return [entry for entry in model.graph.input if entry.name not in stored]


def read_onnx(path: Path) -> OnnxGraph:
    """Read a graph that takes images; nothing in it is run.

    Raises:
        ToolkitError: the file cannot be read, or takes something other than a batch of square colour images.
    """
    # weights are inputs as well in older files, and are left out
    onnx, model = import_extra("onnx"), load_model(path)
    graph, inputs = model.graph, list_inputs(model)
    if len(inputs) != 1:
        names = ", ".join(entry.name for entry in inputs) or "none"
        raise ToolkitError(f"{path}: has {len(inputs)} inputs ({names}): expected a batch of images alone")
    kind = inputs[0].type.tensor_type
    if kind.elem_type not in (FLOAT, FLOAT16):
        kinds = {number: name.lower() for name, number in onnx.TensorProto.DataType.items()}
        found = kinds.get(kind.elem_type, "an unknown kind")
        raise ToolkitError(f"{path}: its input '{inputs[0].name}' is of {found}: expected float: export it so")
    # the layout and side of the images, as far as the graph fixes them
    sides = [dim.dim_value or None for dim in kind.shape.dim]
    is_nhwc, size = _read_layout(path, inputs[0].name, sides)
    operations = {node.op_type for node in graph.node}
    return OnnxGraph(
        file=hash_whole(path), model=model, input_name=inputs[0].name, is_nhwc=is_nhwc, size=size,
        batch=sides[0], is_half=kind.elem_type == FLOAT16,
        is_quantised=not operations.isdisjoint(QUANTISED),
    )  # fmt: skip


def read_output_shapes(graph: OnnxGraph) -> list[tuple[int | None, ...]]:
    """Return the declared shape of each output, None for an open axis; empty without a shape."""
    return [
        tuple(dim.dim_value or None for dim in entry.type.tensor_type.shape.dim) for entry in graph.model.graph.output
    ]


def read_names(graph: OnnxGraph) -> list[str] | None:
    """Return the names of its classes, as Ultralytics writes them into a graph; None without any."""
    text = next((prop.value for prop in graph.model.metadata_props if prop.key == "names"), "")
    try:
        return find_labels(ast.literal_eval(text[:MOST_NAMES]))
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return None


def _read_layout(path: Path, name: str, sides: list[int | None]) -> tuple[bool, int | None]:
    """Return whether channels come last, and the side of the images; None: any."""
    shown = "×".join("?" if side is None else str(side) for side in sides) or "a single number"
    expected = f"{path}: its input '{name}' is {shown}"
    if len(sides) != 4:
        raise ToolkitError(f"{expected}: expected a batch of colour images, b×3×h×w or b×h×w×3")
    is_nhwc = sides[3] == 3 and sides[1] != 3
    channels, (height, width) = (sides[3], sides[1:3]) if is_nhwc else (sides[1], sides[2:])
    if channels not in (3, None):
        raise ToolkitError(f"{expected}: expected colour images, of 3 channels")
    if height != width:
        raise ToolkitError(f"{expected}: expected square images: export it for a square")
    return is_nhwc, height


def hash_whole(path: Path) -> WeightsFile:
    """Return the file, with a hash that covers weights in files beside it."""
    beside, file = _list_beside(import_extra("onnx").load(str(path), load_external_data=False)), open_weights(path)
    if not beside:
        return file
    hashes = [file.sha256, *(sha256_file(path.parent / name) for name in beside)]
    return WeightsFile(path, sha256_bytes(" ".join(hashes).encode()), file.name)


def _list_beside(model: "ModelProto") -> list[str]:
    """List the files with weights that a graph names, which was read without them."""
    entries = [entry for tensor in model.graph.initializer for entry in tensor.external_data if entry.key == "location"]
    return sorted({entry.value for entry in entries})


def start_session(model: "ModelProto", path: Path, threads: int) -> "InferenceSession":
    """ONNX Runtime on the CPU.

    Raises:
        ToolkitError: an operator is unknown, or the graph is inconsistent.
    """
    runtime = import_extra("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 4  # what is wrong is raised as well

    def explain(error: Exception) -> ToolkitError:
        why = "its operations do not fit together: export it again"
        if is_memory_full(error):
            why = "it takes too much memory"
        elif "IR version" in str(error) or "opset" in str(error):
            why = "it needs a newer ONNX: upgrade onnxruntime, or export it with an older opset"
        # an unknown operator explains the failure best
        known = {(schema.domain, schema.name) for schema in import_extra("onnx").defs.get_all_schemas_with_history()}
        for node in model.graph.node:
            if (node.domain, node.op_type) not in known:
                name = f"{node.domain or 'ai.onnx'}.{node.op_type}"
                why = f"its operator {name} is none of ONNX's: export it with standard operators"
                break
        return ToolkitError(f"{path}: ONNX Runtime cannot run it: {why}")

    with foreign_code(explain):
        return runtime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])


def set_input(model: "ModelProto", name: str, batch: int | str | None = None, size: int | None = None) -> None:
    """Change the batch, and the side of images of any size, that the input `name` declares."""
    for entry in model.graph.input:
        if entry.name == name:
            dims = entry.type.tensor_type.shape.dim
            if isinstance(batch, str):
                dims[0].dim_param = batch
            elif batch is not None:
                dims[0].dim_value = batch
            for dim in dims[1:]:
                if size is not None and not dim.dim_value:
                    dim.dim_value = size


def free_batch(graph: OnnxGraph) -> "ModelProto":
    """Return a copy that takes any number of images, of a graph for a fixed number.

    The targets of Reshape and the sizes of Resize fix the number. Shapes are inferred for the number and for twice of
    it; the axis that differs holds the batch, and is left open. The caller compares the copy's answers.
    """
    onnx = import_extra("onnx")
    model = onnx.ModelProto()
    model.CopyFrom(graph.model)
    # shapes for the number that it was exported for, and for twice as many
    before = infer_shapes(model)
    set_input(model, graph.input_name, 2 * (graph.batch or 1))
    # stated output shapes would contradict the doubled batch
    for entry in model.graph.output:
        entry.type.tensor_type.ClearField("shape")
    # each round frees the first node that does not fit; shapes behind it may then fit by themselves
    for _ in model.graph.node[:MOST_MISFITS]:
        misfit = next(_find_misfits(model, before, infer_shapes(model)), None)
        if misfit is None:
            break
        node, place, values = misfit
        name = f"{node.output[0]}_freed"
        model.graph.initializer.append(onnx.numpy_helper.from_array(values, name))
        node.input[place] = name
        del node.input[place + 1 :]
    # the batch is open from here on; shapes that were inferred for a number are stale
    set_input(model, graph.input_name, "batch")
    del model.graph.value_info[:]
    return model


Shapes = dict[str, list[int | None]]


def infer_shapes(model: "ModelProto") -> Shapes:
    """Return the shape of every tensor that ONNX infers, None for an open axis."""
    onnx = import_extra("onnx")
    bare = onnx.ModelProto()
    bare.CopyFrom(model)
    # the exporter's shapes would be kept, though they are of another batch
    del bare.graph.value_info[:]
    inferred = onnx.shape_inference.infer_shapes(bare).graph
    known = [*inferred.input, *inferred.value_info, *inferred.output]
    return {record.name: [dim.dim_value or None for dim in record.type.tensor_type.shape.dim] for record in known}


def _find_misfits(model: "ModelProto", before: Shapes, after: Shapes) -> "Iterator[tuple[NodeProto, int, np.ndarray]]":
    """Yield nodes with a constant shape that fixes the batch: (node, place of the input, the new value)."""
    constants = _find_constants(model)
    for node in model.graph.node:
        if node.op_type not in ("Reshape", "Resize"):
            continue
        # the axis that grew with the batch, if no other did
        source, made = before.get(node.input[0], []), before.get(node.output[0], [])
        doubled = after.get(node.input[0], [])
        if len(doubled) != len(source):
            continue
        grown = [axis for axis in range(len(source)) if source[axis] != doubled[axis]]
        if len(grown) != 1 or None in source or None in made:
            continue
        if node.op_type == "Reshape" and node.input[1] in constants:
            # the axis of the target that holds the batch becomes -1, "whatever is left"
            target = constants[node.input[1]].tolist()
            # row by row: the batch stays where as many numbers come before it
            ahead = prod(side or 1 for side in source[: grown[0]])
            axis = next((k for k in range(len(made)) if prod(side or 1 for side in made[:k]) == ahead), None)
            if axis is not None and target[axis] != -1 and not (target[axis] == 0 and axis == grown[0]):
                yield node, 1, np.array([*made[:axis], -1, *made[axis + 1 :]], np.int64)
        elif node.op_type == "Resize" and len(node.input) > 3 and node.input[3] in constants:
            # scales leave the batch open where sizes fix it
            scales = np.array(made, np.float64) / np.array(source, np.float64)
            yield node, 2, scales.astype(np.float32)


def _find_constants(model: "ModelProto") -> dict[str, np.ndarray]:
    onnx = import_extra("onnx")
    found = {
        tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in model.graph.initializer if prod(tensor.dims) < 16
    }
    for node in model.graph.node:
        if node.op_type == "Constant" and node.attribute and node.attribute[0].name == "value":
            found[node.output[0]] = onnx.numpy_helper.to_array(node.attribute[0].t)
    return found


def run_session(session: "InferenceSession", graph: OnnxGraph, images: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the outputs for (b, 3, h, w) float32 images.

    Raises:
        ToolkitError: it fails at them, takes too long or too much memory, or gives something other than numbers.
    """
    arranged = np.ascontiguousarray(images.transpose(0, 2, 3, 1)) if graph.is_nhwc else images
    given = {graph.input_name: arranged.astype(np.float16) if graph.is_half else arranged}
    return run_inputs(session, graph.file.path, given, f"{len(images)} images of {images.shape[2]} px")


def run_inputs(
    session: "InferenceSession", path: Path, given: dict[str, np.ndarray], what: str
) -> tuple[np.ndarray, ...]:
    """Return the outputs for arrays by the names of their inputs, each of as many rows; `what` names them in errors.

    Raises:
        ToolkitError: as `run_session`.
    """
    # a minimum for the first pass, and more for each image
    count = len(next(iter(given.values())))
    how, most_s = import_extra("onnxruntime").RunOptions(), START_S + IMAGE_S * count
    how.log_severity_level = 4  # what is wrong is raised as well
    watch = threading.Timer(most_s, setattr, (how, "terminate", True))  # a loop in a graph may have no end
    watch.daemon = True

    def explain(error: Exception) -> ToolkitError:
        why = f"its operations fail at {what}"
        if is_memory_full(error):
            why = "it takes too much memory"
        elif how.terminate:
            why = _late(most_s)
        return ToolkitError(f"{path}: ONNX Runtime cannot run it: {why}")

    watch.start()
    try:
        with foreign_code(explain):
            answers = session.run(None, given, how)
    finally:
        watch.cancel()
    if not all(isinstance(answer, np.ndarray) and answer.dtype.kind in "fiub" and answer.ndim for answer in answers):
        raise ToolkitError(f"{path}: its outputs are not tensors with numbers for each image: export it so")
    return tuple(answers)


def join_answers(graph: OnnxGraph, answers: list[tuple[np.ndarray, ...]]) -> tuple[np.ndarray, ...]:
    """Join the outputs of several runs.

    Raises:
        ToolkitError: they differ in shape.
    """
    if any(len({part.shape[1:] for part in parts}) > 1 for parts in zip(*answers, strict=True)):
        raise ToolkitError(f"{graph.file.path}: its outputs have another shape for another image")
    return tuple(map(np.concatenate, zip(*answers, strict=True)))


def are_alike(found: tuple[np.ndarray, ...], wanted: tuple[np.ndarray, ...]) -> bool:
    """Whether two ways of running a graph gave the same outputs, but for rounding."""
    if [output.shape for output in found] != [output.shape for output in wanted]:
        return False
    return all(
        np.isfinite(right).all()
        and np.abs(left - right).max(initial=0) <= SAME_ANSWER * max(1.0, np.abs(right).max(initial=0))
        for left, right in zip(found, wanted, strict=True)
    )


def draw_sample(size: int) -> np.ndarray:
    """Return (2, 3, size, size) float32 noise to try graphs on."""
    return np.random.default_rng(0).random((2, 3, size, size), np.float32)


def try_graph(graph: OnnxGraph, size: int, threads: int) -> bool:
    """Run a graph for the first time, in a child process; return whether it takes any number of images.

    If only its copy by `free_batch` does, the copy takes its place in `graph.model`.

    Raises:
        ToolkitError: it cannot be run, does not end, takes too much memory or several images at once.
    """
    path = graph.file.path
    if graph.batch not in (None, 1):
        raise ToolkitError(f"{path}: takes exactly {graph.batch} images at once: export it with a free batch, or for 1")
    room = TRYING_BYTES + 6 * graph.model.ByteSize()
    # in a child: a graph can end the process, or take all memory
    code = f"from toolkit.models.onnx_graphs import _try; print(_try({str(path)!a}, {size}, {threads}, {room}))"
    done = run_python(code, most_s=TRYING_S * threads)
    told = done.stdout.decode("utf-8", "replace").splitlines()
    if done.returncode or not told:
        # what ends a process cannot be caught in it
        why = _late(TRYING_S) if done.returncode == LATE else f"it ended the process that tried it ({done.returncode})"
        raise ToolkitError(f"{path}: ONNX Runtime cannot run it: {why}")
    answer = json.loads(told[-1])
    if "error" in answer:
        raise ToolkitError(answer["error"])
    # the image side is fixed, the batch as open as the graph allows
    set_input(graph.model, graph.input_name, size=size)
    if answer["freed"]:
        graph.model.CopyFrom(free_batch(graph))
    return graph.batch is None or answer["freed"]


def _late(seconds: float) -> str:
    return f"it has no answer after {seconds:.0f} s: it may hold an endless loop"


def _try(path: str, size: int, threads: int, most_bytes: int) -> str:
    """Try a graph in this process, which may end by it; return the result as JSON."""
    limit_cores(threads)
    try:
        graph = read_onnx(Path(path))
        set_input(graph.model, graph.input_name, size=size)
        with limit_memory(most_bytes):
            return json.dumps({"freed": _is_freed(graph, draw_sample(size), threads)})
    except ToolkitError as error:
        return json.dumps({"error": str(error)})


def _is_freed(graph: OnnxGraph, sample: np.ndarray, threads: int) -> bool:
    whole = start_session(graph.model, graph.file.path, threads)
    if graph.batch is None:
        run_session(whole, graph, sample)
        return False
    # the network's answers to single images: the freed copy must give the same for both at once
    wanted = join_answers(graph, [run_session(whole, graph, sample[k : k + 1]) for k in range(2)])
    try:
        # shapes of a strange graph cannot be worked out, or do not fit another batch
        with foreign_code(lambda error: ToolkitError(describe_failure(error))):
            session = start_session(free_batch(graph), graph.file.path, threads)
            return are_alike(run_session(session, graph, sample), wanted)
    except ToolkitError:
        return False
