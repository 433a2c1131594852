"""Units on Ray: one node, three nodes, a node that dies. Asked for with TEST_RAY=1: Ray listens on all interfaces."""

import contextlib
import os
import pickle
import platform
import socket
import threading

import engine_work
import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.engine import EngineConfig, on_ray
from toolkit.engine.local import InProcess
from toolkit.engine.units import Unit

ray = pytest.importorskip("ray")
wanted = pytest.mark.skipif(not os.environ.get("TEST_RAY"), reason="starts Ray: TEST_RAY=1 asks for it")


def units_of(work, *each):
    return [Unit((at,), work, inputs, str(at)) for at, inputs in enumerate(each)]


class Opened:
    """A config of an engine that is open already, for who opens it."""

    def __init__(self, engine):
        self.engine = engine

    def open(self, gpus=0):
        return contextlib.nullcontext(self.engine)


@pytest.fixture
def cluster():
    """Three nodes of one core each."""
    from ray.cluster_utils import Cluster

    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    made.nodes = [made.add_node(num_cpus=1) for _ in range(2)]
    yield made
    ray.shutdown()
    made.shutdown()


@wanted
def test_one_node_gives_the_same_bytes_and_failures(shoot, ask, look, looked, train):
    (_, here), (_, said), trained = shoot("sim", InProcess()), ask("here", InProcess()), train("here")
    with EngineConfig(engine="ray", workers=2).open() as engine:
        (result, there), (_, said_there) = shoot("ray", engine), ask("ray", engine)
        found = [
            (int(one.unit.name), one.result, bool(one.reason))
            for one in engine.run(units_of(engine_work.fail_at, *((at, 1, KeyError("x")) for at in range(3))))
        ]
        dead = [
            (one.result, one.reason) for one in engine.run(units_of(engine_work.die, *((at, 1) for at in range(3))))
        ]
        assert look("one-node", Opened(engine))[1] == looked[1]
    assert train("ray", EngineConfig(engine="ray", workers=2)) == trained
    assert not ray.is_initialized()
    assert here == there and said == said_there and result.shot == 4
    assert found == [(0, 0, False), (1, None, True), (2, 2, False)]
    assert [result for result, _ in dead] == [0, None, 2] and "was killed" in dead[1][1]


@wanted
def test_workers_import_nothing_from_the_current_folder(tmp_path, monkeypatch):
    for name in ("toolkit", "numpy", "struct"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\n")
    monkeypatch.chdir(tmp_path)
    with EngineConfig(engine="ray", workers=1).open() as engine:
        assert [one.result for one in engine.run(units_of(engine_work.add, (1, 2)))] == [3]
    assert not (tmp_path / "ran").exists()


@wanted
def test_three_nodes_give_the_same_bytes_and_one_may_die(cluster, shoot, ask, look, looked):
    (_, here), (_, said) = shoot("sim", InProcess()), ask("here", InProcess())
    with EngineConfig(engine="ray", address=cluster.address).open() as engine:
        assert engine.workers == 3
        assert shoot("ray", engine)[1] == here and ask("ray", engine)[1] == said
        assert look("three-nodes", Opened(engine))[1] == looked[1]
        found = []
        for one in engine.run(units_of(engine_work.wait_and_add, *((0.5, at) for at in range(16)))):
            found.append((one.result, one.reason))
            if len(found) == 3:
                cluster.remove_node(cluster.nodes[0], allow_graceful=False)
    assert found == [(at, "") for at in range(16)]


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("127.0.0.1:1", "no Ray answers at the address 127.0.0.1:1"),
        ("nowhere", "expected HOST:PORT"),
        ("127.0.0.1:99999", "expected HOST:PORT"),
    ],
)
def test_an_address_where_nobody_answers_is_a_line(address, words):
    engine = EngineConfig(engine="ray", address=address).open()
    with pytest.raises(ToolkitError, match=words) as refused, engine:
        pass
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("said", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_an_address_of_something_else_is_a_line(said, monkeypatch):
    """One that says nothing is left after seconds; Ray itself would wait for minutes."""
    monkeypatch.setattr("toolkit.engine.on_ray.ANSWER_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def answer():
            line, _ = listener.accept()
            with line, contextlib.suppress(OSError):
                line.sendall(said)
                while line.recv(1 << 10):
                    pass

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        port = listener.getsockname()[1]
        engine = EngineConfig(engine="ray", address=f"127.0.0.1:{port}").open()
        with pytest.raises(ToolkitError, match=f"the program at 127.0.0.1:{port} is not Ray"), engine:
            pass
        thread.join(5)


def test_without_ray_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(ToolkitError, match=r"\.\[ray\]"):
        EngineConfig(engine="ray").open()


def test_another_version_of_ray_or_python_is_a_line():
    """As Ray itself says it, which takes six lines."""
    from ray._private.utils import check_version_info

    with pytest.raises(RuntimeError, match="Version mismatch") as said:
        check_version_info({"ray_version": "2.9.0", "python_version": "3.10.1"}, "node 10.0.0.5")
    line = on_ray.explain_start("at 10.0.0.1:6379", said.value)
    assert line.startswith("the cluster at 10.0.0.1:6379 is Ray 2.9.0 on Python 3.10.1, here is Ray ")
    assert f"{ray.__version__} on Python {platform.python_version()}: install the same" in line and "\n" not in line


def test_other_libraries_are_named():
    here = on_ray.list_versions()
    assert here["numpy"] == np.__version__ and on_ray.find_difference(here, here) == ""
    older = here | {"numpy": "1.0", "open3d": "none"}
    assert on_ray.find_difference(here, older) == f"numpy 1.0 for {np.__version__}, open3d none for {here['open3d']}"


@wanted
def test_a_node_with_other_libraries_ends_the_run(monkeypatch):
    monkeypatch.setattr(on_ray, "list_versions", lambda: {"numpy": "1.0"})
    with (
        EngineConfig(engine="ray", workers=1).open() as engine,
        pytest.raises(ToolkitError, match=f"has other libraries than there are here: numpy {np.__version__} for 1.0"),
    ):
        list(engine.run(units_of(engine_work.add, (1, 2))))


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (
            ray.exceptions.OutOfMemoryError("Task was killed due to the node running low on memory.\nMemory on"),
            "memory",
        ),
        (ray.exceptions.WorkerCrashedError(), "was killed"),
    ],
)
def test_a_node_without_memory_is_a_line_and_the_others_are_done(monkeypatch, error, words):
    """What the driver makes of Ray's answers; Ray itself tries the unit again before it gives them."""

    def get(answer):
        if isinstance(answer, Exception):
            raise answer
        return answer

    class Task:
        def remote(self, pickled, shared, versions):
            _, (number,) = pickle.loads(pickled)
            return error if number == 1 else ([number], "", True)

    monkeypatch.setattr(ray, "wait", lambda references: None)
    monkeypatch.setattr(ray, "get", get)
    engine = on_ray.RayEngine(workers=1)
    engine._task = Task()
    found = [(one.result, one.reason) for one in engine.run(units_of(engine_work.count_to, (0,), (1,), (2,)))]
    assert [result for result, _ in found] == [0, None, 2]
    assert words in found[1][1] and "\n" not in found[1][1] and not found[0][1]
