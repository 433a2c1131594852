"""Find and read a network's weights, wherever the user keeps them."""

import contextlib
import math
import os
import re
import socket
import sys
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from pydantic import ValidationError

from toolkit.core.child import is_memory_full, limit_memory
from toolkit.core.console import is_quiet, notice_once
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import explain_validation, sha256_file
from toolkit.core.lazy import torch
from toolkit.core.text import join_words
from toolkit.models.architectures import published_weights
from toolkit.models.labels import LabelsFile, find_labels

FOLDER_VARIABLE = "TOOLKIT_WEIGHTS"
SUFFIXES = (".pth", ".pt", ".ckpt", ".safetensors")
NAMED_SUFFIXES = (*SUFFIXES, ".tar", ".bin")
"""Suffixes of files that somebody names: `model_best.pth.tar` and `pytorch_model.bin` as well."""
DOWNLOAD_TIMEOUT_S, HUB_TIMEOUT_S = 15.0, 10.0


@dataclass(frozen=True)
class WeightsFile:
    """The file of a network's weights.

    Attributes:
        path: the file.
        sha256: of the file, 64 hex digits.
        name: its name in reports: the file's name.
    """

    path: Path
    sha256: str
    name: str


def find_weights(arch: str, weights: Path | None = None) -> WeightsFile:
    """Find the weights of a network: `weights`, else TOOLKIT_WEIGHTS, else torch's cache, else torchvision's download.

    Raises:
        ToolkitError: the named file is missing or of another kind, or none of the four ways has weights for `arch`.
    """
    url = published_weights(arch).url
    named = None if weights is None else check_named(Path(weights))
    found = named or find_local(arch)
    if found is None and url is None:
        raise no_weights(arch, arch, f"train it with 'toolkit train-classifier --arch {arch}': none are published")
    return open_weights(found or download(arch, str(url)))


def open_weights(path: Path, name: str = "") -> WeightsFile:
    """A file with its hash, called `name` in a report, by default as the file is.

    Raises:
        ToolkitError: it cannot be read.
    """
    try:
        return WeightsFile(path, sha256_file(path), name or path.name)
    except OSError as error:
        raise ToolkitError(f"cannot read weights {path}: {error.strerror}") from None


def find_local(arch: str, url: str | None = None) -> Path | None:
    """Return the weights file on this machine: in TOOLKIT_WEIGHTS, else the published file in torch's cache."""
    url = url or published_weights(arch).url
    published = url.rsplit("/", 1)[-1] if url else ""
    if (found := find_in_folder(arch, published)) is not None or not url:
        return found
    cached = cache_dir() / published
    return cached if cached.is_file() else None


def find_in_folder(arch: str, preferred: str = "") -> Path | None:
    """Return a network's file in the folder TOOLKIT_WEIGHTS: `preferred`, else `arch-*`, else `arch`."""
    found = list_in_folder(arch)
    # the published file first: the others may be of other classes
    return next((path for path in found if path.name == preferred), found[0] if found else None)


def list_in_folder(arch: str) -> list[Path]:
    """List a network's files in the folder TOOLKIT_WEIGHTS: those called `arch-*` first."""
    folder = weights_folder()
    if folder is None:
        return []
    names = [f"{arch}{middle}{suffix}" for suffix in SUFFIXES for middle in ("-*", "")]
    return [path for name in names for path in sorted(folder.glob(name)) if path.is_file()]


def weights_folder() -> Path | None:
    """Return the folder TOOLKIT_WEIGHTS, if it is set."""
    folder = os.environ.get(FOLDER_VARIABLE)
    return Path(folder) if folder else None


def cache_dir() -> Path:
    """Return torch's folder of downloads, without loading torch for it."""
    if "torch" in sys.modules:
        return Path(sys.modules["torch"].hub.get_dir()) / "checkpoints"
    # as `torch.hub.get_dir` finds it in a new process
    home = os.environ.get("TORCH_HOME") or f"{os.environ.get('XDG_CACHE_HOME') or '~/.cache'}/torch"
    return Path(home).expanduser() / "hub" / "checkpoints"


