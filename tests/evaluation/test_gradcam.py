"""Grad-CAM against closed forms and finite differences, and on the shapes that networks come in."""

import dataclasses

import numpy as np
import pytest
import torch
from torch import nn
from torchvision import models

from toolkit.evaluation.saliency import NoSaliency, compute_gradcam, find_feature_map


class Tail(nn.Module):
    """Convolutions, a smooth or a linear head; works in place where a network may."""

    def __init__(self, smooth: bool) -> None:
        super().__init__()
        self.body = nn.Sequential(nn.Conv2d(3, 5, 3, stride=2), nn.Tanh(), nn.Conv2d(5, 6, 3, stride=2))
        self.head = nn.Linear(6, 4)
        self.smooth = smooth

    def forward(self, batch):
        return self.read(self.body(batch))

    def read(self, features):
        features = features.mul_(1.0)  # in place, on what the hook returned
        pooled = (torch.sigmoid(features) ** 2).mean((2, 3)) if self.smooth else features.mean((2, 3))
        return self.head(pooled)


@pytest.fixture
def wrap(colour_classifier):
    def make(module):
        torch.manual_seed(0)
        return dataclasses.replace(colour_classifier, arch="tiny", module=module.eval().requires_grad_(False))

    return make


@pytest.fixture
def batch():
    return torch.rand(3, 3, 28, 28, generator=torch.Generator().manual_seed(3))


def test_equals_the_class_activation_map(wrap, batch):
    """With global average pooling and a linear layer: CAM (Zhou et al. 2016) cut at zero, over the number of places."""
    torch.manual_seed(1)
    classifier = wrap(Tail(smooth=False))
    module = find_feature_map(classifier)
    assert module is classifier.module.body
    found = compute_gradcam(classifier, module, batch, [0, 3, 1])
    features = classifier.module.body(batch)
    cam = torch.einsum("bk,bkhw->bhw", classifier.module.head.weight[[0, 3, 1]], features)
    places = features.shape[2] * features.shape[3]
    np.testing.assert_allclose(found, cam.clamp_min(0).numpy() / places, atol=1e-6)
    assert found.max() > 0 and found.dtype == np.float32


def test_weights_against_finite_differences(wrap, batch):
    """A channel's weight is the logit's change when the whole channel is raised, over the number of places."""
    torch.manual_seed(1)
    classifier = wrap(Tail(smooth=True).double())
    batch = batch.double()
    found = compute_gradcam(classifier, classifier.module.body, batch, [2, 2, 2])
    features = classifier.module.body(batch)
    step, expected = 1e-5, torch.zeros_like(features[:, 0])
    for channel in range(features.shape[1]):
        raised = torch.zeros_like(features)
        raised[:, channel] = step
        slope = (classifier.module.read(features + raised) - classifier.module.read(features - raised)) / (2 * step)
        weight = slope[:, 2] / (features.shape[2] * features.shape[3])
        expected += weight[:, None, None] * features[:, channel]
    np.testing.assert_allclose(found, expected.clamp_min(0).numpy(), rtol=1e-4, atol=1e-8)


def test_images_do_not_mix_and_nothing_is_left_behind(wrap, batch):
    torch.manual_seed(1)
    classifier = wrap(Tail(smooth=True))
    module = find_feature_map(classifier)
    together = compute_gradcam(classifier, module, batch, [0, 1, 2])
    single = [compute_gradcam(classifier, module, batch[i : i + 1], [i])[0] for i in range(3)]
    np.testing.assert_allclose(together, np.stack(single), atol=1e-7)
    assert not any(part._forward_hooks for part in classifier.module.modules())
    with torch.inference_mode():
        assert not classifier.logits(batch).requires_grad


class Flatten(nn.Module):
    def forward(self, batch):
        return batch.mean((2, 3)) @ torch.ones(3, 4)


class Aside(nn.Module):
    """A feature map that nothing comes of."""

    def __init__(self) -> None:
        super().__init__()
        self.conv, self.head = nn.Conv2d(3, 4, 3), nn.Linear(3, 4)

    def forward(self, batch):
        self.conv(batch)
        return self.head(batch.mean((2, 3)))


def tiny_vit():
    return models.VisionTransformer(28, 14, 1, 2, 8, 8, num_classes=4)


def test_networks_without_a_map_are_left_out_with_a_reason(wrap, batch):
    with pytest.raises(NoSaliency, match="tiny has no feature map"):
        find_feature_map(wrap(Flatten()))
    with pytest.raises(NoSaliency, match="before its attention layers"):
        find_feature_map(wrap(tiny_vit()))
    aside = wrap(Aside())
    with pytest.raises(NoSaliency, match="does not lead to its output"):
        compute_gradcam(aside, find_feature_map(aside), batch, [0, 0, 0])


