"""`toolkit doctor`'s checks, each on a machine that lacks the thing."""

import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from types import SimpleNamespace

import pytest

from toolkit.rig.renderers import GRAPHICS, RENDERERS
from toolkit.training import machine


def find_check(name):
    checks = filter(None, map(machine._other_renderer, RENDERERS))
    return next(check for check in checks if check.name == name)


CHECKS = {
    "Python": machine._python, "packages": machine._packages, "Open3D": machine._open3d,
    GRAPHICS.name: lambda: find_check(GRAPHICS.name), "ResNet-18 weights": machine._weights,
}  # fmt: skip


@pytest.mark.slow
def test_this_machine_runs_the_tests_so_it_has_what_is_needed():
    for name in ("Python", "packages", "Open3D"):
        check = CHECKS[name]()
        assert (check.name, check.state, check.fix) == (name, "ok", ""), check.found


def test_another_python_is_missing(monkeypatch):
    for version in ((3, 9, 1), (3, 15, 0)):
        monkeypatch.setattr(sys, "version_info", version)
        check = machine._python()
        assert check.state == "missing" and "from 3.10 to 3.14" in check.fix


def test_absent_packages_are_named_with_the_line_that_installs_them(monkeypatch):
    real = machine.version

    def version(name):
        if name in ("trimesh", "open3d"):
            raise PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(machine, "version", version)
    check = machine._packages()
    assert check.state == "missing" and check.found == "2 not installed"
    open3d = "'open3d>=0.20'" if sys.version_info >= (3, 13) else "'open3d==0.19.0'"  # a wheel for this Python
    assert check.fix.startswith("pip install ") and open3d in check.fix and "'trimesh" in check.fix


def test_an_open3d_that_cannot_start_names_the_system_libraries(monkeypatch):
    def run(*_, **__):
        return SimpleNamespace(returncode=1, stdout=b"", stderr=b"Traceback\nOSError: libusb-1.0.so.0: cannot open\n")

    monkeypatch.setattr(subprocess, "run", run)
    check = machine._open3d()
    assert check.state == "missing" and "libusb" in check.found
    assert check.fix.startswith("sudo apt-get install") and "libusb-1.0-0" in check.fix


def test_an_open3d_that_crashes_is_told_by_its_code(monkeypatch):
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: SimpleNamespace(returncode=-11, stdout=b"", stderr=b""))
    assert "-11" in machine._open3d().found


def test_without_graphics_only_filament_is_lost(monkeypatch):
    kind = replace(RENDERERS["filament"], find_trouble=lambda: "a library is missing")
    monkeypatch.setitem(RENDERERS, "filament", kind)
    check = find_check(GRAPHICS.name)
    assert check.state == "note" and "a library is missing" in check.found and check.fix.endswith(GRAPHICS.packages)
    monkeypatch.setitem(RENDERERS, "filament", replace(kind, find_trouble=lambda: None))
    assert find_check(GRAPHICS.name) == machine.Check(GRAPHICS.name, "ok", GRAPHICS.found)


@pytest.mark.parametrize(("free_mb", "state"), [(20_000, "ok"), (499, "missing")])
def test_free_disk(tmp_path, monkeypatch, free_mb, state):
    asked = []

    def usage(path):
        asked.append(Path(path))
        return SimpleNamespace(free=free_mb * 2**20)

    monkeypatch.setattr(shutil, "disk_usage", usage)
    check = machine._disk(tmp_path / "not" / "yet")
    assert check.state == state and asked == [tmp_path]
    assert bool(check.fix) == (state == "missing")


def test_weights_are_found_or_the_way_to_them_is_told(tmp_path, monkeypatch):
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("TOOLKIT_WEIGHTS", raising=False)
    check = machine._weights()
    assert (check.state, check.found) == ("note", "not on this machine yet") and "TOOLKIT_WEIGHTS" in check.fix
    monkeypatch.setenv("TOOLKIT_WEIGHTS", str(tmp_path))
    assert machine._weights() == check  # a folder without them
    monkeypatch.setenv("TOOLKIT_WEIGHTS", str(tmp_path / "nowhere"))
    check = machine._weights()
    assert (check.state, check.fix) == ("missing", "fix or unset TOOLKIT_WEIGHTS")
    assert check.found == f"TOOLKIT_WEIGHTS is {tmp_path / 'nowhere'}, which is no folder"
    (tmp_path / "cache" / "hub" / "checkpoints").mkdir(parents=True)
    (tmp_path / "cache" / "hub" / "checkpoints" / "resnet18-f37072fd.pth").write_bytes(b"x")
    check = machine._weights()  # downloaded before: found whatever the variable says
    assert check.state == "ok" and "resnet18-f37072fd.pth" in check.found
    (tmp_path / "resnet18-abcd1234.pth").write_bytes(b"x")
    monkeypatch.setenv("TOOLKIT_WEIGHTS", str(tmp_path))
    check = machine._weights()
    assert check.state == "ok" and "resnet18-abcd1234.pth" in check.found


def test_where_the_compiled_renderer_lies_or_will(tmp_path, monkeypatch):
    def check(cache: Path) -> machine.Check:
        monkeypatch.setenv("TOOLKIT_CACHE", str(cache))
        cache_folder.cache_clear()
        return machine._renderer()

    from toolkit.rig.kernel.compiled import cache_folder

    try:
        found = check(tmp_path)
        assert (found.state, found.fix) == ("note", "") and "not compiled yet" in found.found
        (cache_folder() / "complete").touch()
        found = check(tmp_path)
        assert found.state == "ok" and found.found == f"compiled, in {cache_folder()}"
        (tmp_path / "file").write_text("no folder")
        found = check(tmp_path / "file")
        assert found.state == "note" and "each start" in found.found and "TOOLKIT_CACHE" in found.fix
    finally:
        monkeypatch.undo()
        cache_folder.cache_clear()


def test_a_numba_that_cannot_be_loaded_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "toolkit.rig.kernel.compiled", None)
    check = machine._renderer()
    assert check.state == "missing" and "numba" in check.fix


def test_a_slow_variant_comes_with_the_line_that_makes_it_faster(monkeypatch):
    kind = replace(RENDERERS["mitsuba"], find_trouble=lambda: None, describe=lambda: ("mitsuba 3.9.1 llvm_ad_rgb", ""))
    monkeypatch.setitem(RENDERERS, "mitsuba", kind)
    assert machine._other_renderer("mitsuba") == machine.Check("Mitsuba", "ok", "mitsuba 3.9.1 llvm_ad_rgb")
    slow = replace(kind, describe=lambda: ("mitsuba 3.9.1 scalar_rgb", "apt-get install llvm"))
    monkeypatch.setitem(RENDERERS, "mitsuba", slow)
    check = machine._other_renderer("mitsuba")
    assert (check.state, check.fix) == (
        "ok",
        "apt-get install llvm",
    ) and "another variant would be faster" in check.found
