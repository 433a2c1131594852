"""An encoder gets a head: the file answers as encoder and head do, judges, and trains a booster."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import torchvision
from colour_folder import write_colours
from one_line import error_of
from safetensors.torch import save_file
from torch import nn

from toolkit.core.workspace import make_workspace
from toolkit.models.encoders import load_encoder
from toolkit.models.heads import AsEncoder, Head, join_head
from toolkit.models.identity import describe_network
from toolkit.models.load import load_classifier
from toolkit.training.head import fit_linear, fit_means, train_head
from toolkit.training.head_config import HeadConfig

pytestmark = pytest.mark.usefixtures("forked_trials")
PX, WIDTH = 32, 12


class Tokens(nn.Module):
    """A map of patches, and its tokens, as transformers give them."""

    def __init__(self, ending: str) -> None:
        super().__init__()
        self.patches, self.ending = nn.Conv2d(3, WIDTH, 8, 8), ending

    def forward(self, batch):
        found = self.patches(batch).tanh()
        if self.ending == "map":
            return found
        tokens = found.flatten(2).transpose(1, 2)
        return tokens if self.ending == "tokens" else (tokens, tokens[:, 3])


def make_encoder(ending: str) -> nn.Module:
    torch.manual_seed(1)
    return Tokens(ending).eval().requires_grad_(False)


def write_encoder(folder: Path, ending: str, kind: str, half_mean: bool = True) -> Path:
    """The encoder as `.pt2` for any number of images or for two, or as ONNX, with what it wants beside it."""
    module, file = make_encoder(ending), folder / f"{ending}{'.onnx' if kind == 'onnx' else '.pt2'}"
    if kind == "onnx":
        write_onnx(module, file)
    else:
        free = None if kind == "two" else ({0: torch.export.Dim("b")},)
        torch.export.save(torch.export.export(module, (torch.rand(2, 3, PX, PX),), dynamic_shapes=free), file)
    file.with_suffix(".toml").write_text("mean = [0.5, 0.5, 0.5]\nstd = [0.25, 0.25, 0.25]\nsquash = true\n")
    return file


def write_onnx(module: nn.Module, file: Path) -> None:
    onnx = pytest.importorskip("onnx", reason="needs onnx: pip install '.[onnx]'")
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install '.[onnx]'")
    make = onnx.helper.make_node
    nodes = [make("Conv", ["image", "kernel", "bias"], ["c"], strides=[8, 8]), make("Tanh", ["c"], ["map"])]
    outputs = [("map", ["b", WIDTH, 4, 4])]
    if module.ending != "map":
        nodes += [
            make("Reshape", ["map", "flat"], ["f"]), make("Transpose", ["f"], ["tokens"], perm=[0, 2, 1]),
            make("Gather", ["tokens", "third"], ["pooled"], axis=1),
        ]  # fmt: skip
        outputs = [("tokens", ["b", 16, WIDTH]), ("pooled", ["b", WIDTH])][: 1 if module.ending == "tokens" else 2]
    stored = {
        "kernel": module.patches.weight.numpy(), "bias": module.patches.bias.numpy(),
        "flat": np.array([0, WIDTH, -1]), "third": np.array(3),
    }  # fmt: skip
    graph = onnx.helper.make_graph(
        nodes, "encoder", [onnx.helper.make_tensor_value_info("image", 1, ["b", 3, PX, PX])],
        [onnx.helper.make_tensor_value_info(name, 1, shape) for name, shape in outputs],
        [onnx.numpy_helper.from_array(value, name) for name, value in stored.items()],
    )  # fmt: skip
    onnx.save(onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 13)], ir_version=8), file)


def pool(ending: str, tokens: str | None, images: torch.Tensor) -> torch.Tensor:
    """The features of normalised images, by the definition."""
    found = make_encoder("map")(images)
    if ending == "two":
        return found.flatten(2)[:, :, 3]
    return found.flatten(2)[:, :, 0] if tokens == "first" else found.mean((2, 3))


@pytest.mark.parametrize("kind", ["free", "two", "onnx"])
@pytest.mark.parametrize(
    ("ending", "tokens", "normalise"),
    [("map", None, True), ("tokens", "first", False), ("tokens", "mean", True), ("two", None, False)],
)
def test_one_file_answers_and_trains_as_both_parts(tmp_path, kind, ending, tokens, normalise):
    encoder = load_encoder(str(write_encoder(tmp_path, ending, kind)), device="cpu", how=AsEncoder(tokens))
    assert len(encoder.labels) == WIDTH
    draws = np.random.default_rng(0)
    weight, bias = draws.normal(0, 3, (4, WIDTH)), draws.normal(0, 1, 4)
    file = tmp_path / f"joined{'.onnx' if kind == 'onnx' else '.pt2'}"
    file.write_bytes(join_head(encoder, Head(torch.from_numpy(weight), torch.from_numpy(bias), normalise)))
    file.with_suffix(".toml").write_text("mean = [0.5, 0.5, 0.5]\nstd = [0.25, 0.25, 0.25]\n")
    classifier = load_classifier(str(file), device="cpu")
    images = torch.rand(5, 3, PX, PX, requires_grad=True)
    features = pool(ending, tokens, (images - 0.5) / 0.25)
    values = features.detach().numpy().astype(np.float64)
    expected = (values / np.linalg.norm(values, axis=1, keepdims=True) if normalise else values) @ weight.T + bias
    found = classifier.logits(images)
    assert np.abs(found.detach().numpy() - expected).max() < 1e-5 * np.abs(expected).max()
    assert not classifier.untrainable
    unit = features / features.norm(dim=1, keepdim=True) if normalise else features
    wanted = torch.autograd.grad((unit @ torch.from_numpy(weight).float().T)[:, 1].sum(), images)[0]
    gradient = torch.autograd.grad(found[:, 1].sum(), images)[0]
    assert torch.allclose(gradient, wanted, atol=1e-5) and wanted.abs().max() > 1e-3
    # with no gradient asked for, ONNX Runtime answers
    with torch.no_grad():
        assert torch.allclose(classifier.logits(images), found, atol=1e-4)


def test_a_file_is_the_same_bytes_again_and_tells_no_path(tmp_path):
    encoder = load_encoder(str(write_encoder(tmp_path, "map", "free")), device="cpu", how=AsEncoder())
    head = Head(torch.eye(3, WIDTH), torch.zeros(3), True)
    first, second = join_head(encoder, head), join_head(encoder, head)
    assert first == second
    assert str(Path(__file__).parents[2]).encode() not in first and b"test_head" not in first


def test_a_linear_head_is_the_minimum_of_its_loss():
    """scikit-learn's definition: its gradient is nought, and moving it anywhere costs."""
    draws = np.random.default_rng(3)
    truth = torch.from_numpy(draws.integers(0, 3, 90))
    features = torch.from_numpy(draws.normal(0, 1, (90, 5)) * [1, 10, 0.1, 1, 0] + truth[:, None].numpy()).float()
    head = fit_linear(features, truth, 0.01)
    std = features.double().std(0, correction=0)
    std[std < 1e-9] = 1

    def loss(weight, bias):
        logits = features.double() @ weight.T + bias
        return nn.functional.cross_entropy(logits, truth) + 0.005 * (weight * std).square().sum()

    weight, bias = (value.double().requires_grad_() for value in (head.weight, head.bias))
    gradients = torch.autograd.grad(loss(weight, bias), (weight, bias))
    assert max((one / (std if one.ndim == 2 else 1)).abs().max() for one in gradients) < 1e-4
    assert (head(features).argmax(1) == truth).float().mean() > 0.8