RENEW = "download the file again, or save it again with torch.save(model.state_dict(), FILE)"


def read_state_dict(file: WeightsFile) -> "OrderedDict[str, torch.Tensor]":
    """Parameters by name; see `read_checkpoint`."""
    return read_checkpoint(file)[0]


def read_checkpoint(file: WeightsFile) -> "tuple[OrderedDict[str, torch.Tensor], LabelsFile]":
    """Read parameters by name, and labels and normalisation beside them; nothing in the file is executed.

    Checkpoints that hold the state dict under a name are unwrapped, see `_take_state`. Prefixes of DataParallel,
    torch.compile and FSDP are removed from names; for others see `unwrap_names`. From a checkpoint of MadryLab's
    robustness library, only the classifier is taken, with its mean and standard deviation.

    Raises:
        ToolkitError: the file is broken, holds code, or holds no state dict.
    """
    # labels are looked for before the parameters are taken out: checkpoints hold them side by side
    state = _load(file.path)
    labels = find_labels(state)
    state = _take_state(state, file.path)
    if state is None:
        raise ToolkitError(
            f"{file.path} holds no state dict of plain real numbers by name: save it with "
            "torch.save(model.state_dict(), FILE)"
        )
    size = file.path.stat().st_size
    # a tensor may state a shape far beyond its bytes, and would fill memory
    for name, value in state.items():
        if value.nbytes > size:  # a single number that stands for many
            shape = "×".join(map(str, value.shape))
            raise ToolkitError(f"{file.path}: '{name}' is {shape}, which a file of {size} bytes cannot hold: {RENEW}")
    network, normalisation = _take_from_attacker(_rename(state, _modern_name), file.path)
    try:
        return network, LabelsFile(labels=labels, **normalisation)
    except ValidationError as error:
        raise ToolkitError(f"{file.path}: beside the weights: {explain_validation(error)}") from None


WRAPPERS = ("state_dict", "model", "model_state_dict", "model_state", "network", "net", "module")
"""Keys of the network in training programs' checkpoints, the usual names first."""


def _take_state(content: object, path: Path) -> "dict[str, torch.Tensor] | None":
    """Find the state dict in a checkpoint; None without any.

    It is the whole, or under a key of `WRAPPERS`, or the only state dict, such as an EMA. A note names the others.

    Raises:
        ToolkitError: there are several, none of them under a usual name.
    """
    if not isinstance(content, dict) or not content:
        return None
    # the whole is a state dict, or holds one
    if all(_is_parameter(*item) for item in content.items()):
        return content
    # an optimiser numbers what it keeps of each parameter: those are no networks
    named_items = [(key, value) for key, value in content.items() if isinstance(key, str)]
    found = {key: state for key, value in named_items if (state := _take_state(value, path)) is not None}
    # a checkpoint may hold an average beside the network: the usual name wins
    usual = [key for key in WRAPPERS if key in found]
    if not found:
        return None
    if not usual and len(found) > 1:
        named = join_words(f"'{key[:60]}'" for key in list(found)[:4])
        raise ToolkitError(
            f"{path} holds {len(found)} state dicts, {named}: save the network's with "
            "torch.save(checkpoint[NAME], FILE)"
        )
    taken = usual[0] if usual else next(iter(found))
    others = [f"'{key[:60]}'" for key in found if key != taken]
    if others:
        notice_once(f"note: {path}: '{taken}' is read, {', '.join(others[:4])} left out")
    return found[taken]


NORMALISERS = ("normalizer.", "attacker.normalize.")
"""Prefixes of mean and deviation in robustness's AttackerModel: its own, and the attacker's."""
CLASSIFIERS = ("model.model.", "model.", "attacker.model.model.", "attacker.model.")
"""Prefixes of the classifier there: as it is, or in a DummyModel, which holds torchvision's networks but ResNets."""


