"""Two small towers, trained here on pictures of colours and their captions; what they answer, in NumPy."""

from pathlib import Path

import numpy as np
import torch
from torch import nn

PX, PATCH, WIDTH = 32, 8, 8
WORDS = ["[PAD]", "a", "photo", "of", "the", "thing", "red", "green", "blue", "."]
COLOURS = {"red": 0, "green": 1, "blue": 2}
TOKENS = 10
DESCRIPTION = "mean = [0.5, 0.5, 0.5]\nstd = [0.25, 0.25, 0.25]\n"


class ImageTower(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.patches, self.projection = nn.Conv2d(3, 12, PATCH, PATCH), nn.Linear(12, WIDTH, bias=False)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        return self.projection(self.patches(images).tanh().mean((2, 3)))


class TextTower(nn.Module):
    """The sum over words, of padding nothing: no length changes by padding, no direction by the number of words."""

    def __init__(self) -> None:
        super().__init__()
        self.words, self.projection = nn.Embedding(len(WORDS), 12, padding_idx=0), nn.Linear(12, WIDTH, bias=False)

    def forward(self, ids: torch.Tensor) -> torch.Tensor:
        return self.projection(self.words(ids).sum(1))


class MaskedTower(nn.Module):
    """The same by a mask, in 32-bit numbers, and a second output that is no embedding."""

    def __init__(self, tower: TextTower) -> None:
        super().__init__()
        self.tower = tower

    def forward(self, ids: torch.Tensor, mask: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        words = self.tower.words.weight[ids] * mask[:, :, None]
        return words, self.tower.projection(words.sum(1))


def draw_colours(count: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """(n, 3, PX, PX) in 0 to 1, noisy, and which channel of each is brightest."""
    draws = np.random.default_rng(seed)
    truth = draws.integers(0, 3, count)
    images = draws.random((count, 3, PX, PX)) * 0.5
    images[np.arange(count), truth] += 0.4
    return torch.from_numpy(images).float(), torch.from_numpy(truth)


def train_towers() -> tuple[ImageTower, TextTower]:
    """Contrastive, by the classes of a batch, as SigLIP and CLIP are trained on captions."""
    torch.manual_seed(0)
    image, text = ImageTower(), TextTower()
    captions = torch.tensor([[WORDS.index(word) for word in ("a", "photo", "of", name)] for name in COLOURS])
    steps = torch.optim.Adam([*image.parameters(), *text.parameters()], 0.02)
    for step in range(60):
        images, truth = draw_colours(24, step)
        cosines = nn.functional.normalize(image((images - 0.5) / 0.25)) @ nn.functional.normalize(text(captions)).T
        steps.zero_grad()
        nn.functional.cross_entropy(10 * cosines, truth).backward()
        steps.step()
    return image.eval().requires_grad_(False), text.eval().requires_grad_(False)


def write_towers(folder: Path, kind: str, towers: tuple[ImageTower, TextTower] | None = None) -> tuple[Path, Path]:
    """The files of both, with tokenizer and description: `onnx`, or `pt2`, whose text tower takes a mask."""
    image, text = towers or train_towers()
    folder.mkdir(parents=True, exist_ok=True)
    write_tokenizer(folder)
    files = folder / f"image.{kind}", folder / f"text.{kind}"
    files[0].with_suffix(".toml").write_text(DESCRIPTION, encoding="utf-8")
    if kind == "onnx":
        _write_onnx(image, text, files)
        return files
    batch = torch.export.Dim("batch")
    program = torch.export.export(image, (torch.zeros(2, 3, PX, PX),), dynamic_shapes=({0: batch},))
    torch.export.save(program, files[0])
    ids = torch.ones(2, TOKENS, dtype=torch.int64)
    program = torch.export.export(MaskedTower(text), (ids, ids.clone()), dynamic_shapes=({0: batch}, {0: batch}))
    torch.export.save(program, files[1])
    return files


def write_tokenizer(folder: Path) -> None:
    import tokenizers

    made = tokenizers.Tokenizer(
        tokenizers.models.WordLevel({word: k for k, word in enumerate(WORDS)}, unk_token="thing")
    )
    made.pre_tokenizer = tokenizers.pre_tokenizers.Whitespace()
    made.save(str(folder / "tokenizer.json"))
    (folder / "tokenizer_config.json").write_text('{"model_max_length": 10, "pad_token": "[PAD]"}', encoding="utf-8")


def _write_onnx(image: ImageTower, text: TextTower, files: tuple[Path, Path]) -> None:
    import onnx

    make, info = onnx.helper.make_node, onnx.helper.make_tensor_value_info
    of_image = [
        make("Conv", ["images", "kernel", "bias"], ["c"], strides=[PATCH, PATCH]), make("Tanh", ["c"], ["t"]),
        make("ReduceMean", ["t"], ["m"], axes=[2, 3], keepdims=0), make("MatMul", ["m", "matrix"], ["out"]),
    ]  # fmt: skip
    of_text = [
        make("Gather", ["words", "ids"], ["w"]), make("ReduceSum", ["w"], ["s"], axes=[1], keepdims=0),
        make("MatMul", ["s", "matrix"], ["out"]),
    ]  # fmt: skip
    for file, nodes, given, stored in (
        (files[0], of_image, info("images", 1, ["b", 3, PX, PX]), {
            "kernel": image.patches.weight, "bias": image.patches.bias, "matrix": image.projection.weight.T}),
        (files[1], of_text, info("ids", 7, ["b", "n"]),
         {"words": text.words.weight, "matrix": text.projection.weight.T}),
    ):  # fmt: skip
        tensors = [onnx.numpy_helper.from_array(one.contiguous().numpy(), name) for name, one in stored.items()]
        graph = onnx.helper.make_graph(nodes, "tower", [given], [info("out", 1, ["b", WIDTH])], tensors)
        onnx.save(onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 11)], ir_version=7), file)


def answer_in_numpy(
    towers: tuple[ImageTower, TextTower], images: np.ndarray, prompts: dict[str, list[str]], scale: float
) -> np.ndarray:
    """(n, classes) logits in double precision of (n, 3, PX, PX) images in 0 to 1, by the definition."""
    image, text = towers
    cut = PX // PATCH
    pieces = ((images - 0.5) / 0.25).reshape(-1, 3, cut, PATCH, cut, PATCH).transpose(0, 2, 4, 1, 3, 5)
    kernel, bias, matrix = (
        one.double().numpy() for one in (image.patches.weight, image.patches.bias, image.projection.weight)
    )
    found = np.tanh(pieces.reshape(len(images), cut * cut, -1) @ kernel.reshape(len(kernel), -1).T + bias)
    features = found.mean(1) @ matrix.T
    table = text.words.weight.double().numpy() @ text.projection.weight.double().numpy().T
    classes = []
    for texts in prompts.values():
        each = []
        for line in texts:
            words = line.replace(".", " . ").split()
            each.append(sum(table[WORDS.index(word if word in WORDS else "thing")] for word in words))
        units = [one / np.linalg.norm(one) for one in each]
        classes.append(np.mean(units, 0) / np.linalg.norm(np.mean(units, 0)))
    return scale * (features / np.linalg.norm(features, axis=1, keepdims=True)) @ np.array(classes).T
