"""Networks for images of 32 px, which torchvision has none of: its own shrink them to one pixel.

`cifar_resnet18` and `cifar_resnet50` are torchvision's with a first convolution of 3×3 at stride 1 and without max
pooling, as the CIFAR networks of the `robustness` package (Engstrom et al. 2019). `cifar_resnet8` is the smallest
of He et al. 2016, section 4.2 (6n + 2 layers, n = 1), with a convolution where a shortcut changes its shape.
"""

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

CIFAR10_LABELS = ("airplane", "automobile", "bird", "cat", "deer", "dog", "frog", "horse", "ship", "truck")
"""In the order of the networks' outputs, which is alphabetical."""
CIFAR_NETWORKS = ("cifar_resnet18", "cifar_resnet50", "cifar_resnet8")


def _transforms() -> Any:
    from torchvision.transforms._presets import ImageClassification

    # of all pixels of CIFAR-10's training images
    mean, std = (0.4914, 0.4822, 0.4465), (0.2470, 0.2435, 0.2616)
    return ImageClassification(crop_size=32, resize_size=32, mean=mean, std=std)


@dataclass(frozen=True)
class CifarWeights:
    """Stands where torchvision's weights entry stands for its networks; nobody publishes weights of these.

    Attributes:
        url: None: there is nothing to download.
        meta: the labels, as `categories`.
    """

    url: None = None
    meta: dict[str, Any] = field(default_factory=lambda: {"categories": list(CIFAR10_LABELS)})

    def transforms(self) -> Any:
        """Preprocessing, as torchvision's entries give it."""
        return _transforms()


def build_cifar_network(arch: str, num_classes: int) -> Any:
    """One of `CIFAR_NETWORKS` with random weights."""
    import torchvision
    from torch import nn

    if arch == "cifar_resnet8":
        return _build_resnet8(num_classes)
    module = torchvision.models.get_model(arch.removeprefix("cifar_"), weights=None, num_classes=num_classes)
    module.conv1 = nn.Conv2d(3, 64, 3, 1, 1, bias=False)
    nn.init.kaiming_normal_(module.conv1.weight, mode="fan_out", nonlinearity="relu")
    module.maxpool = nn.Identity()
    return module


def _build_resnet8(num_classes: int) -> Any:
    from torch import nn
    from torchvision.models.resnet import BasicBlock, conv1x1

    def stage(inputs: int, outputs: int, stride: int) -> Any:
        narrow = None if stride == 1 else nn.Sequential(conv1x1(inputs, outputs, stride), nn.BatchNorm2d(outputs))
        return BasicBlock(inputs, outputs, stride, narrow)

    module = nn.Sequential(
        OrderedDict(
            conv1=nn.Conv2d(3, 16, 3, 1, 1, bias=False), bn1=nn.BatchNorm2d(16), relu=nn.ReLU(inplace=True),
            layer1=stage(16, 16, 1), layer2=stage(16, 32, 2), layer3=stage(32, 64, 2),
            avgpool=nn.AdaptiveAvgPool2d(1), flatten=nn.Flatten(), fc=nn.Linear(64, num_classes),
        )
    )  # fmt: skip
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, mode="fan_out", nonlinearity="relu")
    return module
