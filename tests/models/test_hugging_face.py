"""A network of transformers answers as transformers' own code does; what it cannot be trusted with is one line."""

import json
import shutil
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from one_line import error_of
from PIL import Image

from toolkit.models.architectures import imagenet_labels
from toolkit.models.encoders import load_encoder
from toolkit.models.find import brings_weights, may_be_detector
from toolkit.models.heads import AsEncoder
from toolkit.models.identity import describe_network
from toolkit.models.load import load_classifier

LABELS = ["racer", "warplane", "teapot"]


@pytest.fixture(scope="module")
def library():
    return pytest.importorskip("transformers", reason="needs transformers: pip install '.[hub]'")


def make_vit(library, labels=LABELS, px=32):
    named = dict(enumerate(labels))
    config = library.ViTConfig(
        hidden_size=32, num_hidden_layers=1, num_attention_heads=2, intermediate_size=32, image_size=px, patch_size=8,
        id2label=named, label2id={label: k for k, label in named.items()}, initializer_range=0.3,
    )  # fmt: skip
    torch.manual_seed(0)
    return library.ViTForImageClassification(config).eval()


@pytest.fixture(scope="module")
def saved(library, tmp_path_factory):
    """A small ViT of three classes that squashes images, as `save_pretrained` writes it."""
    folder = tmp_path_factory.mktemp("hub") / "tiny-vit"
    make_vit(library).save_pretrained(folder)
    library.ViTImageProcessor(size={"height": 32, "width": 32}, resample=3).save_pretrained(folder)
    return folder


@pytest.fixture
def copied(saved, tmp_path):
    return shutil.copytree(saved, tmp_path / "copy")


@pytest.mark.parametrize("size", [(48, 60), (90, 40), (32, 32)])
def test_the_answer_is_that_of_transformers_to_the_same_photograph(library, saved, size):
    photo = np.random.default_rng(1).integers(0, 256, (*size, 3), np.uint8)
    classifier = load_classifier(f"hf:{saved}", device="cpu")
    network = library.AutoModelForImageClassification.from_pretrained(saved)
    processor = library.AutoImageProcessor.from_pretrained(saved)
    with torch.no_grad():
        expected = network(**processor(images=Image.fromarray(photo), return_tensors="pt")).logits
        found = classifier.logits(classifier.preprocess(photo)[None])
    # transformers resizes by torchvision's tensors, which round some values to the next of 255 levels
    assert torch.allclose(found, expected, atol=0.02) and expected.std() > 0.3
    assert classifier.labels == LABELS and classifier.preprocessing.squash
    assert (classifier.name, classifier.arch) == ("tiny-vit", "hf:tiny-vit")
    assert not classifier.is_imagenet and not classifier.untrainable


def test_gradients_reach_the_image(library, saved):
    classifier = load_classifier(f"hf:{saved}", device="cpu")
    images = torch.rand(2, 3, 32, 32, requires_grad=True)
    network = library.AutoModelForImageClassification.from_pretrained(saved)
    expected = torch.autograd.grad(network(pixel_values=(images - 0.5) / 0.5).logits[:, 1].sum(), images)[0]
    found = torch.autograd.grad(classifier.logits(images)[:, 1].sum(), images)[0]
    assert torch.allclose(found, expected, atol=1e-6) and expected.abs().max() > 1e-3


CLIP_LIKE = {"size": {"shortest_edge": 40}, "crop_size": {"height": 32, "width": 32}, "do_center_crop": True}


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("CLIPImageProcessor", CLIP_LIKE),
        ("BitImageProcessor", CLIP_LIKE | {"resample": 2, "image_mean": [0.1, 0.2, 0.3]}),
        ("ConvNextImageProcessor", {"size": {"shortest_edge": 32}, "crop_pct": 0.8}),
        ("SiglipImageProcessor", {"size": {"height": 32, "width": 32}, "do_normalize": False}),
        ("ViTImageProcessor", {"size": {"height": 32, "width": 32}, "rescale_factor": 1 / 127.5}),
    ],
)
def test_pixels_are_those_of_the_processor(library, copied, name, settings):
    processor = getattr(library, name)(**settings)
    (copied / "preprocessor_config.json").unlink()
    processor.save_pretrained(copied)
    how = load_classifier(f"hf:{copied}", device="cpu").preprocessing
    ramp = np.linspace(0, 200, 80)[None, :, None] + np.linspace(0, 50, 60)[:, None, None] + np.zeros((60, 80, 3))
    photo = ramp.astype(np.uint8)
    expected = processor(images=Image.fromarray(photo), return_tensors="pt")["pixel_values"][0].numpy()
    from toolkit.imaging.preprocessing import resize_and_crop

    pixels = resize_and_crop(photo, how).transpose(2, 0, 1) / 255
    found = (pixels - np.reshape(how.mean, (3, 1, 1))) / np.reshape(how.std, (3, 1, 1))
    levels = np.abs(found - expected) * np.reshape(how.std, (3, 1, 1)) * 255
    assert found.shape == expected.shape and levels.max() <= 1.5


def test_a_processor_that_cannot_be_followed_is_refused(library, copied):
    (copied / "preprocessor_config.json").unlink()
    library.EfficientNetImageProcessor(
        size={"height": 32, "width": 32}, rescale_offset=True, do_center_crop=False
    ).save_pretrained(copied)
    assert "EfficientNetImageProcessor prepares images" in error_of(lambda: load_classifier(f"hf:{copied}"))


