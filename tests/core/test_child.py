"""Processes that are started in a folder with files called like modules: none of them is imported."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import engine_work
import numpy as np
import pytest

import toolkit
from toolkit.core import child
from toolkit.core.child import LATE, count_cores, find_cpu_quota, limit_memory, run_python
from toolkit.engine.local import LocalPool
from toolkit.engine.units import Unit

PLANTED = ("numpy", "struct", "typing", "ctypes", "pickle", "signal", "threading", "open3d", "xatlas", "cv2", "toolkit")
MB = 1 << 20
CODE = "open({ran!r}, 'a').write('{name} ')\nraise ImportError('planted')\n"
POOL = """
import os
from toolkit.core.child import open_pool
with open_pool(1) as pool:
    print(pool.submit(os.getpid).result() != os.getpid())
"""


def plant(folder, names):
    """Lay out files in the current folder; returns a function -> which of them ran."""
    for name in names:
        (folder / f"{name}.py").write_text(CODE.format(ran=str(folder / "ran"), name=name))
    return lambda: (folder / "ran").read_text() if (folder / "ran").exists() else ""


@pytest.fixture
def planted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return plant(tmp_path, PLANTED)


def test_statements_and_what_they_read(planted):
    done = run_python("import sys, struct; sys.stdout.buffer.write(sys.stdin.buffer.read()); sys.exit(3)", b"\0\xff")
    assert (done.returncode, done.stdout, planted()) == (3, b"\0\xff", "")


def test_a_child_is_ended_when_its_time_is_over():
    assert run_python("while True: pass", most_s=1).returncode == LATE
    assert run_python("import time; time.sleep(99)", most_s=0.1).returncode == LATE


GROUPS = {
    "version 2": ("0::/app/web\n", {"app/cpu.max": "150000 100000\n", "app/web/cpu.max": "max 100000\n"}, 1.5),
    "a container": ("0::/docker/abc\n", {"cpu.max": "250000 100000\n"}, 2.5),
    "version 1": (
        "5:memory:/app\n4:cpu,cpuacct:/app\n",
        {
            "cpu,cpuacct/app/cpu.cfs_quota_us": "50000\n", "cpu,cpuacct/app/cpu.cfs_period_us": "100000\n",
            "memory/app/cpu.max": "1 100000\n",
        },
        0.5,
    ),
    "both": (
        "1:cpu:/\n0::/\n",
        {"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n", "unified/cpu.max": "300000 100000"}, 3.0,
    ),
    "no bound": ("0::/\n", {"cpu.max": "max 100000\n"}, float("inf")),
    "no groups": ("", {}, float("inf")),
}  # fmt: skip


@pytest.mark.parametrize(("lines", "files", "wanted"), GROUPS.values(), ids=GROUPS)
def test_the_cpu_quota_is_the_least_of_the_groups_around(lines, files, wanted, tmp_path):
    (tmp_path / "own").write_text(lines)
    for name, text in files.items():
        (tmp_path / "root" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "root" / name).write_text(text)
    assert find_cpu_quota(tmp_path / "own", tmp_path / "root") == wanted


@pytest.mark.parametrize(("quota", "cores"), [(float("inf"), 8), (9.5, 8), (2.5, 3), (0.2, 1)])
def test_cores_are_those_of_affinity_and_quota(quota, cores, monkeypatch):
    monkeypatch.setattr(child, "_limit", None)
    monkeypatch.setattr(child.os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(child, "find_cpu_quota", lambda: quota)
    assert count_cores() == cores


def test_nothing_else_counts_cores():
    """`os.cpu_count` knows neither of the two."""
    here = Path(toolkit.__file__).parent
    assert [file.name for file in here.rglob("*.py") if "cpu_count" in file.read_text()] == ["child.py"]


def test_a_pool_and_the_count_of_its_semaphores(planted):
    done = run_python(POOL)  # a process that has no such count yet
    assert (done.stdout.strip(), done.stderr, planted()) == (b"True", b"", "")


def test_units_find_the_modules_of_their_driver(planted):
    unit = Unit(("0" * 64,), engine_work.add, (1, 2), "a sum")
    with LocalPool(1) as pool:
        assert [(one.result, one.reason) for one in pool.run([unit])] == [(3, "")]
    assert planted() == ""


def test_renders_to_train_on(planted, tmp_path):
    from toolkit.training.renders import EVERYDAY, RenderUnit, render_shards

    unit = RenderUnit(EVERYDAY, "no such thing", (0, 0, 0, 0), 1, 16)
    with pytest.raises(Exception, match="no such thing"):  # the worker got as far as looking for it
        render_shards([unit], tmp_path, 1, lambda _: None)
    assert planted() == ""


def test_texture_coordinates(planted):
    from toolkit.objects.unwrap import pack_pieces

    points = np.array([[0, 0], [1, 0], [0, 1]], float)
    assert pack_pieces(points, np.array([[0, 1, 2]]), np.array([0]), 32).shape == (3, 2)
    assert planted() == ""


def test_graphics_are_tried(planted):
    from toolkit.rig.graphics import graphics_trouble

    graphics_trouble.cache_clear()
    graphics_trouble()
    assert planted() == ""


@pytest.mark.slow
def test_open3d_is_asked_for(planted):
    from toolkit.training.machine import _open3d

    assert _open3d().state == "ok" and planted() == ""


@pytest.mark.parametrize("path", ["", os.pathsep], ids=["no path", "an empty entry"])
def test_the_command_line_by_its_module(tmp_path, path):
    ran = plant(tmp_path, ("numpy", "struct", "typing", "typer"))
    done = subprocess.run(
        [sys.executable, "-m", "toolkit", "plan", "--help"], cwd=tmp_path, check=False, capture_output=True,
        env=os.environ | {"PYTHONPATH": path + str(Path(toolkit.__file__).parents[1])},
    )  # fmt: skip
    assert (done.returncode, ran()) == (0, ""), done.stderr


def test_the_command_line_keeps_its_own_folder(tmp_path, monkeypatch):
    from toolkit.__main__ import _leave_current_folder

    path = [str(tmp_path), "/mine", str(Path(os.__file__).parent), str(tmp_path)]
    monkeypatch.setattr(sys, "path", list(path))
    monkeypatch.setattr(os, "environ", {"PYTHONPATH": "/mine:"})
    monkeypatch.chdir(Path(toolkit.__file__).parents[1])
    _leave_current_folder()
    assert sys.path == path
    monkeypatch.chdir(tmp_path)
    _leave_current_folder()
    assert sys.path == path[1:]  # behind the library it was put by who installed something, and stands in for nothing
    assert (os.environ["PYTHONPATH"], os.environ["PYTHONSAFEPATH"]) == ("/mine", "1")


STARTING = {
    "subprocess", "multiprocessing", "runpy", "pty", "webbrowser", "joblib", "ProcessPoolExecutor", "DataLoader",
    "executable", "system", "popen", "startfile", "posix_spawn", "posix_spawnp", "fork", "forkpty",
    "create_subprocess_exec", "create_subprocess_shell",
    *(f"{kind}{how}" for kind in ("exec", "spawn") for how in ("l", "le", "lp", "lpe", "v", "ve", "vp", "vpe")),
}  # fmt: skip
IMPORTING = {"import_module", "__import__", "exec", "eval", "compile", "SourceFileLoader", "spec_from_file_location"}
IMPORTERS = {
    ("__init__.py", "import_module"),  # the front door's own list
    ("core/extras.py", "import_module"),  # packages of extras
    ("core/lazy.py", "import_module"),  # four libraries it names itself
    ("core/rooms.py", "import_module"),  # the lists of commands, and of what rooms offer
    ("models/programs.py", "import_module"),  # what somebody typed
}


def list_names(file):
    """Modules that a file imports, and names that it calls or reads from another."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield from (part for one in node.names for part in one.name.split("."))
            yield from (getattr(node, "module", None) or "").split(".")
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id in ("os", "sys", "importlib", "builtins"):
                yield node.attr
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            yield node.func.id


def test_there_is_one_way_to_start_a_process_and_no_other_to_import_by_name():
    package = Path(toolkit.__file__).parent
    names = re.compile(rf"\b({'|'.join(STARTING | IMPORTING)})\b")  # files without any of them are not parsed
    files = [file for file in package.rglob("*.py") if names.search(file.read_text(encoding="utf-8"))]
    found = {(str(file.relative_to(package)), name) for file in files for name in list_names(file)}
    assert {file for file, name in found if name in STARTING} == {"core/child.py"}
    assert {one for one in found if one[1] in IMPORTING} == IMPORTERS


@pytest.mark.skipif(sys.platform != "linux", reason="memory is bounded on Linux alone")
def test_of_two_bounds_the_lower_counts_until_it_ends():
    with limit_memory(512 * MB):
        with limit_memory(64 * MB), pytest.raises(MemoryError):
            bytearray(128 * MB)
        assert len(bytearray(128 * MB)) == 128 * MB
        with pytest.raises(MemoryError):
            bytearray(1024 * MB)
    assert len(bytearray(1024 * MB)) == 1024 * MB
