"""Half precision is used where its gradients are right, and only there."""

import pytest
import torch

from toolkit.models.precision import choose_precision, has_native_bfloat16, has_unseen_taps


def test_pictures_smaller_than_a_stride_are_found():
    assert has_unseen_taps("resnet18", 16)  # its last stage halves a picture of one pixel
    assert not has_unseen_taps("resnet18", 32)
    assert not has_unseen_taps("resnet50", 128)
    assert has_unseen_taps("efficientnet_b0", 32)  # kernels of 5 on a picture of one pixel
    assert choose_precision("resnet18", 16, "cpu") == "float32"
    assert choose_precision("resnet18", 128, "cpu") == ("bfloat16" if has_native_bfloat16() else "float32")


@pytest.mark.skipif(not has_native_bfloat16(), reason="needs a processor that multiplies in bfloat16")
@pytest.mark.parametrize(("side", "stride"), [(1, 1), (2, 2), (2, 1), (4, 2), (8, 2)])
def test_gradients_of_what_is_let_through_are_right(side, stride):
    """The convolutions of a ResNet's last stages at 32 px and above, with memory that holds something else before."""
    layer = torch.nn.Conv2d(64, 128, 3, stride, 1, bias=False).to(memory_format=torch.channels_last)
    images = torch.randn(8, 64, side, side, generator=torch.Generator().manual_seed(0))
    for _ in range(4):
        junk = torch.full((2 * layer.weight.numel(),), 1e30)
        del junk
        layer.weight.grad = None
        with torch.autocast("cpu", torch.bfloat16):
            answer = layer(images.to(memory_format=torch.channels_last))
        answer.float().square().mean().backward()
        slope = 2 * answer.detach().float() / answer.numel()
        exact = torch.nn.grad.conv2d_weight(images, layer.weight.shape, slope, stride, 1)
        assert float((layer.weight.grad - exact).abs().max()) < 0.02 * float(exact.abs().max())
