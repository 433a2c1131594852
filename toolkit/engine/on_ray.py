"""Units on a Ray cluster: plain tasks, with inputs and results in the object store, without a shared file system.

Only the driver writes files. Ray repeats a task if its node or worker died; errors of the work return as a reason. The
package is sent with the tasks, so nodes need only Python, Ray and the libraries.
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
from toolkit.core.extras import import_package
from toolkit.engine.units import KILLED, Outcome, Result, Unit, Value, do_work, explain_failure, run_ahead

if TYPE_CHECKING:
    import ray

RETRIES = 3
"""Number of repeats of a unit whose worker or node died."""
ANSWER_S = 5.0
"""Seconds to wait for an answer of a cluster."""
HTTP2_SETTINGS = b"\x04"
HTTP2_PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0" + HTTP2_SETTINGS + b"\0\0\0\0\0"
KEPT = 8
"""Number of shared values that a worker keeps, such as networks on their device."""
LIBRARIES = ("numpy", "torch", "torchvision", "open3d", "numba", "opencv-python-headless", "scipy", "pillow")
"""Packages whose version changes results, which must be the same on every node."""
_kept: "OrderedDict[str, Any]" = OrderedDict()


class InStore(Generic[Value]):
    """A shared value in Ray's object store, which each worker reads once.

    It is pickled as a whole: Ray would return read-only arrays, another type for compiled code.
    """

    def __init__(self, reference: "ray.ObjectRef[bytes]") -> None:
        self._reference = reference

    def get(self) -> Value:
        """Return the value."""
        import ray

        name = self._reference.hex()
        if name not in _kept:
            _kept[name] = pickle.loads(ray.get(self._reference))  # from this engine's own driver
            while len(_kept) > KEPT:
                _kept.popitem(last=False)
        _kept.move_to_end(name)
        value: Value = _kept[name]
        return value


class RayEngine:
    """A running Ray cluster, or a cluster that is started on this machine and ends with the engine."""

    def __init__(self, address: str | None = None, workers: int | None = None, gpus: int = 0) -> None:
        """Prepare the engine, without a connection.

        Args:
            address: `HOST:PORT` of a cluster's head, `ray://HOST:PORT`, or `auto` for the cluster on this machine; None
                starts a cluster here.
            workers: parallel units; by default as many as the cluster has cores, or GPUs if units need a GPU.
            gpus: GPUs of each unit.

        Raises:
            ToolkitError: Ray is not installed.
        """
        import_package("ray", "ray", "the engine ray")
        self.address, self.workers, self.gpus = address, workers, gpus
        self._task: Any = None
        self._is_mine = False

    def __enter__(self) -> "RayEngine":
        """Connect or start a cluster; a `ToolkitError` if no Ray of this version answers at the address."""
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
        os.environ.setdefault("RAY_task_oom_retries", str(RETRIES))  # else a too large unit is tried for ever
        kit = Path(__file__).parents[1]
        nothing = tempfile.mkdtemp(prefix="toolkit-engine-")  # else workers import from the current folder
        settings: dict[str, Any] = {
            "runtime_env": {"py_modules": [str(kit)], "working_dir": nothing, "excludes": ["**/__pycache__/**"]},
            "log_to_driver": False, "logging_level": "ERROR",
        }  # fmt: skip
        # a cluster of its own, which other machines cannot reach
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
        """Put a value into the object store; a `ToolkitError` if it cannot be sent."""
        import ray

        try:
            return InStore(ray.put(ray.cloudpickle.dumps(value)))
        except (TypeError, pickle.PicklingError) as error:
            raise ToolkitError(f"{type(value).__name__} cannot be sent to another process ({error})") from None

    def run(self, units: Iterable[Unit[Result]]) -> Iterator[Outcome[Result]]:
        """See `run_ahead`; results wait in the store. A `ToolkitError` if a node has other libraries."""
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

        # shared values are in the object store; the other inputs are sent with the unit
        shared = {at: value for at, value in enumerate(unit.inputs) if isinstance(value, InStore)}
        own = tuple(None if at in shared else value for at, value in enumerate(unit.inputs))
        try:
            pickled = ray.cloudpickle.dumps((unit.work, own))
        except (TypeError, pickle.PicklingError) as error:
            return ray.put(([], explain_failure(error), True))
        reference: ray.ObjectRef[Done] = self._task.remote(pickled, shared, list_versions())
        return reference

    def __exit__(self, *error: object) -> None:
        """Leave the cluster, and end a cluster that was started here."""
        import ray

        if self._is_mine:
            ray.shutdown()
            self._is_mine = False


def _check_answer(address: str | None) -> None:
    """Raise a `ToolkitError` if no cluster answers at an address, within seconds; Ray itself would take a minute."""
    if address in (None, "auto", "local"):
        return
    host, _, port = str(address).removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ToolkitError(f"Ray's address '{address}': expected HOST:PORT, such as 10.0.0.1:6379, or auto")
    # a plain connection shows in seconds whether anything answers
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
    """Whether a server begins with a frame of settings, as gRPC does (RFC 9113, section 3.4)."""
    line.sendall(HTTP2_PREFACE)
    start = b""
    try:
        while len(start) < 4 and (more := line.recv(9)):
            start += more
    except TimeoutError:
        pass
    return start[3:4] == HTTP2_SETTINGS


def explain_start(where: str, error: Exception) -> str:
    """Return why Ray could not be reached or started, as a line."""
    said = " ".join(str(error).split())
    found = re.findall(r"Ray: (\S+) Python: (\S+)", said)
    if len(found) == 2:
        there, here = (f"Ray {version} on Python {python}" for version, python in found)
        return f"the cluster {where} is {there}, here is {here}: install the same on all nodes and here"
    return f"Ray {where} cannot be used: {said[:300]}"


Done = tuple[list[Any], str, bool]
"""Results of a unit, the reason if it failed, and whether its node has the right libraries."""


@lru_cache(maxsize=1)
def list_versions() -> dict[str, str]:
    """Return the versions of `LIBRARIES` here."""
    return {name: version(name) if any(distributions(name=name)) else "none" for name in LIBRARIES}


def find_difference(wanted: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Return how a node's libraries differ from the driver's, in words; empty if they do not."""
    return ", ".join(f"{name} {here[name]} for {version}" for name, version in wanted.items() if here[name] != version)


def _do_on_node(pickled: bytes, shared: dict[int, InStore[Any]], versions: dict[str, str]) -> Done:
    import ray

    # a task has a single core
    limit_cores(1)
    difference = find_difference(versions, list_versions())
    if difference:
        node = ray.util.get_node_ip_address()
        return [], f"the node {node} has other libraries than there are here: {difference}: install the same", False
    return *do_work(_unpack_work, (pickled, shared)), True


def _unpack_work(pickled: bytes, shared: dict[int, InStore[Any]]) -> Iterable[Any]:
    """Unpack and do the work; a module that the node lacks then fails like the work."""
    work, inputs = pickle.loads(pickled)
    return work(*(shared.get(at, value) for at, value in enumerate(inputs)))
