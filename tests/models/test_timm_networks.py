"""A network of timm answers as timm's own code does, and what it lacks is said in one line."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from one_line import error_of
from PIL import Image
from safetensors.torch import save_file

from toolkit.imaging.preprocessing import resize_and_crop
from toolkit.models.load import load_classifier, read_timm_config, read_timm_preprocessing

NAME = "test_resnet"  # timm's own for tests: half a million parameters, images of 160 px
MODEL = f"timm:{NAME}"


@pytest.fixture(scope="module")
def timm():
    return pytest.importorskip("timm", reason="needs timm: pip install '.[timm]'")


def make_network(timm, name):
    """The network with random weights; batch norm's too, which else would change nothing."""
    torch.manual_seed(0)
    module = timm.create_model(name, pretrained=False)
    for layer in module.modules():
        if isinstance(layer, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(layer.running_mean, -0.2, 0.2)
            torch.nn.init.uniform_(layer.running_var, 0.5, 2)
            torch.nn.init.uniform_(layer.weight, 0.5, 1.5)
    return module.eval()


@pytest.fixture(scope="module")
def network(timm):
    return make_network(timm, NAME)


@pytest.fixture
def folder(network, tmp_path, monkeypatch):
    """TOOLKIT_WEIGHTS with the network's file."""
    save_file(network.state_dict(), tmp_path / f"{NAME}-random.safetensors")
    monkeypatch.setenv("TOOLKIT_WEIGHTS", str(tmp_path))
    return tmp_path


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("test_resnet", (300, 200)),
        ("test_resnet", (161, 260)),
        ("test_vit", (500, 160)),
        ("test_vit", (300, 400)),
    ],
)
def test_the_same_answer_as_timm_gives_to_the_same_photograph(timm, tmp_path, name, size):
    photo = Image.fromarray(np.random.default_rng(3).integers(0, 256, (*reversed(size), 3), np.uint8))
    network, file = make_network(timm, name), tmp_path / "random.safetensors"
    save_file(network.state_dict(), file)
    config = timm.data.resolve_model_data_config(network)
    transform = timm.data.create_transform(**config, is_training=False)
    classifier = load_classifier(f"timm:{name}", file, "cpu")
    with torch.no_grad():
        expected = network(transform(photo)[None])
        found = classifier.logits(classifier.preprocess(np.asarray(photo))[None])
        other = classifier.logits(classifier.preprocess(np.asarray(photo.transpose(Image.Transpose.ROTATE_180)))[None])
    assert classifier.preprocessing.crop_px == config["input_size"][1] == 160
    assert torch.allclose(found, expected, atol=1e-4)
    assert not torch.allclose(other, expected, atol=1e-3)


def test_labels_are_imagenets_in_torchvisions_order(timm, folder):
    classifier = load_classifier(MODEL, device="cpu")
    names = timm.data.ImageNetInfo("imagenet-1k")
    assert classifier.is_imagenet and len(classifier.labels) == 1000
    assert classifier.class_index("n04552348") == names.label_names().index("n04552348") == 895
    assert classifier.labels[895] == "warplane"
    assert (classifier.arch, classifier.name) == (MODEL, f"timm-{NAME}")
    assert classifier.weights.name == f"{NAME}-random.safetensors"


def test_a_thousand_wordnet_ids_in_one_order(timm):
    from toolkit.models.labels import imagenet_wnids

    assert tuple(timm.data.ImageNetInfo("imagenet-1k").label_names()) == imagenet_wnids()


def test_gradient_reaches_the_image_and_not_the_weights(folder):
    classifier = load_classifier(MODEL, device="cpu")
    batch = torch.rand(1, 3, 160, 160, requires_grad=True)
    classifier.logits(batch)[0, 0].backward()
    assert batch.grad.abs().sum() > 0
    assert not classifier.module.training
    assert all(parameter.grad is None and not parameter.requires_grad for parameter in classifier.module.parameters())


def test_ones_own_classes_and_preprocessing(timm, tmp_path):
    file = tmp_path / "mine.pth"
    torch.save({"state_dict": timm.create_model(NAME, num_classes=3).state_dict()}, file)
    file.with_suffix(".json").write_text(json.dumps({"labels": ["mug", "bowl", "jar"], "resize_px": 200}))
    mine = load_classifier(MODEL, file, "cpu")
    assert mine.labels == ["mug", "bowl", "jar"] and not mine.is_imagenet
    assert mine.preprocessing.resize_px == 200
    assert mine.logits(torch.rand(1, 3, 160, 160)).shape == (1, 3)
    file.with_suffix(".json").write_text(json.dumps({"arch": MODEL, "sha256": "0" * 64}))
    assert "hash" in error_of(lambda: load_classifier(None, file, "cpu"))
    file.with_suffix(".json").write_text(json.dumps({"arch": MODEL}))
    assert load_classifier(None, file, "cpu").arch == MODEL


def test_unknown_names_give_the_nearest(timm):
    message = error_of(lambda: load_classifier("timm:resnet_18", device="cpu"))
    assert "timm:resnet18" in message
    assert len(error_of(lambda: load_classifier("timm:qqqqqqqq", device="cpu"))) < 200


