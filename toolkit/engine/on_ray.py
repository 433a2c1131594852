"""Units on a Ray cluster: plain tasks, inputs and results through the object store, no shared file system.

The driver alone writes. Ray starts a task again where its node or its worker died; what the work itself raises comes
back as a reason. The kit travels with the tasks, so that the nodes need Python, Ray and the libraries alone.
"""

import os
import pickle
import re
import socket
import tempfile
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from importlib.metadata import distributions, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic

from toolkit.core.child import limit_cores
from toolkit.core.errors import ToolkitError
from toolkit.engine.units import KILLED, Outcome, Result, Unit, Value, do_work, explain_failure, run_ahead

if TYPE_CHECKING:
    import ray

RETRIES = 3
"""How often Ray does a unit again whose worker or node died."""
ANSWER_S = 5.0
"""How long a cluster may take to answer at its address."""
HTTP2_SETTINGS = b"\x04"
HTTP2_PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0" + HTTP2_SETTINGS + b"\0\0\0\0\0"
KEPT = 8
"""Shared values that a worker keeps, such as networks on their device."""
LIBRARIES = ("numpy", "torch", "torchvision", "open3d", "numba", "opencv-python-headless", "scipy", "pillow")
"""Packages whose version changes results: every node needs the same version."""
_kept: "OrderedDict[str, Any]" = OrderedDict()


class InStore(Generic[Value]):
    """A shared value in Ray's object store; each worker reads it once and keeps it.

    It lies there pickled whole: arrays that Ray takes apart come back read-only, another type to compiled code.
    """

    def __init__(self, reference: "ray.ObjectRef[bytes]") -> None:
        self._reference = reference

    def get(self) -> Value:
        """The value."""
        import ray

        name = self._reference.hex()
        if name not in _kept:
            _kept[name] = pickle.loads(ray.get(self._reference))  # put there by this engine's own driver
            while len(_kept) > KEPT:
                _kept.popitem(last=False)
        _kept.move_to_end(name)
        value: Value = _kept[name]
        return value


