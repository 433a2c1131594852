"""Load a classifier by name: of torchvision or timm, the bundled `rig18`, the user's own, a program or a function."""

import math
from collections import OrderedDict
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from toolkit.core.console import is_quiet
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.extras import import_package
from toolkit.core.files import read_json, sha256_file
from toolkit.core.lazy import torch
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
    HUB_TIMEOUT_S,
    WeightsFile,
    check_named,
    download,
    find_commit,
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

    from toolkit.models.heads import AsEncoder

HUB_FILE = "model.safetensors"


def load_classifier(
    model: str | None = None, weights: Path | None = None, device: str = "auto", folder: Path | None = None
) -> Classifier:
    """Load a classifier: a network by name, from `toolkit train-classifier`, a program, or a function's.

    The module is stored channels-last: the same numbers to 1e-5, about 1.5 times faster on a CPU.

    Args:
        model: see `find_classifier`.
        weights: state dict, `.pth`, `.ckpt` or `.safetensors`; by default see `find_weights`. The number of classes is
            read from it; a `WEIGHTS.json` beside it may name them. Half precision becomes single.
        device: `auto`, `cpu` or `cuda`.
        folder: folder of the workspace's own classifiers.

    Raises:
        ToolkitError: unknown network or device, no weights, or weights that do not fit the network or their record.
    """
    if not isinstance(model, str | None):
        how = "wrap a module by wrap_module(module, labels, size, mean, std)"
        raise FieldError(f"expected the name of a network: {how}", {"model": model.__class__.__name__})
    found = find_classifier(model, weights, folder)
    if (elsewhere := load_elsewhere(found, device)) is not None:
        return elsewhere
    # weights, then a network with as many classes
    arch, entry, place = found.arch, published_weights(found.arch), choose_device(device)
    file = find_weights(arch, found.weights)
    state, own = read_network_file(file)
    # as many outputs as the weights have, with the published labels if the numbers agree
    published = entry.meta["categories"]
    num_classes, state = _count_classes(arch, state, len(published), file)
    module = build_network(arch, num_classes)
    _fill(module, state, arch, file)
    how_published = published_preprocessing(entry.transforms())
    return _make_classifier(BuiltNetwork(module, num_classes, how_published, file, own), arch, place, published, arch)


def _make_classifier(made: "BuiltNetwork", arch: str, place: str, published: list[str], name: str) -> Classifier:
    """Join a network with its labels and preprocessing, on its device; `name` is its name by default."""
    own, labels = made.own, choose_labels(made.file.path, made.own.labels, published, made.num_classes)
    return Classifier(
        arch=arch, module=made.module.requires_grad_(False).eval().to(memory_format=torch.channels_last).to(place),
        labels=labels, preprocessing=adapt_preprocessing(made.preprocessing, own), weights=made.file, device=place,
        is_imagenet=labels == imagenet_labels(), name=own.name or name, trained_on=own.trained_on or "",
    )  # fmt: skip


def load_elsewhere(found: Found, device: str, features: "AsEncoder | None" = None) -> Classifier | None:
    """Load a classifier, or with `features` an encoder, that is none of torchvision's; None if it is."""
    if found.arch.startswith(TIMM_PREFIX):
        # timm's ImageNet-1k networks have the labels in the same order; the name is that of a run's folder
        place, made = choose_device(device), build_timm_network(found.arch, found.weights)
        return _make_classifier(made, found.arch, place, imagenet_labels(), found.arch.replace(":", "-"))
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
    """Return the rows of the last layer, and the state dict with the network's own names."""

    class Undrawn(torch.overrides.TorchFunctionMode):
        """Draws no random numbers: for tensors that hold none, torch would load its compiler."""

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
    # each kind of misfit has its own message, with the first tensor as an example
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
    if not getattr(state, "_metadata", None):  # safetensors has none: assume this version
        state._metadata = expected._metadata  # type: ignore[attr-defined]
    module.load_state_dict(state, strict=False)
    check_numbers(module.state_dict().values(), file)


def _misfit(arch: str, file: WeightsFile, why: str) -> ToolkitError:
    return FieldError(f"{file.path} holds no weights of {arch}: {why}: name its network with {{model}}", {})