def test_labels_in_imagenets_order_get_its_names(library, tmp_path):
    published = imagenet_labels()
    for folder, labels in (
        ("thousand", [f"{label}, synonym {k}" for k, label in enumerate(published)]),
        ("background", ["background", *published]),
        ("unnamed", [f"LABEL_{k}" for k in range(1000)]),
        ("few", [f"LABEL_{k}" for k in range(4)]),
        ("other", list(reversed(published))),
    ):
        make_vit(library, labels).save_pretrained(tmp_path / folder)
        library.ViTImageProcessor(size={"height": 32, "width": 32}).save_pretrained(tmp_path / folder)
    load = {folder.name: load_classifier(f"hf:{folder}", device="cpu") for folder in tmp_path.iterdir()}
    assert load["thousand"].is_imagenet and load["unnamed"].is_imagenet
    assert load["background"].labels == ["background", *published]
    assert load["few"].labels == ["class 0", "class 1", "class 2", "class 3"]
    assert not load["other"].is_imagenet and load["other"].labels == list(reversed(published))


def test_a_file_of_code_or_of_pickles_is_not_read(library, copied, monkeypatch):
    config = json.loads((copied / "config.json").read_text())
    (copied / "config.json").write_text(
        json.dumps({**config, "auto_map": {"AutoModelForImageClassification": "evil.Evil"}})
    )
    (copied / "evil.py").write_text("raise SystemExit('ran')")
    assert "needs its own code, which is not run" in error_of(lambda: load_classifier(f"hf:{copied}"))
    (copied / "config.json").write_text(json.dumps(config))
    torch.save({}, copied / "pytorch_model.bin")
    (copied / "model.safetensors").unlink()
    assert "no weights in safetensors" in error_of(lambda: load_classifier(f"hf:{copied}"))


def test_what_is_no_classifier_is_said(library, copied):
    bare = library.ViTModel(make_vit(library).config)
    bare.save_pretrained(copied)
    assert f"'toolkit head hf:{copied}'" in error_of(lambda: load_classifier(f"hf:{copied}"))
    encoder = load_encoder(f"hf:{copied}", device="cpu", how=AsEncoder("first"))
    images = torch.rand(2, 3, 32, 32)
    with torch.no_grad():
        expected = bare.eval()(pixel_values=(images - 0.5) / 0.5)
        assert torch.allclose(encoder.logits(images), expected.pooler_output, atol=1e-5)
    (copied / "model.safetensors").write_bytes(b"no")
    assert "transformers cannot load it" in error_of(lambda: load_classifier(f"hf:{copied}"))
    (copied / "config.json").unlink()
    assert "has no config.json" in error_of(lambda: load_classifier(f"hf:{copied}"))
    assert "there is no folder nowhere" in error_of(lambda: load_classifier("hf:nowhere"))


def test_an_encoder_of_a_classifiers_weights_has_no_random_pooler(library, saved):
    """A ViT that classifies has no pooler; transformers would draw one."""
    images = torch.rand(2, 3, 32, 32)
    found = []
    for seed in (1, 2):
        torch.manual_seed(seed)
        with torch.no_grad():
            found.append(load_encoder(f"hf:{saved}", device="cpu", how=AsEncoder("first")).logits(images))
    assert torch.equal(*found)


def test_a_repository_is_read_at_a_commit_that_results_name(library, saved, tmp_path, monkeypatch):
    import huggingface_hub

    commit, asked = "0123456789abcdef0123456789abcdef01234567", []
    kept = shutil.copytree(saved, tmp_path / "snapshots" / commit)

    def fetch(name, *, revision=None, local_files_only=False, **_):
        asked.append((name, revision, local_files_only))
        if local_files_only and revision is None:
            raise FileNotFoundError(name)
        return str(kept)

    monkeypatch.setattr(huggingface_hub, "snapshot_download", fetch)
    monkeypatch.setattr(huggingface_hub, "get_hf_file_metadata", lambda *_, **__: SimpleNamespace(commit_hash=commit))
    classifier = load_classifier("hf:org/tiny", device="cpu")
    assert asked == [("org/tiny", None, True), ("org/tiny", commit, False)]
    described = describe_network(classifier)
    assert described["arch"] == f"hf:org/tiny@{commit}" and described["name"] == "tiny"
    assert described["weights"] == f"org/tiny@{commit}/model.safetensors"
    again = load_classifier(described["arch"], device="cpu")
    assert describe_network(again) == described and asked[2:] == [("org/tiny", commit, True)]

    def fail(*_, **__):
        raise OSError("no route to host")

    monkeypatch.setattr(huggingface_hub, "get_hf_file_metadata", fail)
    assert "no route to host" in error_of(lambda: load_classifier("hf:org/tiny", device="cpu"))


def test_weights_in_several_files_count_whole(library, saved, tmp_path):
    sharded = tmp_path / "tiny-vit"
    library.AutoModelForImageClassification.from_pretrained(saved).save_pretrained(sharded, max_shard_size="20KB")
    shutil.copy(saved / "preprocessor_config.json", sharded)
    assert len(list(sharded.glob("*.safetensors"))) > 1
    one, several = (load_classifier(f"hf:{folder}", device="cpu") for folder in (saved, sharded))
    images = torch.rand(2, 3, 32, 32)
    with torch.no_grad():
        assert torch.equal(one.logits(images), several.logits(images))
    assert one.weights.sha256 != several.weights.sha256
    assert describe_network(one)["tensors_sha256"] == describe_network(several)["tensors_sha256"]


def test_without_the_extra_one_line_names_the_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "transformers", None)
    assert "pip install '.[hub]'" in error_of(lambda: load_classifier("hf:google/vit-base-patch16-224"))


def test_such_a_name_brings_its_weights(tmp_path):
    assert brings_weights("hf:org/net.onnx") and not may_be_detector("hf:org/net.onnx")
    message = error_of(lambda: load_classifier("hf:org/net", tmp_path / "a.pth"))
    assert "has its own weights" in message
