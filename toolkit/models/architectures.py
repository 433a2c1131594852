"""Classification networks of torchvision, with published weights and labels; and networks for images of 32 px."""

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from toolkit.core.errors import one_of

if TYPE_CHECKING:
    from torch import nn
    from torchvision.models import WeightsEnum
    from torchvision.transforms._presets import ImageClassification

CIFAR10_LABELS = ("airplane", "automobile", "bird", "cat", "deer", "dog", "frog", "horse", "ship", "truck")
"""In the order of the networks' outputs, which is alphabetical."""
CIFAR_NETWORKS = ("cifar_resnet18", "cifar_resnet50", "cifar_resnet8")


@dataclass(frozen=True)
class CifarWeights:
    """In place of torchvision's weights entry, for networks without published weights: no url, and the labels."""

    url: None = None
    meta: dict[str, list[str]] = field(default_factory=lambda: {"categories": list(CIFAR10_LABELS)})

    def transforms(self) -> "ImageClassification":
        """Preprocessing, as torchvision's entries give it."""
        from toolkit.models.vision import torchvision

        # of all pixels of CIFAR-10's training images
        mean, std = (0.4914, 0.4822, 0.4465), (0.2470, 0.2435, 0.2616)
        return torchvision.transforms._presets.ImageClassification(crop_size=32, resize_size=32, mean=mean, std=std)


def build_cifar_network(arch: str, num_classes: int) -> "nn.Module":
    """Build a network of `CIFAR_NETWORKS` with random weights."""
    from torch import nn

    from toolkit.models.vision import torchvision

    if arch == "cifar_resnet8":
        return _build_resnet8(num_classes)
    module = torchvision.models.get_model(arch.removeprefix("cifar_"), weights=None, num_classes=num_classes)
    # published networks shrink an image fourfold before the first stage: too little would be left of 32 px
    module.conv1 = nn.Conv2d(3, 64, 3, 1, 1, bias=False)
    nn.init.kaiming_normal_(module.conv1.weight, mode="fan_out", nonlinearity="relu")
    module.maxpool = nn.Identity()
    return module


def _build_resnet8(num_classes: int) -> "nn.Module":
    from torch import nn
    from torchvision.models.resnet import BasicBlock, conv1x1

    def stage(inputs: int, outputs: int, stride: int) -> BasicBlock:
        # He et al. (2016), section 4.2, a block in each stage; a 1×1 convolution changes the shape
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
        # as torchvision's own ResNets begin
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, mode="fan_out", nonlinearity="relu")
    return module


def list_architectures() -> list[str]:
    """Names of every classification network of the installed torchvision, and of those for small images."""
    from toolkit.models.vision import torchvision

    return [*torchvision.models.list_models(module=torchvision.models), *CIFAR_NETWORKS]


def published_weights(arch: str) -> "WeightsEnum | CifarWeights":
    """Return torchvision's weights entry (url, labels, preprocessing) of a network: IMAGENET1K_V1, else the default.

    A network for small images has a `CifarWeights` instead.

    Raises:
        ToolkitError: there is no classification network of that name.
    """
    if arch not in (known := list_architectures()):
        raise one_of("model", arch, known)
    from toolkit.models.vision import torchvision

    if arch in CIFAR_NETWORKS:
        return CifarWeights()
    entries = torchvision.models.get_model_weights(arch)
    return getattr(entries, "IMAGENET1K_V1", None) or entries.DEFAULT


def imagenet_labels() -> list[str]:
    """Return the names of ImageNet's 1000 classes, in the order of the published networks' outputs."""
    return published_weights("resnet18").meta["categories"]


def build_network(arch: str, num_classes: int) -> "nn.Module":
    """A network with random weights, as torchvision builds it."""
    from toolkit.models.vision import torchvision

    if arch in CIFAR_NETWORKS:
        return build_cifar_network(arch, num_classes)

    # torchvision sets transform_input for the published weights of these two; their normalisation depends on it
    extra = {"transform_input": True, "init_weights": False} if arch in ("googlenet", "inception_v3") else {}
    return torchvision.models.get_model(arch, weights=None, num_classes=num_classes, **extra)