def test_weights_of_another_network(network, folder):
    state = network.state_dict()
    save_file({**state, "extra.weight": torch.zeros(1)}, folder / "more.safetensors")
    save_file({name: value for name, value in state.items() if name != "conv1.0.weight"}, folder / "less.safetensors")
    broken = {**state, "fc.bias": torch.full((1000,), float("nan"))}
    save_file(broken, folder / "nan.safetensors")
    for file, expected in (("more", "extra.weight"), ("less", "conv1.0.weight"), ("nan", "not a number")):
        path = folder / f"{file}.safetensors"
        message = error_of(lambda path=path: load_classifier(MODEL, path, "cpu"))
        assert expected in message and file in message


def test_what_is_no_classifier_or_is_cut_otherwise(timm, tmp_path, monkeypatch):
    features = "timm:vit_small_patch14_dinov2"
    file = tmp_path / "features.pth"
    torch.save({"cls_token": torch.zeros(1)}, file)
    assert "not a classifier" in error_of(lambda: load_classifier(features, file, "cpu"))
    monkeypatch.setattr("toolkit.models.load.read_timm_config", lambda name: {"crop_mode": "border"})
    assert "border" in error_of(lambda: load_classifier("timm:convnext_tiny.in12k_ft_in1k_384", file, "cpu"))


@pytest.mark.parametrize("size", [(500, 160), (300, 400), (384, 384)])
def test_a_network_that_wants_the_whole_image_squashed_gets_timms_own_pixels(timm, size):
    name = "convnext_tiny.in12k_ft_in1k_384"
    photo = Image.fromarray(np.random.default_rng(4).integers(0, 256, (*reversed(size), 3), np.uint8))
    how = read_timm_preprocessing(name, read_timm_config(name))
    config = timm.data.resolve_data_config(pretrained_cfg=timm.get_pretrained_cfg(name).to_dict())
    expected = timm.data.create_transform(**config, is_training=False)(photo)
    pixels = resize_and_crop(np.asarray(photo), how).transpose(2, 0, 1) / 255
    found = (pixels - np.reshape(how.mean, (3, 1, 1))) / np.reshape(how.std, (3, 1, 1))
    assert how.squash and "both sides resized to 384 px" in how.describe()
    assert np.abs(found - expected.numpy()).max() < 1e-5


def test_without_weights_and_network_every_way_is_named(timm, monkeypatch):
    import huggingface_hub

    monkeypatch.delenv("TOOLKIT_WEIGHTS", raising=False)
    monkeypatch.setattr(huggingface_hub, "try_to_load_from_cache", lambda repo, filename, revision: None)
    asked = []

    def refuse(url, timeout):
        asked.append((url, timeout))
        raise OSError("no network in this test")

    monkeypatch.setattr(huggingface_hub, "get_hf_file_metadata", refuse)
    message = error_of(lambda: load_classifier(MODEL, device="cpu"))
    for way in ("with weights", "TOOLKIT_WEIGHTS", f"{NAME}-*.pth", "Hugging Face", "no network in this test"):
        assert way in message
    ((url, timeout),) = asked
    assert NAME in url and url.endswith("model.safetensors") and timeout <= 15


def test_the_hubs_cache_is_used_without_asking(network, timm, tmp_path, monkeypatch):
    import huggingface_hub

    monkeypatch.delenv("TOOLKIT_WEIGHTS", raising=False)
    save_file(network.state_dict(), tmp_path / "model.safetensors")
    monkeypatch.setattr(
        huggingface_hub, "try_to_load_from_cache", lambda repo, filename, revision: str(tmp_path / "model.safetensors")
    )
    classifier = load_classifier(MODEL, device="cpu")
    assert classifier.weights.name.startswith(f"timm/{NAME}") and classifier.is_imagenet


@pytest.mark.parametrize(("repo", "asked"), [("timm/net", "main"), ("timm/net@v2", "v2")])
def test_the_hub_gives_the_commit_that_was_asked_for(monkeypatch, tmp_path, repo, asked):
    import huggingface_hub

    from toolkit.models.load import _fetch_from_hub

    def describe(url, timeout):
        assert f"/resolve/{asked}/" in url
        return SimpleNamespace(commit_hash="c0ffee")

    def download(repo, filename, revision, etag_timeout):
        return str(tmp_path / repo / filename / revision)

    monkeypatch.setattr(huggingface_hub, "try_to_load_from_cache", lambda repo, filename, revision: None)
    monkeypatch.setattr(huggingface_hub, "get_hf_file_metadata", describe)
    monkeypatch.setattr(huggingface_hub, "hf_hub_download", download)
    assert _fetch_from_hub("net", repo, "a.pth") == tmp_path / "timm/net" / "a.pth" / "c0ffee"


def test_without_timm_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "timm", None)
    message = error_of(lambda: load_classifier(MODEL, device="cpu"))
    assert "'.[timm]'" in message and MODEL in message
