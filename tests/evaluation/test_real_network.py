"""A real ResNet-18 on real photographs."""

import pytest


@pytest.fixture(scope="module")
def classifier(real_weights):
    from toolkit.models.load import load_classifier

    file = sorted(real_weights.glob("resnet18-*.pth"))[0]
    return load_classifier("resnet18", file, "cpu")


@pytest.fixture(scope="module")
def photographs(shared, tmp_path_factory):
    """Every eighth of the 1000 photographs, linked by copies into a folder of its own."""
    import shutil

    source = shared / "images" / "nips2017"
    if not source.is_dir():
        pytest.skip("needs the photographs in ../shared/images/nips2017")
    root = tmp_path_factory.mktemp("photographs")
    for file in sorted(source.glob("n*/*.jpg"))[::8]:
        (root / file.parent.name).mkdir(exist_ok=True)
        shutil.copyfile(file, root / file.parent.name / file.name)
    return root


@pytest.fixture(scope="module")
def result(classifier, photographs, tmp_path_factory):
    from toolkit.core.workspace import Workspace
    from toolkit.evaluation.evaluate import evaluate_captures

    return evaluate_captures(photographs, Workspace(tmp_path_factory.mktemp("space")), classifier)


@pytest.mark.slow
def test_accuracy_is_the_networks(result):
    pooled = next(group for group in result.groups if group.object == "all")
    assert (pooled.n, pooled.failed) == (125, 0)
    # 75.5 % on all 1000; four standard errors of 125
    assert abs(pooled.top1 - 0.755) < 4 * (0.755 * 0.245 / 125) ** 0.5
    assert pooled.top5 > 0.85


def test_same_guesses_as_torchvision_alone(result, classifier):
    import torch
    import torchvision
    from PIL import Image

    plain = torchvision.models.resnet18()
    plain.load_state_dict(torch.load(classifier.weights.path, weights_only=True))
    transform = torchvision.models.ResNet18_Weights.IMAGENET1K_V1.transforms()
    chosen = result.predictions[::10]
    batch = torch.stack([transform(Image.open(one.capture.file).convert("RGB")) for one in chosen])
    with torch.no_grad():
        probabilities = plain.eval()(batch).softmax(1)
    for one, expected in zip(chosen, probabilities, strict=True):
        assert one.top1_index == int(expected.argmax())
        assert one.top1_prob == pytest.approx(float(expected.max()), abs=1e-4)


def test_gradcam_is_the_class_activation_map_of_a_resnet(result, classifier):
    """A ResNet ends in an average pool and a linear layer, for which the map has a closed form (Zhou et al. 2016)."""
    import numpy as np
    import torch

    from toolkit.evaluation.saliency import compute_gradcam, find_feature_map
    from toolkit.imaging.read import read_image

    module = find_feature_map(classifier)
    assert module is classifier.module.layer4
    chosen = result.predictions[::60]
    batch = torch.stack([classifier.preprocess(read_image(one.capture.file)) for one in chosen])
    classes, seen = [one.true_index for one in chosen], []
    hook = module.register_forward_hook(lambda _, __, output: seen.append(output))
    with torch.no_grad():
        classifier.logits(batch)
    hook.remove()
    cam = torch.einsum("bk,bkhw->bhw", classifier.module.fc.weight[classes], seen[0]).clamp_min(0) / 49
    found = compute_gradcam(classifier, module, batch, classes)
    assert found.shape == (len(chosen), 7, 7)
    np.testing.assert_allclose(found, cam.numpy(), atol=1e-4)