def _take_from_attacker(
    state: "OrderedDict[str, torch.Tensor]", path: Path
) -> "tuple[OrderedDict[str, torch.Tensor], dict[str, tuple[float, ...]]]":
    """Take the classifier of an AttackerModel, with `mean` and `std` of its images; others stay as they are."""
    normaliser = next((name for name in NORMALISERS if f"{name}new_mean" in state), None)
    if normaliser is None:
        return state, {}
    # the longest prefix that is there
    prefix = next((prefix for prefix in CLASSIFIERS if any(name.startswith(prefix) for name in state)), "model.")
    found: dict[str, tuple[float, ...]] = {}
    for field, least in (("mean", -1000.0), ("std", 1e-6)):
        value = state.get(f"{normaliser}new_{field}")
        # the shortest decimals that are the same single-precision numbers: 0.485 and not 0.48500001
        numbers = () if value is None else tuple(float(str(part)) for part in value.detach().float().flatten().numpy())
        if len(numbers) != 3 or not all(math.isfinite(number) and least <= number <= 1000 for number in numbers):
            raise ToolkitError(f"{path}: '{normaliser}new_{field}': expected a number for each of three colours")
        found[field] = numbers
    return _rename(state, lambda name: name[len(prefix) :] if name.startswith(prefix) else None), found


def _rename(state: "dict[str, torch.Tensor]", rename: Callable[[str], str | None]) -> "OrderedDict[str, torch.Tensor]":
    """Rename the entries of a state dict, and drop those without a new name."""
    renamed = OrderedDict((new, value) for name, value in state.items() if (new := rename(name)) is not None)
    # torch keeps its modules' versions here, and some networks load older files another way
    versions = getattr(state, "_metadata", None)
    renamed._metadata = OrderedDict(  # type: ignore[attr-defined]
        (new.rstrip("."), value)
        for name, value in (versions.items() if isinstance(versions, dict) else ())
        if isinstance(value, dict) and (new := rename(f"{name}.")) is not None
    )
    return renamed


def _is_parameter(name: object, value: object) -> bool:
    """Whether this is a name with numbers that a network can take: real, dense, not quantised, in memory."""
    return (
        isinstance(name, str) and isinstance(value, torch.Tensor) and value.layout == torch.strided
        and not value.is_quantized and value.device.type == "cpu" and not value.is_complex()
    )  # fmt: skip


def _modern_name(name: str) -> str | None:
    if name == "n_averaged":
        return None  # AveragedModel's counter
    # torchvision's published DenseNets still have the names of torch 0.3, which its own loader renames like this
    old = re.match(r"^(.*denselayer\d+\.(?:norm|conv))\.([12]\..+)$", name)
    plain = old[1] + old[2] if old else name
    for wrapper in WRAPPED_PARTS:
        plain = plain.replace(wrapper, "")
    return plain.removeprefix("module.")


WRAPPED_PARTS = ("_orig_mod.", "_fsdp_wrapped_module.", "_checkpoint_wrapped_module.", "_forward_module.")
"""Prefixes by torch.compile, FSDP, activation checkpointing and Lightning on the names of a network or its parts."""


def unwrap_names(
    state: "OrderedDict[str, torch.Tensor]", expected: "Iterable[str]", path: Path
) -> "OrderedDict[str, torch.Tensor]":
    """Return the parameters that a network expects, without a training program's prefix, such as Lightning's `model.`.

    Args:
        state: parameters by name.
        expected: the network's own names.
        path: path of the file, for messages.

    Raises:
        ToolkitError: the file holds several such networks; the message names their prefixes.
    """
    # the names end alike if only a prefix differs: the last name shows the possible prefixes
    wanted = [name for name in expected if not name.endswith("num_batches_tracked")]
    if not wanted:
        return state
    ends = {name[: -len(wanted[-1])] for name in state if name.endswith(wanted[-1])}
    # `fc.weight` also ends another layer's `other_fc.weight`
    prefixes = [end for end in sorted(ends) if not end or end.endswith(".")]
    found = [prefix for prefix in prefixes if all(f"{prefix}{name}" in state for name in wanted)]
    if "" in found or not found:
        return state
    if len(found) > 1:
        named = join_words(f"'{prefix}'" for prefix in found)
        raise ToolkitError(
            f"{path} holds {len(found)} such networks, whose names begin with {named}: save the right network with "
            "torch.save(network.state_dict(), FILE)"
        )
    return _rename(state, lambda name: name[len(found[0]) :] if name.startswith(found[0]) else None)


