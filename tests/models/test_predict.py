"""One way to ask: every pass has one shape, so that an answer depends on its own image alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from toolkit.core.errors import ToolkitError
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.network import Classifier
from toolkit.models.predict import (
    CPU_PART,
    CUDA_PART,
    ask_in_parts,
    predict,
    predict_stream,
    rank_true,
    read_answer,
)
from toolkit.models.weights import WeightsFile


class ByShape(torch.nn.Module):
    """Answers that depend on how many images are asked together, as last digits of real networks do."""

    def __init__(self):
        super().__init__()
        self.passes = []

    def forward(self, batch):
        self.passes.append((len(batch), torch.get_num_threads()))
        return batch.mean((2, 3)) * (1 + 0.1 * len(batch))


@pytest.fixture
def network():
    how = Preprocessing(16, 16, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    file = WeightsFile(Path("shape.pth"), "ab" * 32, "shape.pth")
    return Classifier("shape", ByShape().eval(), ["r", "g", "b"], how, file, "cpu", False)


@pytest.fixture
def images():
    return list(np.random.default_rng(0).integers(0, 256, (11, 16, 16, 3), np.uint8))


def test_an_answer_depends_on_its_image_alone(network, images):
    whole = predict(images, network)
    assert whole.dtype == torch.float64 and whole.shape == (11, 3) and not whole.requires_grad
    assert {size for size, _ in network.module.passes} == {CPU_PART}
    for some in ([0], [10], [3, 4, 5], list(range(10, -1, -1))):
        assert torch.equal(predict([images[k] for k in some], network), whole[some])
    floats = torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2).float().div_(255)
    assert torch.equal(predict(floats, network), whole)
    for size in (1, 5, 64):
        streamed = list(predict_stream(enumerate(images), network, size))
        assert [k for k, _ in streamed] == list(range(11))
        assert torch.equal(torch.stack([logits for _, logits in streamed]), whole)
    assert predict([], network).shape == (0, 3) and list(predict_stream([], network)) == []


def test_a_pass_runs_on_one_thread_however_many_there_are(network, images):
    threads = torch.get_num_threads()
    try:
        for count in (1, 2):
            torch.set_num_threads(count)
            predict(images, network)
            assert torch.get_num_threads() == count
    finally:
        torch.set_num_threads(threads)
    assert {used for _, used in network.module.passes} == {1}


def test_a_gpu_takes_whole_parts_as_well():
    asked = []
    rows = ask_in_parts(lambda part: asked.append(part) or torch.tensor(part), CUDA_PART + 2, "cuda")
    assert [len(part) for part in asked] == [CUDA_PART] * 2
    assert torch.cat(rows).tolist() == list(range(CUDA_PART + 2))


@pytest.mark.parametrize(("size", "count"), [(1, 4), (4, 4), (5, 8), (None, CPU_PART * torch.get_num_threads())])
def test_no_more_images_are_held_than_a_batch_of_whole_parts(network, images, size, count):
    taken = []
    stream = predict_stream(((k, taken.append(k) or image) for k, image in enumerate(images)), network, size)
    next(stream)
    assert taken == list(range(11))[:count]


def test_a_bad_answer_names_the_image(network, images):
    class Bad(torch.nn.Module):
        def forward(self, batch):
            return torch.where(batch.mean((2, 3)) > 0.9, torch.nan, 0.0)

    images[6][:] = 255
    bad = replace(network, module=Bad().eval())
    with pytest.raises(ToolkitError, match=r"not a number.*\(at 6\.png\)"):
        predict(images, bad, [f"{k}.png" for k in range(11)])
    with pytest.raises(ToolkitError, match=r"not a number.*\(at 6\.png\)"):
        list(predict_stream(enumerate(images), bad, 4, lambda k: f"{k}.png"))


def test_ties_go_to_the_lower_class():
    logits = torch.tensor([[1.0, 3.0, 3.0, 2.0]], dtype=torch.float64)
    assert rank_true(logits.expand(4, 4), torch.arange(4)).tolist() == [4, 1, 2, 3]
    answer = read_answer(logits[0], 2)
    assert (answer.top1_index, answer.true_rank) == (1, 2)
    assert answer.top1_prob == answer.true_prob == pytest.approx(1 / (2 + np.exp(-1) + np.exp(-2)))
