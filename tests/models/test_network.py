"""A loaded classifier is torchvision's own network, normalised inside, with the right names on its outputs."""

import json
import unicodedata
from dataclasses import replace

import numpy as np
import pytest
import torch
import torchvision
from slow_cases import mark_slow

from toolkit.core.child import run_python
from toolkit.core.errors import ToolkitError
from toolkit.models.architectures import CIFAR_NETWORKS, list_architectures, published_weights
from toolkit.models.load import load_classifier
from toolkit.models.network import choose_device, fold_normalisation, match_classes


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """State dicts of a ResNet-18 with 1000 outputs, and of one with 3 and named labels."""
    folder = tmp_path_factory.mktemp("weights")
    torch.manual_seed(0)
    for name, outputs in (("imagenet", 1000), ("mine", 3)):
        torch.save(torchvision.models.resnet18(num_classes=outputs).state_dict(), folder / f"{name}.pth")
    (folder / "mine.json").write_text(json.dumps({"labels": ["mug", "Bowl", "bowl"], "mean": [0, 0, 0]}))
    return folder


@pytest.fixture(scope="module")
def classifier(files):
    return load_classifier("resnet18", files / "imagenet.pth", "cpu")


def test_logits_are_torchvisions(classifier, files):
    plain = torchvision.models.resnet18()
    plain.load_state_dict(torch.load(files / "imagenet.pth", weights_only=True))
    normalise = torchvision.transforms.Normalize((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
    batch = torch.rand(2, 3, 64, 64, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        expected = plain.eval()(normalise(batch))
        assert torch.allclose(classifier.logits(batch), expected, atol=1e-4)


def test_gradient_reaches_the_image_and_not_the_weights(classifier):
    batch = torch.rand(1, 3, 64, 64, requires_grad=True)
    classifier.logits(batch)[0, 0].backward()
    assert batch.grad is not None and batch.grad.abs().sum() > 0
    assert not classifier.module.training
    assert all(parameter.grad is None and not parameter.requires_grad for parameter in classifier.module.parameters())


def make_moved(network):
    """With statistics and affine maps that are not those of a new network."""
    generator = torch.Generator().manual_seed(1)
    for one in network.modules():
        if isinstance(one, torch.nn.BatchNorm2d):
            for values, low, high in ((one.weight, 0.5, 1.5), (one.bias, -0.3, 0.3), (one.running_mean, -0.2, 0.2),
                                      (one.running_var, 0.5, 2.0)):  # fmt: skip
                values.data.uniform_(low, high, generator=generator)
    return network


FOLDED = ["resnet18", "mobilenet_v2", "densenet121", "timm:tf_efficientnet_lite0"]


@pytest.mark.parametrize("arch", mark_slow(FOLDED, "densenet121", "timm:tf_efficientnet_lite0"))
def test_a_folded_network_answers_as_before_and_takes_the_same_gradient_back(tmp_path, arch):
    torch.manual_seed(0)
    build = torchvision.models.get_model if ":" not in arch else pytest.importorskip("timm").create_model
    torch.save(make_moved(build(arch.removeprefix("timm:"))).state_dict(), tmp_path / "moved.pth")
    network = load_classifier(arch, tmp_path / "moved.pth", "cpu")
    network.module.double()  # exact, so that no ReLU is on in one and off in the other
    before = {name: value.clone() for name, value in network.module.state_dict().items()}
    folded = fold_normalisation(network)

    def count(one):
        return sum(isinstance(layer, torch.nn.BatchNorm2d) for layer in one.module.modules())

    # of a densenet most normalisations come before their convolution
    assert count(folded) == 0 if arch != "densenet121" else 0 < count(folded) < count(network)
    gradients = []
    for one in (network, folded):
        batch = torch.rand(2, 3, 96, 96, generator=torch.Generator().manual_seed(2)).double().requires_grad_(True)
        answers = one.logits(batch)
        answers[:, 3].sum().backward()
        gradients.append((answers.detach(), batch.grad))
    for plain, other in zip(*gradients, strict=True):
        assert torch.allclose(plain, other, rtol=1e-6, atol=1e-9 * float(plain.abs().max()))
    after = network.module.state_dict()
    assert all(torch.equal(value, after[name]) for name, value in before.items())
    assert not any(value.requires_grad for value in folded.module.parameters())


class Fork(torch.nn.Module):
    """What the convolution gives is used twice, once before its normalisation."""

    def __init__(self):
        super().__init__()
        self.layer, self.norm = torch.nn.Conv2d(3, 4, 3), make_moved(torch.nn.Sequential(torch.nn.BatchNorm2d(4)))

    def forward(self, batch):
        made = self.layer(batch)
        return (made + self.norm(made)).mean((2, 3))


@pytest.mark.parametrize("module", [Fork(), torch.nn.Sequential(torch.nn.Conv2d(3, 4, 3), torch.nn.Flatten())])
def test_what_cannot_be_folded_is_left_as_it_is(classifier, module):
    network = replace(classifier, module=module.eval().requires_grad_(False), labels=list("abcd"))
    if not isinstance(module, Fork):
        network = replace(network, labels=[str(k) for k in range(4 * 222 * 222)])
    assert fold_normalisation(network) is network


def test_wrong_shape_is_named(classifier):
    with pytest.raises(ValueError, match=r"Bx3xHxW, got \(3, 64, 64\)"):
        classifier.logits(torch.rand(3, 64, 64))


def test_class_index(classifier):
    categories = torchvision.models.ResNet18_Weights.IMAGENET1K_V1.meta["categories"]
    assert classifier.labels == categories
    assert categories[classifier.class_index("warplane")] == "warplane"
    assert classifier.class_index("WARPLANE") == classifier.class_index("n04552348") == classifier.class_index(895)
    assert classifier.class_index("751") == 751
    assert classifier.class_index("Cardigan") != classifier.class_index("cardigan")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("warplan", "warplane"),
        ("CARDIGAN", "264"),
        (1000, "0 to 999"),
        ("qqqq", "1000 names"),
        ("jeep wrangler", "jeep"),
    ],
)
def test_class_index_says_what_is_wrong(classifier, name, expected):
    with pytest.raises(ToolkitError, match=expected):
        classifier.class_index(name)


def test_users_own_classifier(files, tmp_path):
    mine = load_classifier("resnet18", files / "mine.pth", "cpu")
    assert mine.labels == ["mug", "Bowl", "bowl"]
    assert mine.class_index("Mug") == 0
    # a Mac keeps accents of a file's name apart from their letters
    other = replace(mine, labels=["caf\u00e9", "mug", "bowl"])
    for form in ("NFC", "NFD"):
        typed = unicodedata.normalize(form, "caf\u00e9")
        assert other.class_index(typed) == match_classes([typed], other, tmp_path)[typed] == 0
    assert mine.preprocessing.mean == (0, 0, 0) and mine.preprocessing.std == (0.229, 0.224, 0.225)
    assert mine.logits(torch.rand(1, 3, 64, 64)).shape == (1, 3)
    bare = tmp_path / "bare.pth"
    bare.write_bytes((files / "mine.pth").read_bytes())
    assert load_classifier("resnet18", bare, "cpu").labels == ["class 0", "class 1", "class 2"]
    bare.with_suffix(".json").write_text('{"labels": ["one", "two"]}')
    with pytest.raises(ToolkitError, match="'labels': expected a name for each of the 3 outputs"):
        load_classifier("resnet18", bare, "cpu")
    bare.with_suffix(".json").write_text('{"labels": 3}')
    with pytest.raises(ToolkitError, match="field 'labels'"):
        load_classifier("resnet18", bare, "cpu")


def test_unknown_model_and_device(files):
    with pytest.raises(ToolkitError, match="resnet18"):
        load_classifier("resnet_18", files / "imagenet.pth")
    with pytest.raises(ToolkitError, match="no device called"):
        choose_device("tpu")
    if not torch.cuda.is_available():
        with pytest.raises(ToolkitError, match="no CUDA device"):
            choose_device("cuda")
        assert choose_device("auto") == "cpu"


def test_every_classifier_has_labels_and_preprocessing():
    names = list_architectures()
    assert {"resnet18", "vit_b_16", "mobilenet_v2", "swin_v2_t"} <= set(names)
    for name in names:
        entry = published_weights(name)
        assert len(entry.meta["categories"]) == (10 if name in CIFAR_NETWORKS else 1000)
        assert entry.transforms().crop_size[0] <= entry.transforms().resize_size[0]


@pytest.mark.parametrize("arch", ["densenet121", "googlenet", "mnasnet0_5", "shufflenet_v2_x0_5"])
def test_other_families_load(arch, tmp_path):
    torch.manual_seed(0)
    extra = {"init_weights": False} if arch == "googlenet" else {}
    network = torchvision.models.get_model(arch, **extra).eval()
    state = network.state_dict()
    if arch == "densenet121":  # the names of torchvision's published file
        for part in ("norm", "relu", "conv"):
            state = {name.replace(f".{part}1.", f".{part}.1."): value for name, value in state.items()}
            state = {name.replace(f".{part}2.", f".{part}.2."): value for name, value in state.items()}
        state = {name: value for name, value in state.items() if not name.endswith("num_batches_tracked")}
    torch.save(state, tmp_path / f"{arch}.pth")
    loaded = load_classifier(arch, tmp_path / f"{arch}.pth", "cpu")
    image = torch.rand(1, 3, 64, 64)
    assert loaded.logits(image).shape == (1, 1000)
    if arch != "googlenet":  # which normalises a second time inside, as its published weights want
        with torch.no_grad():
            entry = published_weights(arch).transforms()
            plain = network(torchvision.transforms.functional.normalize(image, entry.mean, entry.std))
            assert torch.allclose(loaded.logits(image), plain, atol=1e-3)


def test_preprocess_gives_what_logits_takes(classifier):
    image = np.full((300, 400, 3), 255, np.uint8)
    tensor = classifier.preprocess(image)
    assert tensor.shape == (3, 224, 224)
    assert tensor.dtype == torch.float32
    assert torch.equal(tensor, torch.ones(3, 224, 224))


@pytest.mark.slow
@pytest.mark.skipif(torch.__version__.startswith("2.9."), reason="torch 2.9 loads it by itself")
def test_torchs_compiler_is_loaded_where_it_is_asked_for(files, tmp_path):
    """It takes 160 MB, and no evaluation needs it, nor whatever else of the kit needs torchvision."""
    drawn = tmp_path / "drawn.pth"  # a network that draws its first weights as torch.nn.init does
    torch.save(torchvision.models.mobilenet_v2().state_dict(), drawn)
    code = (
        "import sys; from pathlib import Path; from toolkit.models.load import load_classifier; "
        "import toolkit.rooms.landing.fly, toolkit.models.load_detector, "
        "toolkit.models.programs, toolkit.training.refine; "
        f"load_classifier('resnet18', Path({str(files / 'imagenet.pth')!r}), 'cpu'); "
        f"load_classifier('mobilenet_v2', Path({str(drawn)!r}), 'cpu'); before = 'sympy' in sys.modules; "
        "import torchvision.ops.roi_align; roi = sys.modules['torchvision.ops.roi_align']; "
        "print(before, getattr(roi, 'is_compile_supported', lambda _: True)('cpu'))"
    )
    done = run_python(code)
    assert done.stdout.split() == [b"False", b"True"], done.stderr.decode()