def name_prefix(state: "Iterable[str]") -> str:
    """Return the common prefix of all names as a remark for a message; empty without any."""
    first, *others = {name.partition(".")[0] for name in state} or {""}
    return "" if others or not first else f" (all its names begin with '{first}.')"


def _load(path: Path) -> object:
    import pickle

    from safetensors import SafetensorError
    from safetensors.torch import load_file

    program = find_program(path)
    if program:
        raise FieldError(f"{path} is {program}: expected a network's weights: where you made it, {SAVE_STATE}", {})
    try:
        if path.suffix.lower() == ".safetensors":
            return load_file(path)
        with contextlib.suppress(BadZipFile), ZipFile(path) as archive:  # torch's older format is none
            if is_inflated(path, archive):
                why = "its parts are compressed, which torch never does"
                raise FieldError(f"{path}: {why}: where you made it, {SAVE_STATE}", {})
        # a damaged file may ask for more memory than its bytes need
        with limit_memory(LOADING_BYTES + 3 * path.stat().st_size):
            return torch.load(path, map_location="cpu", weights_only=True)
    except ToolkitError:
        raise
    except pickle.UnpicklingError as error:
        # the message names what would have been run, and how to save without it
        named = re.search(r"GLOBAL ([\w.]+)", str(error))
        if named is None and "truncated" in str(error):
            raise _damaged(path, "it ends too early") from None
        holds = f"a pickled module or other objects ({named[1]})" if named else "more than numbers, or is damaged,"
        advice = SAVE_NUMBERS if named is not None and named[1].startswith(FOREIGN) else SAVE_STATE
        why = f"{path} holds {holds} and is not loaded for safety, as loading would run its code: where it was made, "
        raise FieldError(f"{why}{advice}", {}) from None
    except SafetensorError as error:
        raise _damaged(path, str(error).strip().splitlines()[0]) from None
    except Exception as error:  # an unpickler raises anything at a damaged file, and torch advises to run it
        what = error.strerror if isinstance(error, OSError) else None
        if is_memory_full(error):
            what = "it asks for more memory than its bytes need"
        raise _damaged(path, what or "torch cannot read it") from None


def _damaged(path: Path, what: str) -> ToolkitError:
    return ToolkitError(f"cannot read weights {path}: the file is damaged ({what}): copy it again")


def is_inflated(path: Path, archive: ZipFile) -> bool:
    """Whether what an archive holds is larger than its file: torch compresses nothing, and bombs hold 1000 times it."""
    return sum(member.file_size for member in archive.infolist()) > path.stat().st_size


LOADING_BYTES, TRYING_BYTES = 1 << 30, 2 << 30
"""Memory for reading weights, beside some copies of them, and for another person's program with two images."""
WHOLE = (".onnx", ".pt2")
"""Programs that can be named as networks themselves."""
SAVE_STATE = "save its state dict with torch.save(model.state_dict(), 'NEW.pth'), and name its network with {model}"
FOREIGN = ("dill.", "robustness.", "cox.", "numpy.")
"""Modules of objects in checkpoints of MadryLab's robustness library: functions, settings, learning rates."""
SAVE_NUMBERS = (
    "save its numbers alone with safetensors.torch.save_file({name: value.clone() for name, value in "
    "checkpoint['model'].items()}, 'NEW.safetensors'), and load that file"
)
PROGRAMS = {
    ".onnx": "an ONNX graph", ".pt2": "a program of torch.export", ".ptl": "a program for PyTorch Mobile",
    ".h5": "a Keras model", ".keras": "a Keras model", ".tflite": "a TensorFlow Lite model",
    ".engine": "a TensorRT plan",
}  # fmt: skip