@pytest.mark.parametrize(
    ("build", "name"),
    [
        (lambda: models.resnet18(num_classes=4), "layer4"),
        (lambda: models.squeezenet1_1(num_classes=4), "classifier.2"),
        (lambda: models.DenseNet(4, (2, 2), 8, num_classes=4), "features"),
        (lambda: models.SwinTransformer([4, 4], 8, [1, 1], [1, 2], [2, 2], num_classes=4), "permute"),
        (lambda: models.mobilenet_v2(width_mult=0.25, num_classes=4), "features"),
    ],
)
def test_torchvision_networks(wrap, colour_classifier, build, name):
    torch.manual_seed(0)
    how = dataclasses.replace(colour_classifier.preprocessing, resize_px=72, crop_px=64)
    classifier = dataclasses.replace(wrap(build()), preprocessing=how)
    module = find_feature_map(classifier)
    assert dict(classifier.module.named_modules())[name] is module
    found = compute_gradcam(classifier, module, torch.rand(2, 3, 64, 64), [0, 1])
    assert found.shape[0] == 2 and min(found.shape[1:]) > 1
    assert np.isfinite(found).all() and (found >= 0).all()


def test_squeezenet_is_its_own_class_map(wrap, colour_classifier):
    """Its last map has a channel per class and is averaged: Grad-CAM must be that channel over the places."""
    torch.manual_seed(0)
    how = dataclasses.replace(colour_classifier.preprocessing, resize_px=72, crop_px=64)
    classifier = dataclasses.replace(wrap(models.squeezenet1_1(num_classes=4)), preprocessing=how)
    module, seen = find_feature_map(classifier), []
    pixels = torch.rand(1, 3, 64, 64)
    hook = module.register_forward_hook(lambda _, __, output: seen.append(output.clone()))
    with torch.no_grad():
        logits = classifier.logits(pixels)
    hook.remove()
    best = int(logits.argmax())
    found = compute_gradcam(classifier, module, pixels, [best])
    places = seen[0].shape[2] * seen[0].shape[3]
    np.testing.assert_allclose(found[0], torch.relu(seen[0][0, best]).numpy() / places, atol=1e-6)
    assert found.max() > 0
    assert found.sum() == pytest.approx(float(logits[0, best]), abs=1e-5)


class ChannelsLast(nn.Module):
    """`Tail`, whose features lie (b, h, w, c)."""

    def __init__(self, tail) -> None:
        super().__init__()
        self.tail, self.turn = tail, Turn()

    def forward(self, batch):
        return self.tail.read(self.turn(self.tail.body(batch)).permute(0, 3, 1, 2).clone())


class Turn(nn.Module):
    def forward(self, features):
        return features.permute(0, 2, 3, 1)


def seeing(classifier, side):
    """The classifier with images of another size."""
    return dataclasses.replace(
        classifier, preprocessing=dataclasses.replace(classifier.preprocessing, resize_px=side, crop_px=side)
    )


def test_channels_last_give_the_same_maps(wrap):
    batch = torch.rand(3, 3, 36, 36, generator=torch.Generator().manual_seed(3))
    first = seeing(wrap(Tail(smooth=True)), 36)
    last = seeing(wrap(ChannelsLast(first.module)), 36)
    module = find_feature_map(last)
    assert module is last.module.turn
    expected = compute_gradcam(first, find_feature_map(first), batch, [0, 3, 1])
    np.testing.assert_allclose(compute_gradcam(last, module, batch, [0, 3, 1]), expected, atol=1e-7)
    assert expected.shape == (3, 8, 8)


def test_swin_of_timm_has_maps_of_rows_and_columns(wrap):
    timm = pytest.importorskip("timm")
    torch.manual_seed(0)
    how = {"embed_dim": 24, "depths": (1, 1), "num_heads": (2, 4)}
    classifier = seeing(wrap(timm.create_model("swin_tiny_patch4_window7_224", num_classes=4, **how)), 224)
    maps = compute_gradcam(classifier, find_feature_map(classifier), torch.rand(1, 3, 224, 224), [2])
    assert maps.shape == (1, 28, 28)


def test_a_map_depends_on_its_image_alone(wrap):
    class ByShape(Tail):
        def forward(self, batch):
            return super().forward(batch) * len(batch)

    classifier, images = wrap(ByShape(smooth=True)), torch.rand(6, 3, 28, 28)
    module, classes = find_feature_map(classifier), [0, 1, 2, 3, 0, 1]
    whole = compute_gradcam(classifier, module, images, classes)
    assert whole.max() > 0
    for k in range(6):
        alone = compute_gradcam(classifier, module, images[k : k + 1], classes[k : k + 1])
        assert np.array_equal(alone[0], whole[k])
