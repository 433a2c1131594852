"""Predictions of a network: every answer depends on its own image alone, whatever else is in the batch."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from toolkit.core.errors import FieldError
from toolkit.core.lazy import torch
from toolkit.core.threads import run_each
from toolkit.models.network import AnyNetwork, BadAnswer, check_finite

CPU_PART, CUDA_PART = 4, 32
"""Images in a pass. Passes of the same shape, on a CPU on one thread, give an image the same numbers in any batch."""
GPU_PARTS = 4
"""Parts that are held for a GPU at once, so that images are decoded while it works."""
Tag = TypeVar("Tag")


class LogitNetwork(AnyNetwork, Protocol):
    """A network that gives a number for each class."""

    def logits(self, batch: "torch.Tensor") -> "torch.Tensor":
        """(b, 3, h, w) float tensor, sRGB-encoded in [0, 1], to (b, classes)."""


class RankedAnswer(NamedTuple):
    """Answer of a classifier to an image.

    Attributes:
        top1_index, top1_prob: its first guess.
        true_prob, true_rank: probability of the true class, and its place among the guesses, from 1.
    """

    top1_index: int
    top1_prob: float
    true_prob: float
    true_rank: int


def predict(
    images: "torch.Tensor | Sequence[np.ndarray]",
    network: LogitNetwork,
    names: Sequence[str] = (),
    part: int = CPU_PART,
) -> "torch.Tensor":
    """Return a network's answers to images, without gradient.

    An answer depends on its own image alone: images are asked in parts of the same size, the last part filled up.

    Args:
        images: (n, 3, h, w) float tensor, sRGB-encoded in [0, 1]; or (h, w, 3) uint8 sRGB arrays of the same size.
        network: a classifier.
        names: names of the images, for errors.
        part: images in a pass on a CPU.

    Returns:
        (n, classes) float64 logits, on the CPU.

    Raises:
        ToolkitError: an answer is not finite, or a part does not fit the GPU.
    """

    def ask(chosen: list[int]) -> torch.Tensor:
        if isinstance(images, torch.Tensor):
            batch = images[chosen]
        else:
            pixels = torch.from_numpy(np.stack([images[k] for k in chosen]))
            batch = pixels.to(network.device).permute(0, 3, 1, 2).float().div_(255)
        with torch.inference_mode():
            logits = network.logits(batch).double().cpu()
        check_finite(logits, network.arch, network.weights)
        return logits

    if not len(images):
        return torch.zeros(0, len(network.labels), dtype=torch.float64)
    return torch.cat(ask_in_parts(ask, len(images), network.device, names, part))


def ask_in_parts(
    ask: "Callable[[list[int]], torch.Tensor]", count: int, device: str, names: Sequence[str] = (),
    part: int = CPU_PART,
) -> "list[torch.Tensor]":  # fmt: skip
    """Call `ask` with the numbers of some images at a time, always as many; return its rows, a tensor for each part.

    Args:
        ask: numbers of images, to a tensor with a row for each.
        count: number of images.
        device: cpu, where each part has its own thread, or a GPU, which takes the parts in turn.
        names: names of the images, for errors.
        part: images at a time on a CPU.

    Raises:
        ToolkitError: a `BadAnswer`, with the image's name; a part does not fit the GPU.
    """
    size = part if device == "cpu" else CUDA_PART
    parts = [range(start, min(start + size, count)) for start in range(0, count, size)]
    rows: dict[int, torch.Tensor] = {}

    def work(number: int) -> None:
        own = parts[number]
        try:
            # filled up with copies: a pass of another shape may give other last digits
            rows[number] = ask([*own, *[own[-1]] * (size - len(own))])[: len(own)]
        except BadAnswer as error:
            raise (error.at([names[k] for k in own]) if names else error) from None
        except torch.cuda.OutOfMemoryError:
            raise FieldError(f"{size} images do not fit the GPU's memory: use the cpu", {"device": device}) from None

    if device == "cpu":
        run_each(work, len(parts))
    else:
        for number in range(len(parts)):
            work(number)
    return [rows[number] for number in range(len(parts))]


def predict_stream(
    images: Iterable[tuple[Tag, np.ndarray]], network: LogitNetwork, batch_size: int | None = None,
    name_of: Callable[[Tag], str] | None = None,
) -> "Iterator[tuple[Tag, torch.Tensor]]":  # fmt: skip
    """Yield each image's tag and its (classes,) logits in order, see `predict`; at most a batch is held.

    Args:
        images: pairs of a tag, which returns with the answer, and (h, w, 3) uint8 sRGB.
        network: a classifier.
        batch_size: images in a batch, rounded up to whole parts; by default as many as keep its device busy.
        name_of: the image's name by its tag, for errors.

    Raises:
        ToolkitError: as `predict`.
    """
    on_cpu, rest = network.device == "cpu", iter(images)
    part = CPU_PART if on_cpu else CUDA_PART
    # a part for each thread: more would only cost memory
    parts = torch.get_num_threads() if on_cpu else GPU_PARTS
    size = part * (-(-batch_size // part) if batch_size else parts)
    while batch := list(islice(rest, size)):
        names = [name_of(tag) for tag, _ in batch] if name_of else []
        answers = predict([image for _, image in batch], network, names)
        yield from ((tag, answer) for (tag, _), answer in zip(batch, answers, strict=True))


def rank_true(logits: "torch.Tensor", classes: "torch.Tensor") -> "torch.Tensor":
    """(n,) place of each image's class among the guesses (n, classes), from 1; ties go to the lower index."""
    true = classes.to(logits.device)[:, None]
    own = logits.gather(1, true)
    earlier = torch.arange(logits.shape[1], device=logits.device) < true
    # counting who is ahead costs less than sorting a thousand classes
    return ((logits > own) | ((logits == own) & earlier)).sum(1) + 1


def read_answer(logits: "torch.Tensor", true_index: int) -> RankedAnswer:
    """Return the answer to an image of a class from (classes,) logits of `predict`."""
    chances, first = logits.softmax(0), int(logits.argmax())
    (rank,) = rank_true(logits[None], torch.tensor([true_index])).tolist()
    return RankedAnswer(first, float(chances[first]), float(chances[true_index]), rank)
