"""Load a classifier by name: of torchvision or timm, the bundled `rig18`, the user's own, a program or a function."""

import math
from collections import OrderedDict
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from toolkit.core.console import is_quiet
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import read_json, sha256_file
from toolkit.imaging.preprocessing import Preprocessing, published_preprocessing
from toolkit.models.architectures import build_network, imagenet_labels, published_weights
from toolkit.models.find import (
    BUNDLED,
    BUNDLED_DIR,
    DEFAULT_ARCH,
    HF_PREFIX,
    ONNX_PREFIX,
    SUFFIX,
    TIMM_PREFIX,
    ClassifierRecord,
    Found,
    find_classifier,
    is_program,
    pair_weights,
)
from toolkit.models.labels import LabelsFile, adapt_preprocessing, choose_labels
from toolkit.models.network import Classifier, check_numbers, choose_device, read_network_file
from toolkit.models.weights import (
    WeightsFile,
    check_named,
    download,
    find_in_folder,
    find_local,
    find_weights,
    name_prefix,
    no_weights,
    open_weights,
    unwrap_names,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    import torch

    from toolkit.models.heads import AsEncoder

HUB_FILE = "model.safetensors"
HUB_TIMEOUT_S = 10.0


def load_classifier(
    model: str | None = None, weights: Path | None = None, device: str = "auto", folder: Path | None = None
) -> Classifier:
    """Load a classifier: a network by name, one that `toolkit train-classifier` made, a program, a function's.

    The module is stored channels-last: the same numbers to 1e-5, about 1.5 times faster on a CPU.

    Args:
        model: any of `list_architectures`, also as `torchvision:NAME`; `timm:NAME`; the name of a classifier of the
            kit; `onnx:FILE`; a `.pt2` of torch.export; `python:MODULE:FUNCTION`; `hf:ORG/NAME`; the file of a state
            dict; see `find_classifier`.
        weights: state dict, `.pth`, `.ckpt` or `.safetensors`; by default see `find_weights`. The number of classes is
            read from it; a `WEIGHTS.json` beside it may name them. Half precision becomes single.
        device: `auto`, `cpu` or `cuda`.
        folder: of the workspace's own classifiers.

    Raises:
        ToolkitError: unknown network or device, no weights, weights of another network, or other than their record
            says.
    """
    import torch

    if not isinstance(model, str | None):
        how = "a module of your own becomes one by wrap_module(module, labels, size, mean, std)"
        raise FieldError(f"expected the name of a network; {how}", {"model": model.__class__.__name__})
    found = find_classifier(model, weights, folder)
    if (elsewhere := load_elsewhere(found, device)) is not None:
        return elsewhere
    arch, entry, place = found.arch, published_weights(found.arch), choose_device(device)
    file = find_weights(arch, found.weights)
    state, own = read_network_file(file)
    published = entry.meta["categories"]
    num_classes, state = _count_classes(arch, state, len(published), file)
    module = build_network(arch, num_classes)
    _fill(module, state, arch, file)
    module = module.requires_grad_(False).eval().to(memory_format=torch.channels_last).to(place)
    labels = choose_labels(file.path, own.labels, published, num_classes)
    preprocessing = adapt_preprocessing(published_preprocessing(entry.transforms()), own)
    is_imagenet = labels == imagenet_labels()
    return Classifier(
        arch=arch, module=module, labels=labels, preprocessing=preprocessing, weights=file, device=place,
        is_imagenet=is_imagenet, name=own.name or arch, trained_on=own.trained_on or "",
    )  # fmt: skip


def load_elsewhere(found: Found, device: str, features: "AsEncoder | None" = None) -> Classifier | None:
    """A classifier, or with `features` an encoder, that is none of torchvision's; None if it is."""
    if found.arch.startswith(TIMM_PREFIX):
        return load_timm_network(found.arch, found.weights, device)
    if found.arch.startswith(HF_PREFIX):
        from toolkit.models.hugging_face import load_hub_network

        return load_hub_network(found.arch, device, features)
    if not is_program(found.arch):
        return None
    from toolkit.models import programs

    if found.weights is None:
        return programs.load_python_classifier(found.arch, device, features)
    load = programs.load_onnx_classifier if found.arch.startswith(ONNX_PREFIX) else programs.load_exported_classifier
    return load(found.weights, device, features)


def load_classifiers(
    models: Sequence[str] | None, weights: Sequence[Path] | None, device: str = "auto", folder: Path | None = None
) -> list[Classifier]:
    """Several classifiers, at least one; see `load_classifier`.

    Raises:
        ToolkitError: as `pair_weights` and `load_classifier`.
    """
    return [load_classifier(name, file, device, folder) for name, file in pair_weights(models, weights, folder)]


def _count_classes(
    arch: str, state: "OrderedDict[str, torch.Tensor]", published: int, file: WeightsFile
) -> "tuple[int, OrderedDict[str, torch.Tensor]]":
    """Rows of the last layer, and the state dict with the network's own names."""
    import torch

    class Undrawn(torch.overrides.TorchFunctionMode):
        """Random numbers are not drawn: for tensors that hold none torch would load its compiler."""

        def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
            kwargs = kwargs or {}
            if func not in drawing:
                return func(*args, **kwargs)
            return args[0] if args else kwargs["tensor"]

    # what a network calls, and what that calls: within an answer of ours no further call is seen
    drawing = (torch.Tensor.uniform_, torch.Tensor.normal_, torch.nn.init.uniform_, torch.nn.init.normal_)

    # on the meta device a network has shapes and no numbers: nothing is allocated
    with torch.device("meta"), Undrawn():
        expected = build_network(arch, published).state_dict()
    # the last weight with as many rows as there are classes is the classifier's head
    last = [name for name, value in expected.items() if name.endswith(".weight") and value.shape[0] == published][-1]
    state = unwrap_names(state, expected, file.path)
    if last not in state:
        raise _misfit(arch, file, f"it has no '{last}'{name_prefix(state)}")
    if state[last].ndim == 0:
        raise _misfit(arch, file, f"'{last}' is a single number")
    return int(state[last].shape[0]), state


def _fill(module: "torch.nn.Module", state: "OrderedDict[str, torch.Tensor]", arch: str, file: WeightsFile) -> None:
    expected = module.state_dict()
    wrong = [name for name in expected if name in state and state[name].shape != expected[name].shape]
    # batch norm's step counter is absent from old files and plays no part in eval mode
    missing = [name for name in expected if name not in state and not name.endswith("num_batches_tracked")]
    unknown = [name for name in state if name not in expected]
    if wrong:
        shapes = f"{tuple(state[wrong[0]].shape)}, expected {tuple(expected[wrong[0]].shape)}"
        raise _misfit(arch, file, f"'{wrong[0]}' is {shapes}")
    if missing or unknown:
        which = f"it has no '{missing[0]}'" if missing else f"it has '{unknown[0]}', which {arch} has not"
        raise _misfit(arch, file, which)
    if not getattr(state, "_metadata", None):  # safetensors has none: take the file for one of this version
        state._metadata = expected._metadata  # type: ignore[attr-defined]
    module.load_state_dict(state, strict=False)
    check_numbers(module.state_dict().values(), file)


def _misfit(arch: str, file: WeightsFile, why: str) -> ToolkitError:
    return FieldError(f"{file.path} holds no weights of {arch}: {why}: name its network with {{model}}", {})


PATIENCE_S = 5.0
"""How long the network is waited for where there is something else to go on with."""


def bundled_file() -> Path | None:
    """The weights of `rig18`; None where they are not installed."""
    file = BUNDLED_DIR / f"{BUNDLED}{SUFFIX}"
    return file if file.is_file() else None


def read_bundled() -> ClassifierRecord | None:
    """The record of `rig18`, checked against its weights; None where they are not installed.

    Raises:
        ToolkitError: the record is broken, or is of other weights.
    """
    file = bundled_file()
    if file is None:
        return None
    record = read_json(file.with_suffix(".json"), ClassifierRecord)
    if sha256_file(file) != record.sha256:
        raise ToolkitError(f"{file} does not match its record: it was changed or damaged")
    return record


def load_best(device: str) -> tuple[Classifier, str]:
    """ImageNet's ResNet-18 where it can be had, else the bundled classifier; and why, in a sentence.

    Local weights are looked for first, then torchvision's download is tried, shortly.

    Raises:
        ToolkitError: the weights cannot be had and there is no bundled classifier, or a file is damaged.
    """
    if find_local(DEFAULT_ARCH) is not None:
        return load_classifier(DEFAULT_ARCH, device=device), "its weights are on this machine"
    if bundled_file() is None:
        return load_classifier(DEFAULT_ARCH, device=device), "its weights were downloaded"
    try:
        download(DEFAULT_ARCH, str(published_weights(DEFAULT_ARCH).url), PATIENCE_S)
    except ToolkitError:
        why = f"no weights of {DEFAULT_ARCH} on this machine, and none could be downloaded"
        return load_classifier(BUNDLED, device=device), why
    return load_classifier(DEFAULT_ARCH, device=device), "its weights were downloaded"


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

    place = choose_device(device)
    made = build_timm_network(model, weights)
    module = made.module.requires_grad_(False).eval().to(memory_format=torch.channels_last).to(place)
    published = imagenet_labels()  # timm's ImageNet-1k networks have them in the same order
    labels = choose_labels(made.file.path, made.own.labels, published, made.num_classes)
    return Classifier(
        arch=model, module=module, labels=labels, preprocessing=adapt_preprocessing(made.preprocessing, made.own),
        weights=made.file, device=place, is_imagenet=labels == published, trained_on=made.own.trained_on or "",
        name=made.own.name or model.replace(":", "-"),  # it names the run's folder
    )  # fmt: skip


class TimmNetwork(NamedTuple):
    """A network of timm with its weights: how many classes it has (0: it ends in features), and what is said of it."""

    module: "torch.nn.Module"
    num_classes: int
    preprocessing: Preprocessing
    file: WeightsFile
    own: LabelsFile


def build_timm_network(model: str, weights: Path | None = None, may_be_encoder: bool = False) -> TimmNetwork:
    """A network of timm, a classifier unless it `may_be_encoder`; see `load_timm_network`.

    Raises:
        ToolkitError: as `load_timm_network`.
    """
    name = model.removeprefix(TIMM_PREFIX)
    config = read_timm_config(name)
    preprocessing = read_timm_preprocessing(name, config)
    file = find_timm_weights(name, config, weights)
    state, own = read_network_file(file)
    num_classes, state = _count_timm_classes(model, config, state, file)
    if num_classes < 1 and not may_be_encoder:
        raise FieldError(
            f"is not a classifier: its weights end in features: 'toolkit head {model}' makes a classifier of it",
            {"model": model},
        )
    check_numbers(state.values(), file)
    return TimmNetwork(_build_timm(model, state, num_classes, file), num_classes, preprocessing, file, own)


def read_timm_config(name: str) -> dict[str, Any]:
    """What timm knows of a network and its weights.

    Raises:
        ToolkitError: timm is not installed, or has no network of that name.
    """
    timm = _import_timm(name)
    known = [*timm.list_models(), *timm.list_models(pretrained=True)]
    if name not in known:
        near = get_close_matches(name, known, n=3)
        hint = (
            f"did you mean {' or '.join(TIMM_PREFIX + other for other in near)}?"
            if near
            else "timm.list_models() lists all"
        )
        raise ToolkitError(f"timm {timm.__version__} has no network called '{name}': {hint}")
    return timm.get_pretrained_cfg(name).to_dict()


def _import_timm(name: str) -> ModuleType:
    try:
        return import_module("timm")
    except ImportError as error:
        raise FieldError(
            f"timm is not installed ({error}): pip install '.[timm]' in the kit's folder",
            {"model": f"{TIMM_PREFIX}{name}"},
        ) from None


def read_timm_preprocessing(name: str, config: dict[str, Any]) -> Preprocessing:
    """The kit's words for timm's: the same pixels as its `create_transform` makes for evaluation.

    Raises:
        ToolkitError: the network wants other than a square of a colour image.
    """
    from timm.data import resolve_data_config

    wanted = resolve_data_config(pretrained_cfg=config)
    channels, height, width = wanted["input_size"]
    if channels != 3 or height != width or wanted["crop_mode"] not in ("center", "squash"):
        raise FieldError(
            f"wants images of {channels}×{height}×{width} with crop mode '{wanted['crop_mode']}': only a square of a "
            "colour image is supported, its middle or the whole of it: choose another network",
            {"model": f"{TIMM_PREFIX}{name}"},
        )
    # timm truncates here as well
    resize_px = math.floor(height / wanted["crop_pct"])
    return Preprocessing(
        resize_px, height, wanted["mean"], wanted["std"], wanted["interpolation"].upper(),
        squash=wanted["crop_mode"] == "squash",
    )  # fmt: skip


def _count_timm_classes(
    model: str, config: dict[str, Any], state: "OrderedDict[str, torch.Tensor]", file: WeightsFile
) -> "tuple[int, OrderedDict[str, torch.Tensor]]":
    """Outputs of the last layer, and the state dict with timm's names; the published number of another format's."""
    import torch

    last = config.get("classifier") or ""
    head = f"{last if isinstance(last, str) else last[0]}.weight"
    if head not in state and any(name.endswith(f".{head}") for name in state):
        with torch.device("meta"):
            expected = import_module("timm").create_model(model.removeprefix(TIMM_PREFIX), pretrained=False)
        state = unwrap_names(state, expected.state_dict(), file.path)
    weight = state.get(head)
    return int(config.get("num_classes") or 0) if weight is None else int(weight.shape[0]), state


def _build_timm(
    model: str, state: "Mapping[str, torch.Tensor]", num_classes: int, file: WeightsFile
) -> "torch.nn.Module":
    """Timm's own loading: it knows how to convert the formats of the networks' authors."""
    timm = import_module("timm")
    try:
        return timm.create_model(
            model.removeprefix(TIMM_PREFIX),
            pretrained=True,
            num_classes=num_classes,
            pretrained_cfg_overlay={"state_dict": state, "num_classes": num_classes},
        )
    # each network converts in its own way, and trips over a foreign file in its own way
    except (RuntimeError, LookupError, ValueError, TypeError, AttributeError) as error:
        why = " ".join(str(error).split())[:200] + name_prefix(state)
        raise FieldError(
            f"{file.path} holds no weights of {model}: {why}: name its network with {{model}}", {}
        ) from None
