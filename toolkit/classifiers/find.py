"""Which network `--model NAME` means: one of the workspace, the bundled one, or a published one."""

from dataclasses import dataclass
from pathlib import Path

from toolkit.classifiers.architectures import list_architectures
from toolkit.classifiers.labels import read_labels_file
from toolkit.errors import ToolkitError, one_of
from toolkit.workspace import PACKAGE_DATA

BUNDLED = "rig18"
BUNDLED_DIR = PACKAGE_DATA / "classifiers"
DEFAULT_ARCH = "resnet18"
SUFFIX = ".safetensors"
TIMM_PREFIX = "timm:"


@dataclass(frozen=True)
class Found:
    """A network to load.

    Attributes:
        arch: name of it, see `list_architectures`, or `timm:` with timm's.
        weights: its file; None for the published weights.
    """

    arch: str
    weights: Path | None


def find_classifier(model: str | None = None, weights: Path | None = None, folder: Path | None = None) -> Found:
    """The network that `--model` and `--weights` mean.

    A name is looked for in `folder`, among the bundled classifiers, and in `list_architectures`. Without one, the
    record beside the weights says which network they are of, and else it is a ResNet-18.

    Args:
        model: `--model`.
        weights: `--weights`.
        folder: the workspace's `rig/classifiers`.

    Raises:
        ToolkitError: the name is unknown, or a classifier with its own weights was given others.
    """
    if model is not None and model.startswith(TIMM_PREFIX):
        return Found(model, weights)
    if model is None:
        arch = None if weights is None else read_labels_file(Path(weights)).arch
        return Found(arch or DEFAULT_ARCH, weights)
    own = list_own(folder)
    if model in own:
        if weights is not None:
            raise ToolkitError(f"--model {model} --weights {weights}: {model} has its own weights: leave one out")
        return Found(_arch_of(own[model]), own[model])
    if model == BUNDLED:
        raise ToolkitError(
            f"--model {BUNDLED}: {BUNDLED_DIR / BUNDLED}{SUFFIX} is missing from this installation: "
            f"install the package again, or train one with 'toolkit train-classifier --data everyday --name NAME'"
        )
    known = list_architectures()
    if model not in known:
        raise one_of("model", model, [*own, *known])
    return Found(model, weights)


def list_own(folder: Path | None = None) -> dict[str, Path]:
    """Weights of the bundled classifiers and of those in `folder`, by name; a file of `folder` wins."""
    places = [BUNDLED_DIR] if folder is None else [BUNDLED_DIR, folder]
    return {path.stem: path for place in places for path in sorted(place.glob(f"*{SUFFIX}"))}


def _arch_of(weights: Path) -> str:
    arch = read_labels_file(weights).arch
    if arch is None:
        raise ToolkitError(
            f"{weights}: no record {weights.stem}.json with the field 'arch' beside it: name its network with "
            f"--model ARCH --weights {weights}"
        )
    return arch
