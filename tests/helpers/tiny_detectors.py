"""Detectors of a few hundred bytes, as ONNX graphs: every output depends on the whole image."""

import numpy as np

SIDE, CLASSES, PLACES = 32, 3, 16 + 4 + 1
"""The grids of strides 8, 16 and 32 have 21 places."""
LABELS = ["cup", "car", "dog"]


class _Graph:
    def __init__(self, seed):
        from onnx import helper, numpy_helper

        self.helper, self.numpy_helper = helper, numpy_helper
        self.nodes, self.stored, self.rng = [], [], np.random.default_rng(seed)

    def constant(self, values, kind=np.int64):
        name = f"c{len(self.stored)}"
        self.stored.append(self.numpy_helper.from_array(np.array(values, kind), name))
        return name

    def add(self, operation, *inputs, outputs=1, **attributes):
        names = [f"v{len(self.nodes)}_{k}" for k in range(outputs)]
        self.nodes.append(self.helper.make_node(operation, inputs, names, **attributes))
        return names[0] if outputs == 1 else names

    def see(self, *shape, gain=3.0, bias=0.0):
        """(b, *shape) numbers, each a convolution over the whole image."""
        count, pixels = int(np.prod(shape)), 3 * SIDE * SIDE
        weights = self.rng.normal(0, gain * pixels**-0.5, (count, 3, SIDE, SIDE))
        level = self.rng.normal(bias, 1, count)
        seen = self.add("Conv", "images", self.constant(weights, np.float32), self.constant(level, np.float32))
        return self.add("Reshape", seen, self.constant([-1, *shape]))

    def share(self, *shape):
        return self.add("Sigmoid", self.see(*shape))

    def write(self, file, outputs):
        from onnx import TensorProto, checker, helper, save

        info = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in outputs]
        given = helper.make_tensor_value_info("images", TensorProto.FLOAT, ["b", 3, SIDE, SIDE])
        graph = helper.make_graph(self.nodes, "tiny", [given], info, self.stored)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
        checker.check_model(model)
        save(model, str(file))


def write_detector(file, family, seed=0):
    """An untrained detector of that family, whose boxes lie anywhere in the image."""
    g = _Graph(seed)
    if family == "yolov8":
        boxes = g.add("Mul", g.share(4, PLACES), g.constant(SIDE, np.float32))
        out = [(g.add("Concat", boxes, g.share(CLASSES, PLACES), axis=1), ["b", 4 + CLASSES, PLACES])]
    elif family == "yolox":
        parts = (g.see(PLACES, 4, gain=1), g.share(PLACES, 1 + CLASSES))
        out = [(g.add("Concat", *parts, axis=2), ["b", PLACES, 5 + CLASSES])]
    elif family == "detr":
        out = [(g.see(5, CLASSES), ["b", 5, CLASSES]), (g.share(5, 4), ["b", 5, 4])]
    else:
        ends = g.add("Mul", g.share(PLACES, 4), g.constant(SIDE, np.float32))
        boxes, scores = g.add("Abs", ends), g.share(PLACES, CLASSES)
        best = g.add("ReduceMax", scores, axes=[2], keepdims=0)
        _, index = g.add("TopK", best, g.constant([5]), outputs=2)
        rows = g.add("Unsqueeze", index, g.constant([2]))
        chosen, kept = (g.add("GatherND", one, rows, batch_dims=1) for one in (boxes, scores))
        score = g.add("ReduceMax", kept, axes=[2], keepdims=1)
        kind = g.add("Cast", g.add("ArgMax", kept, axis=2, keepdims=1), to=1)
        out = [(g.add("Concat", chosen, score, kind, axis=2), ["b", 5, 6])]
    g.write(file, out)
    file.with_suffix(".toml").write_text(f"labels = {LABELS}")
    return file