def test_a_head_of_means_is_the_cosine_to_them():
    truth = torch.tensor([0, 0, 1, 1])
    features = torch.tensor([[2.0, 0.0], [0.0, 3.0], [-1.0, 0.0], [-4.0, 0.0]])
    head = fit_means(features, truth)
    scale = float(head.weight[0].norm())
    assert torch.allclose(head.weight / scale, torch.tensor([[0.5**0.5, 0.5**0.5], [-1.0, 0.0]]), atol=1e-6)
    assert 1 <= scale <= 100 and head.normalise


@pytest.mark.parametrize("kind", ["linear", "nearest-mean"])
def test_a_head_tells_colours_apart_and_its_record_says_how_well(tmp_path, kind):
    space = make_workspace(tmp_path / "lab")
    data = write_colours(tmp_path / "photos", 20, px=40)
    encoder = load_encoder(str(write_encoder(tmp_path, "map", "free")), device="cpu", how=AsEncoder())
    config = HeadConfig(name="hues", data=(str(data),), kind=kind)
    made = train_head(config, space, encoder)
    record = made.record
    assert record.labels == ["blue", "green", "red"] and record.held_out.n == 12
    assert record.held_out.correct >= 11 and record.held_out.ci95[0] > 0.6
    assert record.settings["encoder_sha256"] == encoder.weights.sha256 and record.squash
    classifier = load_classifier("hues", device="cpu", folder=space.classifiers_dir)
    assert classifier.name == "hues" and classifier.labels == record.labels
    assert classifier.preprocessing == encoder.preprocessing
    again = train_head(config, space, encoder)
    assert again.was_finished and again.record == record
    first = describe_network(classifier)["network_id"]
    other = train_head(config.with_overrides(held_out=0.5), space, encoder)
    assert not other.was_finished
    changed = describe_network(load_classifier("hues", device="cpu", folder=space.classifiers_dir))
    assert changed["network_id"] != first
    assert not list(space.classifiers_dir.glob(".training/*"))


