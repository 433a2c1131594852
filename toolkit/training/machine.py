"""Checks of everything that the kit needs from a machine, each with the line that fixes it."""

import os
import platform
import shutil
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from packaging.requirements import Requirement

from toolkit.core.child import run_python
from toolkit.core.errors import ToolkitError
from toolkit.rig.graphics import APT, find_graphics
from toolkit.rig.renderers import RENDERERS

NEEDED_DISK_MB = 500


@dataclass(frozen=True)
class Check:
    """One finding.

    Attributes:
        name: what was looked at.
        state: `ok`, `missing` (a command will fail) or `note` (optional).
        found: what is there.
        fix: the line that fixes it, empty where nothing is to do.
    """

    name: str
    state: str
    found: str
    fix: str = ""


def check_machine(folder: Path | None = None) -> list[Check]:
    """Check everything that the kit needs from this machine.

    Args:
        folder: where a workspace is or would be, for its free disk space; by default the current folder.
    """
    where = Path.cwd() if folder is None else folder
    looks: list[Callable[[], Check | None]] = [
        _python, _packages, _open3d, _renderer, *(partial(_other_renderer, name) for name in RENDERERS),
        partial(_disk, where), _weights, _bundled, _gpu,
    ]  # fmt: skip
    # most of the time goes to separate processes, which run beside each other
    with ThreadPoolExecutor() as pool:
        found = list(pool.map(lambda look: look(), looks))
    return [check for check in found if check is not None]


def _python() -> Check:
    found = platform.python_version()
    if (3, 10) <= sys.version_info[:2] <= (3, 14):
        return Check("Python", "ok", found)
    return Check("Python", "missing", found, "make a virtual environment with a Python from 3.10 to 3.14")


def _packages() -> Check:
    try:
        wanted = requires("toolkit-boost") or []
    except PackageNotFoundError:
        return Check("packages", "missing", "toolkit-boost is not installed", "pip install -e .")
    # every requirement of the installed package that applies to this Python
    missing = []
    for requirement in map(Requirement, wanted):
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue  # extras, and what other Pythons need
        try:
            version(requirement.name)
        except PackageNotFoundError:
            missing.append(f"{requirement.name}{requirement.specifier}")
    if missing:
        fix = f"pip install {' '.join(map(repr, missing))}"
        return Check("packages", "missing", f"{len(missing)} not installed", fix)
    return Check("packages", "ok", f"torch {version('torch')}, torchvision {version('torchvision')}")


def _open3d() -> Check:
    """In a separate process, as a missing shared library may end it."""
    done = run_python("from toolkit.objects.mesh import load_open3d; print(load_open3d().__version__)")
    if done.returncode == 0:
        return Check("Open3D", "ok", done.stdout.decode().split()[-1])
    reason = (done.stderr.decode("utf-8", "replace").strip().splitlines() or [f"ended with code {done.returncode}"])[-1]
    return Check("Open3D", "missing", reason[:120], f"{APT} {find_graphics().packages}")


def _renderer() -> Check:
    """Whether the renderer's machine code is kept, and where."""
    # the cache of compiled code, and why it may not be used
    try:
        from toolkit.rig.kernel.compiled import cache_folder, find_refusal, is_compiled
    except ImportError as error:
        return Check("renderer", "missing", str(error).splitlines()[0][:120], "pip install 'numba>=0.61,<0.70'")
    folder, refused = cache_folder(), find_refusal()
    if folder is None or refused:
        why = f"its cache is not used, as {refused}" if refused else "no folder to keep it in"
        fix = "export TOOLKIT_CACHE=FOLDER, one of your own that can be written to"
        return Check("renderer", "note", f"compiled at each start, some seconds: {why}", fix)
    if is_compiled():
        return Check("renderer", "ok", f"compiled, in {folder}")
    return Check("renderer", "note", f"not compiled yet; the first picture does it, some seconds, into {folder}")


def _other_renderer(name: str) -> Check | None:
    """Whether a renderer can start; None if it needs nothing of the machine."""
    kind = RENDERERS[name]
    if kind.need is None:
        return None
    if trouble := kind.find_trouble():
        return Check(kind.need, "note", f"{trouble}; only --renderer {name} needs it", kind.fix)
    library, faster = kind.describe()
    slow = "; another variant would be faster" if faster else ""
    return Check(kind.need, "ok", (kind.working or library) + slow, faster)


def _disk(folder: Path) -> Check:
    # a workspace that is not made yet is asked by the nearest folder that is there
    there = next(path for path in (folder, *folder.parents) if path.exists())
    free_mb = shutil.disk_usage(there).free // 2**20
    found = f"{free_mb / 1024:.1f} GB free"
    if free_mb >= NEEDED_DISK_MB:
        return Check("disk", "ok", found)
    return Check("disk", "missing", found, f"free {NEEDED_DISK_MB} MB: 144 images and a report take about 40")


def _weights() -> Check:
    from toolkit.models.weights import FOLDER_VARIABLE, find_local, list_in_folder

    # a single file needs no look at its name
    there = list_in_folder("resnet18")
    try:
        # what is published under which name only torchvision knows, which takes seconds to load
        found = there[0] if len(there) == 1 else find_local("resnet18")
    except ToolkitError as error:
        return Check("ResNet-18 weights", "missing", str(error), "fix or unset TOOLKIT_WEIGHTS")
    if found is not None:
        return Check("ResNet-18 weights", "ok", str(found))
    folder = os.environ.get(FOLDER_VARIABLE, "")
    if folder and not Path(folder).is_dir():
        why = f"{FOLDER_VARIABLE} is {folder}, which is no folder"
        return Check("ResNet-18 weights", "missing", why, f"fix or unset {FOLDER_VARIABLE}")
    fix = "export TOOLKIT_WEIGHTS=FOLDER, with resnet18-*.pth in it; or let 'toolkit eval' download them once"
    return Check("ResNet-18 weights", "note", "not on this machine yet", fix)


def _bundled() -> Check:
    """The classifier that needs no network: whether it is here and whole."""
    from toolkit.models.load import read_bundled

    try:
        record = read_bundled()
    except ToolkitError as error:
        return Check("bundled classifier", "missing", str(error), "install the package again")
    if record is None:
        fix = "install the package again; --model works with weights of one's own all the same"
        return Check("bundled classifier", "note", "not in this installation", fix)
    share = record.held_out.accuracy
    known = "" if share is None else f", {share:.0%} of {record.held_out.n} held-out images correct"
    found = f"{record.name}, {record.arch} trained on {record.trained_on}, not ImageNet{known}"
    return Check("bundled classifier", "ok", found)


def _gpu() -> Check:
    # torch takes seconds to load, and finds none where Linux shows no device: NVIDIA's, AMD's or that of WSL
    devices = ("/dev/nvidiactl", "/dev/kfd", "/dev/dxg")
    if sys.platform != "linux" or any(map(os.path.exists, devices)):
        import torch

        if torch.cuda.is_available():
            return Check("GPU", "ok", torch.cuda.get_device_name(0))
    return Check("GPU", "note", "none; everything works on the CPU, training takes minutes")