class RayEngine:
    """A Ray cluster: a running cluster, or a cluster that is started on this machine and ends with the engine."""

    def __init__(self, address: str | None = None, workers: int | None = None, gpus: int = 0) -> None:
        """Not connected yet.

        Args:
            address: `HOST:PORT` of a cluster's head, `ray://HOST:PORT`, or `auto` for the cluster on this machine; None
                starts a cluster here.
            workers: units that run at once; by default as many as the cluster has cores, or GPUs if they need a GPU.
            gpus: that each unit needs.

        Raises:
            ToolkitError: Ray is not installed.
        """
        try:
            import ray  # noqa: F401
        except ImportError:
            raise ToolkitError("Ray is not installed: pip install '.[ray]' in the kit's folder") from None
        self.address, self.workers, self.gpus = address, workers, gpus
        self._task: Any = None
        self._is_mine = False

    def __enter__(self) -> "RayEngine":
        """Connect, or start.

        Raises:
            ToolkitError: nobody answers at the address, or who answers is no Ray of this version.
        """
        import ray

        if not ray.is_initialized():
            self._start()
        self._task = ray.remote(max_retries=RETRIES, num_cpus=1, num_gpus=self.gpus)(_do_on_node)
        if self.workers is None:
            found = ray.cluster_resources()
            self.workers = max(1, int(found.get("GPU", 0) // self.gpus if self.gpus else found.get("CPU", 1)))
        return self

    def _start(self) -> None:
        import ray

        _check_answer(self.address)
        os.environ.setdefault("RAY_task_oom_retries", str(RETRIES))  # else a unit too large is tried for ever
        kit = Path(__file__).parents[1]
        nothing = tempfile.mkdtemp(prefix="toolkit-engine-")  # else workers import from the current folder first of all
        settings: dict[str, Any] = {
            "runtime_env": {"py_modules": [str(kit)], "working_dir": nothing, "excludes": ["**/__pycache__/**"]},
            "log_to_driver": False, "logging_level": "ERROR",
        }  # fmt: skip
        if self.address is None:
            settings |= {"include_dashboard": False, "num_cpus": self.workers, "_node_ip_address": "127.0.0.1"}
        try:
            ray.init(self.address, **settings)
        except (ConnectionError, RuntimeError, ValueError) as error:
            where = f"at {self.address}" if self.address else "on this machine"
            raise ToolkitError(explain_start(where, error)) from None
        finally:
            Path(nothing).rmdir()  # Ray has sent it
        self._is_mine = True

    def share(self, value: Value) -> InStore[Value]:
        """Put a value into the object store.

        Raises:
            ToolkitError: it cannot be sent to another process.
        """
        import ray

        try:
            return InStore(ray.put(ray.cloudpickle.dumps(value)))
        except (TypeError, pickle.PicklingError) as error:
            raise ToolkitError(f"{type(value).__name__} cannot be sent to another process ({error})") from None

    def run(self, units: Iterable[Unit[Result]]) -> Iterator[Outcome[Result]]:
        """See `run_ahead`; the results of units that are not asked for yet wait in the store.

        Raises:
            ToolkitError: a node has other libraries, which would give other results.
        """
        return run_ahead(units, self.workers or 1, self._submit, self._wait)

    def _wait(self, unit: Unit[Result], reference: Any, waiting: object) -> tuple[list[Result], str]:
        import ray

        ray.wait([reference])
        try:
            # a unit that runs out of memory or kills its worker fails alone
            results, reason, is_fit = ray.get(reference)
        except ray.exceptions.OutOfMemoryError:
            return [], "its node's memory is full"
        except ray.exceptions.WorkerCrashedError:
            return [], KILLED
        except Exception as error:
            return [], explain_failure(error)
        # other libraries would fail every unit of that node: stop the run
        if not is_fit:
            raise ToolkitError(reason)
        return results, reason

    def _submit(self, unit: Unit[Result]) -> "ray.ObjectRef[Done]":
        import ray

        # shared values are in the object store already; the rest is sent with the unit
        shared = {at: value for at, value in enumerate(unit.inputs) if isinstance(value, InStore)}
        own = tuple(None if at in shared else value for at, value in enumerate(unit.inputs))
        try:
            pickled = ray.cloudpickle.dumps((unit.work, own))
        except (TypeError, pickle.PicklingError) as error:
            return ray.put(([], explain_failure(error), True))
        reference: ray.ObjectRef[Done] = self._task.remote(pickled, shared, list_versions())
        return reference

    def __exit__(self, *error: object) -> None:
        """Leave the cluster; a cluster that was started here ends."""
        import ray

        if self._is_mine:
            ray.shutdown()
            self._is_mine = False


def _check_answer(address: str | None) -> None:
    """Find out in seconds what Ray itself takes a minute to say.

    Raises:
        ToolkitError: the address has no port, or nobody answers there.
    """
    if address in (None, "auto", "local"):
        return
    host, _, port = str(address).removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ToolkitError(f"Ray's address '{address}': expected HOST:PORT, such as 10.0.0.1:6379, or auto")
    try:
        with socket.create_connection((host, int(port)), ANSWER_S) as line:
            is_grpc = os.environ.get("RAY_USE_TLS", "0") != "0" or _speaks_http2(line)
    except OSError as error:
        raise ToolkitError(
            f"no Ray answers at the address {address} ({error.strerror or error}): start it with 'ray start --head', "
            "and open its port"
        ) from None
    if not is_grpc:
        raise ToolkitError(
            f"the program at {address} is not Ray: expected the port that 'ray start --head' names, by default 6379"
        )


def _speaks_http2(line: socket.socket) -> bool:
    """Whether a server opens with a frame of settings, as gRPC's do (RFC 9113, section 3.4)."""
    line.sendall(HTTP2_PREFACE)
    start = b""
    try:
        while len(start) < 4 and (more := line.recv(9)):
            start += more
    except TimeoutError:
        pass
    return start[3:4] == HTTP2_SETTINGS


def explain_start(where: str, error: Exception) -> str:
    """Return in a line why Ray could not be reached or started."""
    said = " ".join(str(error).split())
    found = re.findall(r"Ray: (\S+) Python: (\S+)", said)
    if len(found) == 2:
        there, here = (f"Ray {version} on Python {python}" for version, python in found)
        return f"the cluster {where} is {there}, here is {here}: install the same on all nodes and here"
    return f"Ray {where} cannot be used: {said[:300]}"


Done = tuple[list[Any], str, bool]
"""Results of a unit, the reason where it failed, and whether its node is fit for the work."""


@lru_cache(maxsize=1)
def list_versions() -> dict[str, str]:
    """Versions of the libraries here that results depend on."""
    return {name: version(name) if any(distributions(name=name)) else "none" for name in LIBRARIES}


def find_difference(wanted: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Return how a node's libraries differ from the driver's, in words; empty if they are the same."""
    return ", ".join(f"{name} {here[name]} for {version}" for name, version in wanted.items() if here[name] != version)


def _do_on_node(pickled: bytes, shared: dict[int, InStore[Any]], versions: dict[str, str]) -> Done:
    import ray

    # a task has a single core; otherwise each would start threads for all
    limit_cores(1)
    difference = find_difference(versions, list_versions())
    if difference:
        node = ray.util.get_node_ip_address()
        return [], f"the node {node} has other libraries than there are here: {difference}: install the same", False
    return *do_work(_unpack_work, (pickled, shared)), True


def _unpack_work(pickled: bytes, shared: dict[int, InStore[Any]]) -> Iterable[Any]:
    """Do the work; unpacking it fails as the work does, such as for a module that the node does not have."""
    work, inputs = pickle.loads(pickled)
    return work(*(shared.get(at, value) for at, value in enumerate(inputs)))
