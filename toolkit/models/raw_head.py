"""Boxes and scores of all places in a graph that selects the best by itself: only these have a gradient."""

from collections import deque
from typing import TYPE_CHECKING

from toolkit.models.onnx_graphs import Shapes, import_extra, infer_shapes, list_inputs

if TYPE_CHECKING:
    from onnx import ModelProto, NodeProto


def find_raw_head(model: "ModelProto", places: list[int]) -> "tuple[str, str] | None":
    """Find the names of the tensors with boxes and with scores before a graph's selection; None without any.

    They are the first tensors, seen from the output, with a row for every place. Scores lead to a TopK, boxes do not.

    Args:
        model: its first output is the selection.
        places: possible numbers of places, see `count_places`.
    """
    makers = {name: node for node in model.graph.node for name in node.output}
    shapes = infer_shapes(model)
    found = _first_behind(model.graph.output[0].name, makers, shapes, places)
    # scores are what the graph selects by: they lead to a TopK
    tops = [node.input[0] for node in model.graph.node if node.op_type == "TopK"]
    scores = {name for top in tops for name in _first_behind(top, makers, shapes, places)}
    boxes = [name for name in found if name not in scores and shapes[name][2] == 4]
    return (boxes[0], next(iter(scores))) if len(boxes) == len(scores) == 1 and len(found) == 2 else None


def _first_behind(name: str, makers: "dict[str, NodeProto]", shapes: Shapes, places: list[int]) -> list[str]:
    found, seen, waiting = list[str](), {name}, deque([name])
    while waiting:
        tensor = waiting.popleft()
        shape = shapes.get(tensor, [])
        if len(shape) == 3 and shape[1] in places:
            found.append(tensor)
        elif tensor in makers:
            fresh = [given for given in makers[tensor].input if given and given not in seen]
            seen.update(fresh)
            waiting.extend(fresh)
    return found


def cut_raw_head(model: "ModelProto", places: list[int]) -> "ModelProto | None":
    """A copy whose outputs are the tensors of `find_raw_head`; None: there are none."""
    names = find_raw_head(model, places)
    if names is None:
        return None
    onnx = import_extra("onnx")
    extractor = onnx.utils.Extractor(onnx.shape_inference.infer_shapes(model))
    cut: ModelProto = extractor.extract_model([entry.name for entry in list_inputs(model)], list(names))
    return cut
