"""The faster way back through strided depthwise layers: against float64, and only where it is meant."""

import pytest
import torch
from torch.nn import functional

from toolkit.models.precision import FastDepthwise


@pytest.mark.parametrize(
    ("kernel", "stride", "padding", "size"),
    [  # every two values of two of them together
        ((3, 3), 2, 0, (12, 12)), ((3, 3), (1, 2), 1, (13, 8)), ((3, 3), 3, (0, 2), (12, 12)),
        ((5, 5), 2, 1, (13, 8)), ((5, 5), (1, 2), (0, 2), (12, 12)), ((5, 5), 3, 0, (13, 8)),
        ((3, 5), 2, (0, 2), (13, 8)), ((3, 5), (1, 2), 0, (12, 12)), ((3, 5), 3, 1, (12, 12)),
        ((1, 1), 2, 1, (12, 12)), ((1, 1), (1, 2), 0, (13, 8)), ((1, 1), 3, (0, 2), (13, 8)),
    ],
)  # fmt: skip
def test_the_gradient_is_that_of_float64(kernel, stride, padding, size):
    margins = (padding, padding) if isinstance(padding, int) else padding
    generator = torch.Generator().manual_seed(0)
    image, weight = torch.randn(2, 6, *size, generator=generator), torch.randn(6, 1, *kernel, generator=generator)
    image, weight = image.bfloat16(), weight.bfloat16()
    exact = image.double().requires_grad_(True)
    answer = functional.conv2d(exact, weight.double(), None, stride, padding, groups=6)
    along = torch.randn(answer.shape, generator=generator).bfloat16()
    (wanted,) = torch.autograd.grad(answer, exact, along.double())
    seen = image.clone().requires_grad_(True)
    with FastDepthwise():
        fast = functional.conv2d(seen, weight, stride=stride, padding=padding, groups=6)
    fits = all(margin < side for margin, side in zip(margins, kernel, strict=True))  # else it goes the usual way
    assert ("Strided" in type(fast.grad_fn).__name__) is fits
    assert torch.equal(fast, functional.conv2d(seen, weight, None, stride, padding, groups=6))
    (found,) = torch.autograd.grad(fast, seen, along)
    assert found.dtype == torch.bfloat16
    torch.testing.assert_close(found.double(), wanted, rtol=1e-2, atol=1e-2)


def test_a_layer_of_a_network_goes_it_under_autocast():
    """As torchvision's and timm's layers call it, behind one that makes bfloat16; with a bias."""
    torch.manual_seed(0)
    first, layer = torch.nn.Conv2d(3, 8, 1), torch.nn.Conv2d(8, 8, 3, 2, 1, groups=8)
    network = torch.nn.Sequential(first, layer).requires_grad_(False)
    found = []
    for fast in (False, True):
        image = torch.linspace(0, 1, 2 * 3 * 9 * 9).reshape(2, 3, 9, 9).requires_grad_(True)
        with torch.autocast("cpu", torch.bfloat16):
            if fast:
                with FastDepthwise():
                    answer = network(image)
            else:
                answer = network(image)
        found.append((answer, torch.autograd.grad(answer.float().square().sum(), image)[0]))
    assert "Strided" in type(found[1][0].grad_fn).__name__
    assert torch.equal(found[0][0], found[1][0])
    torch.testing.assert_close(found[0][1], found[1][1], rtol=2e-2, atol=2e-3)


@pytest.mark.parametrize(
    "what", ["float32", "no stride", "not depthwise", "dilated", "same", "trained weights", "no gradient"]
)
def test_what_is_not_meant_goes_the_usual_way(what):
    kind = torch.float32 if what == "float32" else torch.bfloat16
    image = torch.randn(1, 4, 9, 9, dtype=kind, requires_grad=what != "no gradient")
    groups = 2 if what == "not depthwise" else 4
    weight = torch.randn(4, 4 // groups, 3, 3, dtype=kind, requires_grad=what == "trained weights")
    named = {"stride": 1 if what in ("no stride", "same") else 2, "padding": "same" if what == "same" else 1}
    named |= {"dilation": 2 if what == "dilated" else 1, "groups": groups}
    with FastDepthwise():
        answer = functional.conv2d(image, weight, **named)
    assert "Strided" not in type(answer.grad_fn).__name__
    assert torch.equal(answer, functional.conv2d(image, weight, **named))
