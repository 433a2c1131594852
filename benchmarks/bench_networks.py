"""An ONNX classifier against ONNX Runtime alone, and a detector's evaluation against its bare forward.

Both sides of a ratio run in this process with the same threads and batch, in turns, so that a busy machine slows both.
The graphs are made here with random weights: their speed does not depend on them.
"""

import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

from benchmarks.bench_eval import BATCH, write_photographs

ROUNDS = 5
PHOTOS = 64
WIDTHS = (3, 32, 64, 128, 128, 256)


def write_graph(file: Path, size: int, ending: str) -> None:
    """Convolutions that halve the side four times; `ending` is `classes` (1000) or `grid` (FastestDet's outputs)."""
    import numpy as np
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    rng = np.random.default_rng(0)
    nodes, stored, last = [], [], "image"
    for k in range(len(WIDTHS) - 1):
        shape = (WIDTHS[k + 1], WIDTHS[k], 3, 3)
        stored.append(numpy_helper.from_array(rng.normal(0, 0.05, shape).astype(np.float32), f"w{k}"))
        stride = [2, 2] if k < 4 else [1, 1]
        nodes.append(helper.make_node("Conv", [last, f"w{k}"], [f"c{k}"], strides=stride, pads=[1, 1, 1, 1]))
        nodes.append(helper.make_node("Relu", [f"c{k}"], [f"r{k}"]))
        last = f"r{k}"
    if ending == "classes":
        stored.append(numpy_helper.from_array(rng.normal(0, 1, (WIDTHS[-1], 1000)).astype(np.float32), "head"))
        nodes.append(helper.make_node("ReduceMean", [last], ["mean"], axes=[2, 3], keepdims=0))
        nodes.append(helper.make_node("MatMul", ["mean", "head"], ["out"]))
        shape = ["b", 1000]
    else:
        stored.append(numpy_helper.from_array(rng.normal(0, 0.1, (85, WIDTHS[-1], 1, 1)).astype(np.float32), "head"))
        nodes.append(helper.make_node("Conv", [last, "head"], ["raw"]))
        nodes.append(helper.make_node("Sigmoid", ["raw"], ["out"]))
        shape = ["b", 85, size // 16, size // 16]
    graph = helper.make_graph(
        nodes, "net", [helper.make_tensor_value_info("image", TensorProto.FLOAT, ["b", 3, size, size])],
        [helper.make_tensor_value_info("out", TensorProto.FLOAT, shape)], stored,
    )  # fmt: skip
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 11)], ir_version=7), file)


Times = tuple[float, float]
"""Seconds by the clock, and of the processor."""


def take_turns(ours: Callable[[], None], bare: Callable[[], None]) -> tuple[Times, Times]:
    """Median seconds of each; the first turn, which warms caches and kernels, does not count."""
    seconds: tuple[list[Times], list[Times]] = ([], [])
    for turn in range(ROUNDS + 1):
        for times, work in zip(seconds, (ours, bare), strict=True):
            start = time.perf_counter(), time.process_time()
            work()
            if turn:
                times.append((time.perf_counter() - start[0], time.process_time() - start[1]))
    first, second = ((median(one[0] for one in times), median(one[1] for one in times)) for times in seconds)
    return first, second


def start_runtime(file: Path) -> Callable[[int, int], None]:
    """ONNX Runtime alone: (images, batch) -> their outputs are computed."""
    import numpy as np
    import onnxruntime
    import torch

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    session = onnxruntime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    side = session.get_inputs()[0].shape[2]

    def run(count: int, batch: int) -> None:
        images = np.random.default_rng(0).random((batch, 3, side, side), np.float32)
        for _ in range(count // batch):
            session.run(None, {"image": images})

    return run


def measure_classifier(folder: Path) -> tuple[Times, Times]:
    """Seconds of `Classifier.logits` on a batch in memory, and of ONNX Runtime alone."""
    import torch

    from toolkit.models.load import load_classifier

    file = folder / "classes.onnx"
    write_graph(file, 224, "classes")
    classifier, bare = load_classifier(f"onnx:{file}", device="cpu"), start_runtime(file)
    batch = torch.rand(BATCH, 3, 224, 224)

    def ours() -> None:
        with torch.inference_mode():
            for _ in range(PHOTOS // BATCH):
                classifier.logits(batch)

    return take_turns(ours, lambda: bare(PHOTOS, BATCH))


def measure_detector(folder: Path) -> tuple[Times, Times]:
    """Seconds of looking at JPEG files, and of ONNX Runtime alone on as many images."""
    import numpy as np

    from toolkit.captures.read import read_captures
    from toolkit.captures.truth import ObjectMask
    from toolkit.evaluation import detect
    from toolkit.models.load_detector import load_detector

    file = folder / "grid.onnx"
    write_graph(file, 352, "grid")
    detector, bare = load_detector(f"onnx:{file}", device="cpu"), start_runtime(file)
    write_photographs(folder / "captures" / "real" / "racer" / "unpatched", PHOTOS)
    captures = read_captures(folder / "captures").captures
    truth = ObjectMask(np.zeros((480, 640), bool), (100.0, 100.0, 300.0, 300.0))
    truths = {one.file: truth for one in captures}

    def ours() -> None:
        detect.detect_captures(captures, truths, {"racer": 2}, detector)

    return take_turns(ours, lambda: bare(PHOTOS, detect.BATCH))


def run() -> dict[str, float]:
    """Ratios; the marks are 0.9 for both. A busy machine changes those of the processor's time least."""
    with tempfile.TemporaryDirectory() as name:
        ours, runtime = measure_classifier(Path(name))
        looked, bare = measure_detector(Path(name))
    return {
        "ONNX classifier images/s": PHOTOS / ours[0],
        "ONNX Runtime images/s": PHOTOS / runtime[0],
        "ONNX classifier: ratio to ONNX Runtime": runtime[0] / ours[0],
        "ONNX classifier: ratio of processor time": runtime[1] / ours[1],
        "detector evaluation images/s": PHOTOS / looked[0],
        "detector evaluation: ratio to its forward": bare[0] / looked[0],
        "detector evaluation: ratio of processor time": bare[1] / looked[1],
    }


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
