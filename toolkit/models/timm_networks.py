"""Networks of timm, called `timm:NAME`: for asking whether a patch transfers to one that torchvision has not."""

import math
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from toolkit.core.console import is_quiet
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.architectures import imagenet_labels
from toolkit.models.find import TIMM_PREFIX as PREFIX
from toolkit.models.labels import adapt_preprocessing, choose_labels
from toolkit.models.network import Classifier, check_numbers, choose_device, read_network_file
from toolkit.models.weights import (
    WeightsFile,
    check_named,
    download,
    find_in_folder,
    no_weights,
    open_weights,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    import torch

HUB_FILE = "model.safetensors"
HUB_TIMEOUT_S = 10.0


def find_timm_weights(name: str, config: dict[str, Any], weights: Path | None) -> WeightsFile:
    """The weights of a network: `weights`, else TOOLKIT_WEIGHTS, else the hub's cache, else timm's download.

    Args:
        name: timm's, without prefix: the folder's file is `NAME-*.pth` or `.safetensors`.
        config: timm's record of the network's weights.
        weights: a file, in place of all others.

    Raises:
        ToolkitError: the named file is missing or of another kind, or none of the ways has weights.
    """
    if weights is not None:
        return open_weights(check_named(Path(weights)))
    if (local := find_in_folder(name)) is not None:
        return open_weights(local)
    if repo := config.get("hf_hub_id"):
        filename = config.get("hf_hub_filename") or HUB_FILE
        return open_weights(_fetch_from_hub(name, repo, filename), f"{repo}/{filename}")
    if url := config.get("url"):
        return open_weights(download(name, url))
    raise FieldError(f"no weights for timm:{name}, and timm publishes none: give a file with {{weights}}", {})


def _fetch_from_hub(name: str, repo: str, filename: str) -> Path:
    """A file of the hub; `repo@revision` names a commit or a tag, else it is the latest commit, found once."""
    from huggingface_hub import get_hf_file_metadata, hf_hub_download, hf_hub_url, try_to_load_from_cache
    from huggingface_hub.utils import disable_progress_bars

    repo, _, revision = repo.partition("@")
    if isinstance(cached := try_to_load_from_cache(repo, filename, revision=revision or None), str):
        return Path(cached)
    if is_quiet():
        disable_progress_bars()
    try:
        # without a network the download itself would try again for half a minute; this asks once
        url = hf_hub_url(repo, filename, revision=revision or None)
        commit = get_hf_file_metadata(url, timeout=HUB_TIMEOUT_S).commit_hash
        # a branch may move between the two calls
        return Path(hf_hub_download(repo, filename, revision=commit, etag_timeout=HUB_TIMEOUT_S))
    except Exception as error:  # those of requests or of httpx, by the hub client's version, and its own
        reason = (str(error).strip().splitlines() or [""])[0][:160] or error.__class__.__name__
    raise no_weights(f"timm:{name}", name, f"let it download {repo} from the Hugging Face hub (failed: {reason})")


def load_timm_network(model: str, weights: Path | None = None, device: str = "auto") -> Classifier:
    """Load a network of timm, with the preprocessing that timm publishes for its weights.

    Args:
        model: `timm:NAME`, or `timm:NAME.TAG` for other than timm's first choice of weights.
        weights: state dict, `.pth`, `.ckpt` or `.safetensors`; by default see `find_timm_weights`. The number of
            classes is read from it; a `WEIGHTS.json` beside it may name them. A file in the format of the network's
            authors is converted where timm knows how.
        device: `auto`, `cpu` or `cuda`.

    Raises:
        ToolkitError: timm is not installed, it has no such network, the network is no classifier or wants images that
            are cut another way, no weights, or weights of another network.
    """
    import torch

    name, place = model.removeprefix(PREFIX), choose_device(device)
    config = published_config(name)
    preprocessing = published_preprocessing(name, config)
    file = find_timm_weights(name, config, weights)
    state, own = read_network_file(file)
    num_classes = _count_classes(model, config, state)
    check_numbers(state.values(), file)
    module = _build(model, state, num_classes, file)
    module = module.requires_grad_(False).eval().to(memory_format=torch.channels_last).to(place)
    published = imagenet_labels()  # timm's ImageNet-1k networks have them in the same order
    labels = choose_labels(file.path, own.labels, published, num_classes)
    return Classifier(
        arch=model, module=module, labels=labels, preprocessing=adapt_preprocessing(preprocessing, own), weights=file,
        device=place, is_imagenet=labels == published, trained_on=own.trained_on or "",
        name=own.name or model.replace(":", "-"),  # it names the run's folder
    )  # fmt: skip


def published_config(name: str) -> dict[str, Any]:
    """What timm knows of a network and its weights.

    Raises:
        ToolkitError: timm is not installed, or has no network of that name.
    """
    timm = _import_timm(name)
    known = [*timm.list_models(), *timm.list_models(pretrained=True)]
    if name not in known:
        near = get_close_matches(name, known, n=3)
        hint = (
            f"did you mean {' or '.join(PREFIX + other for other in near)}?" if near else "timm.list_models() lists all"
        )
        raise ToolkitError(f"timm {timm.__version__} has no network called '{name}': {hint}")
    return timm.get_pretrained_cfg(name).to_dict()


def _import_timm(name: str) -> ModuleType:
    try:
        return import_module("timm")
    except ImportError as error:
        raise FieldError(
            f"timm is not installed ({error}): pip install '.[timm]' in the kit's folder", {"model": f"{PREFIX}{name}"}
        ) from None


def published_preprocessing(name: str, config: dict[str, Any]) -> Preprocessing:
    """The kit's words for timm's: the same pixels as its `create_transform` makes for evaluation.

    Raises:
        ToolkitError: the network wants other than the central square of a colour image.
    """
    from timm.data import resolve_data_config

    wanted = resolve_data_config(pretrained_cfg=config)
    channels, height, width = wanted["input_size"]
    if channels != 3 or height != width or wanted["crop_mode"] != "center":
        raise FieldError(
            f"wants images of {channels}×{height}×{width} with crop mode '{wanted['crop_mode']}': only the central "
            "square of a colour image is supported: choose another network",
            {"model": f"{PREFIX}{name}"},
        )
    # timm truncates here as well
    resize_px = math.floor(height / wanted["crop_pct"])
    return Preprocessing(resize_px, height, wanted["mean"], wanted["std"], wanted["interpolation"].upper())


def _count_classes(model: str, config: dict[str, Any], state: "Mapping[str, torch.Tensor]") -> int:
    """Outputs of the last layer; timm's published number where the file calls that layer otherwise."""
    last = config.get("classifier") or ""
    weight = state.get(f"{last if isinstance(last, str) else last[0]}.weight")
    count = int(config.get("num_classes") or 0) if weight is None else int(weight.shape[0])
    if count < 1:
        raise FieldError("is not a classifier: its weights end in features: choose another network", {"model": model})
    return count


def _build(model: str, state: "Mapping[str, torch.Tensor]", num_classes: int, file: WeightsFile) -> "torch.nn.Module":
    """Timm's own loading: it knows how to convert the formats of the networks' authors."""
    timm = import_module("timm")
    try:
        return timm.create_model(
            model.removeprefix(PREFIX),
            pretrained=True,
            num_classes=num_classes,
            pretrained_cfg_overlay={"state_dict": state, "num_classes": num_classes},
        )
    # each network converts in its own way, and trips over a foreign file in its own way
    except (RuntimeError, LookupError, ValueError, TypeError, AttributeError) as error:
        why = " ".join(str(error).split())[:200]
        raise FieldError(
            f"{file.path} holds no weights of {model}: {why}: name its network with {{model}}", {}
        ) from None