def find_program(path: Path) -> str | None:
    """Name the kind of a file that is a whole program and no state dict, such as `a TorchScript archive`; else None."""
    if path.suffix.lower() in PROGRAMS:
        return PROGRAMS[path.suffix.lower()]
    try:
        with ZipFile(path) as archive:
            names = {name.partition("/")[2] for name in archive.namelist()}
    except (BadZipFile, OSError):
        return None
    if "constants.pkl" in names or any(name.startswith("code/") for name in names):
        return "a TorchScript archive"
    is_exported = any(name.startswith(("models/", "serialized_exported_program")) for name in names)
    return PROGRAMS[".pt2"] if is_exported else None


def check_named(path: Path) -> Path:
    """Return the path if it is a file of a kind that can be read; else raise a `ToolkitError`."""
    if not path.is_file():
        raise FieldError("no such file", {"weights": path})
    if path.suffix.lower() in NAMED_SUFFIXES:
        return path
    # the message says how to use a file that is of another kind
    kinds, program = ", ".join(SUFFIXES), find_program(path)
    if not program:
        raise FieldError(f"expected a state dict that ends in {kinds}", {"weights": path})
    way = f"where you made it, {SAVE_STATE}"
    if path.suffix.lower() in WHOLE:
        named = f"onnx:{path.name}" if path.suffix.lower() == ".onnx" else path.name
        way = f"name it whole with {{model}} {named}; or {SAVE_STATE}"
    raise FieldError(f"is {program}: expected a network's weights ({kinds}): {way}", {"weights": path})


def find_commit(repo: str, filename: str, revision: str | None) -> str:
    """Return the commit of a file of the Hugging Face hub; asks once, as a download would retry for half a minute."""
    from huggingface_hub import get_hf_file_metadata, hf_hub_url

    url = hf_hub_url(repo, filename, revision=revision)
    return str(get_hf_file_metadata(url, timeout=HUB_TIMEOUT_S).commit_hash)


def download(arch: str, url: str, timeout_s: float = DOWNLOAD_TIMEOUT_S) -> Path:
    """Download a published file into torch's cache, checked against the hash in its name; else a `ToolkitError`."""
    from http.client import HTTPException

    name = url.rsplit("/", 1)[-1]
    # published names end in the first digits of their hash
    target = cache_dir() / name
    digits = re.search(r"-([0-9a-f]{8,})\.", name)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with socket_timeout(timeout_s):
            torch.hub.download_url_to_file(url, str(target), digits[1] if digits else None, progress=not is_quiet())
    except (OSError, HTTPException, RuntimeError) as error:
        reason = str(getattr(error, "reason", "") or error).strip() or error.__class__.__name__
        others = f"put {name} into torch's cache {cache_dir()}, or let it download from {url} (failed: {reason})"
        raise no_weights(arch, arch, others) from None
    return target


def no_weights(model: str, file_stem: str, others: str) -> ToolkitError:
    """Return the error of a network without weights: the ways that every network has, then its `others`."""
    folder = weights_folder()
    looked = f"{folder} has none" if folder else "not set"
    return FieldError(
        f"no weights for {model}: give a file with {{weights}}, or set {FOLDER_VARIABLE} to a folder that holds "
        f"{file_stem}-*.pth or .safetensors ({looked}), or {others}",
        {},
    )


@contextlib.contextmanager
def socket_timeout(seconds: float) -> Iterator[None]:
    """No connection made inside waits longer for an answer."""
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(seconds)
    try:
        yield
    finally:
        socket.setdefaulttimeout(before)
