"""The classification networks: which there are, and what comes with each."""

from toolkit.classifiers.cifar_networks import CIFAR_NETWORKS, CifarWeights, build_cifar_network
from toolkit.errors import one_of


def list_architectures() -> list[str]:
    """Names of every classification network of the installed torchvision, and of those for small images."""
    import torchvision

    return [*torchvision.models.list_models(module=torchvision.models), *CIFAR_NETWORKS]


def published_weights(arch: str):
    """The torchvision weights entry (url, labels, preprocessing) of a network: IMAGENET1K_V1 where there is one.

    A network for small images has a `CifarWeights` instead, without url.

    Raises:
        ToolkitError: there is no classification network of that name.
    """
    import torchvision

    if arch not in (known := list_architectures()):
        raise one_of("model", arch, known)
    if arch in CIFAR_NETWORKS:
        return CifarWeights()
    entries = torchvision.models.get_model_weights(arch)
    return getattr(entries, "IMAGENET1K_V1", None) or entries.DEFAULT


def imagenet_labels() -> list[str]:
    """Names of ImageNet's 1000 classes, in the order that the published networks answer in."""
    return published_weights("resnet18").meta["categories"]


def build_network(arch: str, num_classes: int):
    """A network with random weights, as torchvision builds it."""
    import torchvision

    if arch in CIFAR_NETWORKS:
        return build_cifar_network(arch, num_classes)

    # torchvision sets transform_input for the published weights of these two; their normalisation depends on it
    extra = {"transform_input": True, "init_weights": False} if arch in ("googlenet", "inception_v3") else {}
    return torchvision.models.get_model(arch, weights=None, num_classes=num_classes, **extra)