def test_what_is_not_a_class_or_a_name_is_one_line(tmp_path):
    space = make_workspace(tmp_path / "lab")
    data = write_colours(tmp_path / "photos", 3, px=40)
    encoder = load_encoder(str(write_encoder(tmp_path, "map", "free")), device="cpu", how=AsEncoder())
    for label in ("red", "blue"):
        for file in (data / label).iterdir():
            file.unlink()
        (data / label).rmdir()
    config = HeadConfig(name="hues", data=(str(data),))
    assert "at least two classes: found only 'green'" in error_of(lambda: train_head(config, space, encoder))
    space.classifiers_dir.mkdir(parents=True, exist_ok=True)
    (space.classifiers_dir / "hues.safetensors").write_bytes(b"")
    assert "hues.safetensors is there already" in error_of(lambda: train_head(config, space, encoder))
    tokens = str(write_encoder(tmp_path, "tokens", "free"))
    message = error_of(lambda: load_encoder(tokens, device="cpu", how=AsEncoder()))
    assert "2×16×12" in message and "{tokens}" not in message and "'first'" in message


def test_a_classifier_of_torchvision_loses_its_last_layer(tmp_path):
    torch.manual_seed(0)
    for arch, width in (("squeezenet1_1", 512), ("shufflenet_v2_x0_5", 1024)):
        network, file = torchvision.models.get_model(arch, num_classes=7).eval(), tmp_path / f"{arch}.safetensors"
        save_file(network.state_dict(), file)
        encoder = load_encoder(arch, file, "cpu", how=AsEncoder())
        assert len(encoder.labels) == width and encoder.preprocessing.crop_px == 224
        whole = load_encoder(arch, file, "cpu", how=AsEncoder(whole=True))
        assert len(whole.labels) == 7


@pytest.mark.parametrize(
    ("name", "width"),
    [
        ("test_vit", 64),
        ("test_resnet", 96),
        pytest.param("vit_small_patch14_dinov2", 384, marks=pytest.mark.slow, id="dinov2"),
        pytest.param("vit_base_patch16_siglip_224", 768, marks=pytest.mark.slow, id="siglip"),
    ],
)
def test_an_encoder_of_timm_gives_timms_own_features(tmp_path, name, width):
    """`num_classes=0` in timm's words; classifiers lose their last layer, and DINOv2 has none."""
    timm = pytest.importorskip("timm", reason="needs timm: pip install '.[timm]'")
    torch.manual_seed(0)
    network, file = timm.create_model(name, pretrained=False).eval(), tmp_path / f"{name}.safetensors"
    save_file(network.state_dict(), file)
    encoder = load_encoder(f"timm:{name}", file, "cpu", how=AsEncoder())
    assert len(encoder.labels) == width
    side = encoder.preprocessing.crop_px
    images = torch.rand(1, 3, side, side)
    how = encoder.preprocessing
    mean, std = (torch.tensor(values).view(3, 1, 1) for values in (how.mean, how.std))
    bare = timm.create_model(name, pretrained=False, num_classes=0).eval()
    bare.load_state_dict(network.state_dict(), strict=False)
    with torch.no_grad():
        assert torch.allclose(encoder.logits(images), bare((images - mean) / std), atol=1e-5)


def test_the_command_makes_a_classifier_that_eval_takes(tmp_path, monkeypatch, capsys):
    import sys

    from toolkit.cli import main

    space = make_workspace(tmp_path / "lab")
    file = write_encoder(tmp_path, "tokens", "free")
    data = write_colours(tmp_path / "photos", 8, px=40)
    monkeypatch.chdir(space.root)
    for words, code in (
        (["head", str(file), "--data", str(data), "--name", "hues", "--tokens", "mean", "--json"], 0),
        (["head", str(file), "--data", str(data), "--name", "hues"], 2),
        (["models", "--model", "hues", "--data", str(data), "--json"], 0),
    ):
        monkeypatch.setattr(sys, "argv", ["toolkit", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        assert (ended.value.code or 0) == code
        out = capsys.readouterr()
        if code:
            assert "give --tokens 'first'" in out.err and out.err.count("\n") == 1
    assert json.loads(out.out)[0]["can_train"] and json.loads(out.out)[0]["correct"] > 18