PATIENCE_S = 5.0
"""Timeout of the download if there are other weights."""


def bundled_file() -> Path | None:
    """Return the weights of `rig18`; None if they are not installed."""
    file = BUNDLED_DIR / f"{BUNDLED}{SUFFIX}"
    return file if file.is_file() else None


def read_bundled() -> ClassifierRecord | None:
    """Read the record of `rig18`, checked against its weights; None if they are not installed.

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
    """Load ImageNet's ResNet-18 if it has weights, else the bundled classifier; and say why in a sentence.

    Raises:
        ToolkitError: there are no weights and no bundled classifier, or a file is damaged.
    """
    # no download if the weights are here
    if find_local(DEFAULT_ARCH) is not None:
        return load_classifier(DEFAULT_ARCH, device=device), "its weights are on this machine"
    if bundled_file() is not None:
        # a short wait: without a connection the demonstration must not hang
        try:
            download(DEFAULT_ARCH, str(published_weights(DEFAULT_ARCH).url), PATIENCE_S)
        except ToolkitError:
            why = f"no weights of {DEFAULT_ARCH} on this machine, and none could be downloaded"
            return load_classifier(BUNDLED, device=device), why
    return load_classifier(DEFAULT_ARCH, device=device), "its weights were downloaded"


def _find_timm_weights(name: str, config: dict[str, Any], weights: Path | None) -> WeightsFile:
    """Return the weights of a network: `weights`, else TOOLKIT_WEIGHTS, else the hub's cache, else timm's download."""
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
    """Download a file of the hub; `repo@revision` names a commit or a tag, else it is the latest commit."""
    from huggingface_hub import hf_hub_download, try_to_load_from_cache
    from huggingface_hub.utils import disable_progress_bars

    repo, _, revision = repo.partition("@")
    # what the cache has needs no connection
    if isinstance(cached := try_to_load_from_cache(repo, filename, revision=revision or None), str):
        return Path(cached)
    if is_quiet():
        disable_progress_bars()
    try:
        # the commit: a branch may move between the two calls
        commit = find_commit(repo, filename, revision or None)
        return Path(hf_hub_download(repo, filename, revision=commit, etag_timeout=HUB_TIMEOUT_S))
    except Exception as error:  # those of requests or of httpx, by the hub client's version, and its own
        reason = (str(error).strip().splitlines() or [""])[0][:160] or error.__class__.__name__
    raise no_weights(f"timm:{name}", name, f"let it download {repo} from the Hugging Face hub (failed: {reason})")


class BuiltNetwork(NamedTuple):
    """A network with its weights and description; `num_classes` 0: it ends in features."""

    module: "torch.nn.Module"
    num_classes: int
    preprocessing: Preprocessing
    file: WeightsFile
    own: LabelsFile


def build_timm_network(model: str, weights: Path | None = None, may_be_encoder: bool = False) -> BuiltNetwork:
    """Build a network of timm, with the preprocessing that timm publishes for its weights.

    Args:
        model: `timm:NAME`, or `timm:NAME.TAG` for other than timm's first choice of weights.
        weights: state dict, `.pth`, `.ckpt` or `.safetensors`. timm converts formats of the networks' authors. None:
            `NAME-*.pth` or `.safetensors` in TOOLKIT_WEIGHTS, else the hub's cache, else timm's download.
        may_be_encoder: whether the network may end in features.

    Raises:
        ToolkitError: timm is not installed, has no such network, the network is no classifier, its crop is not
            supported, or the weights are missing or of another network.
    """
    name = model.removeprefix(TIMM_PREFIX)
    config = read_timm_config(name)
    preprocessing = read_timm_preprocessing(name, config)
    file = _find_timm_weights(name, config, weights)
    state, own = read_network_file(file)
    num_classes, state = _count_timm_classes(model, config, state, file)
    if num_classes < 1 and not may_be_encoder:
        raise FieldError(
            f"is not a classifier: its weights end in features: 'toolkit head {model}' makes a classifier of it",
            {"model": model},
        )
    check_numbers(state.values(), file)
    return BuiltNetwork(_build_timm(model, state, num_classes, file), num_classes, preprocessing, file, own)


def _import_timm(model: str) -> ModuleType:
    return import_package("timm", "timm", model)


def read_timm_config(name: str) -> dict[str, Any]:
    """Return timm's record of a network and its weights.

    Raises:
        ToolkitError: timm is not installed, or has no network of that name.
    """
    timm = _import_timm(f"{TIMM_PREFIX}{name}")
    known = [*timm.list_models(), *timm.list_models(pretrained=True)]
    if name not in known:
        near = [f"{TIMM_PREFIX}{other}" for other in get_close_matches(name, known, n=3)]
        hint = f"did you mean {' or '.join(near)}?" if near else "timm.list_models() lists all"
        raise ToolkitError(f"timm {timm.__version__} has no network called '{name}': {hint}")
    return timm.get_pretrained_cfg(name).to_dict()


def read_timm_preprocessing(name: str, config: dict[str, Any]) -> Preprocessing:
    """Translate timm's preprocessing: the same pixels as its `create_transform` makes for evaluation.

    Raises:
        ToolkitError: the network wants other than a square of a colour image.
    """
    from timm.data import resolve_data_config

    # timm's own rules fill in what the weights' record leaves out
    wanted = resolve_data_config(pretrained_cfg=config)
    channels, *sides = wanted["input_size"]
    # timm truncates here as well
    resize_px = math.floor(sides[0] / wanted["crop_pct"])
    sides = sides if channels == 3 else wanted["input_size"]
    return square_preprocessing(f"{TIMM_PREFIX}{name}", sides, wanted["crop_mode"], resize_px, wanted)


def square_preprocessing(
    model: str, sides: Sequence[int], mode: str, resize_px: int, wanted: "Mapping[str, Any]"
) -> Preprocessing:
    """Translate another library's preprocessing: `mode` of the crop, and `mean`, `std` and `interpolation`.

    Raises:
        FieldError: the sides differ, or the crop is not the middle or the whole image.
    """
    if len(set(sides)) != 1 or mode not in ("center", "shortest", "squash"):
        raise FieldError(
            f"wants images of {'×'.join(map(str, sides))} with the crop mode '{mode}': only a square of a colour image "
            "is supported, its middle or the whole image: choose another network",
            {"model": model},
        )
    mean, std = tuple(wanted["mean"]), tuple(wanted["std"])
    return Preprocessing(resize_px, sides[0], mean, std, wanted["interpolation"].upper(), squash=mode == "squash")


def _count_timm_classes(
    model: str, config: dict[str, Any], state: "OrderedDict[str, torch.Tensor]", file: WeightsFile
) -> "tuple[int, OrderedDict[str, torch.Tensor]]":
    """Return the outputs of the last layer, and the state dict with timm's names; for other formats as published."""
    last = config.get("classifier") or ""
    head = f"{last if isinstance(last, str) else last[0]}.weight"
    if head not in state and any(name.endswith(f".{head}") for name in state):
        with torch.device("meta"):
            expected = _import_timm(model).create_model(model.removeprefix(TIMM_PREFIX), pretrained=False)
        state = unwrap_names(state, expected.state_dict(), file.path)
    weight = state.get(head)
    return int(config.get("num_classes") or 0) if weight is None else int(weight.shape[0]), state


def _build_timm(
    model: str, state: "Mapping[str, torch.Tensor]", num_classes: int, file: WeightsFile
) -> "torch.nn.Module":
    """Load by timm itself, which converts the formats of the networks' authors."""
    timm = _import_timm(model)
    try:
        return timm.create_model(
            model.removeprefix(TIMM_PREFIX),
            pretrained=True,
            num_classes=num_classes,
            pretrained_cfg_overlay={"state_dict": state, "num_classes": num_classes},
        )
    # each network converts in its own way, and fails at another file in its own way
    except (RuntimeError, LookupError, ValueError, TypeError, AttributeError) as error:
        why = " ".join(str(error).split())[:200] + name_prefix(state)
        raise FieldError(
            f"{file.path} holds no weights of {model}: {why}: name its network with {{model}}", {}
        ) from None
