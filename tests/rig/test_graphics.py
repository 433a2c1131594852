"""Which graphics interface Open3D draws through, and what is said if it does not start."""

import ctypes
from importlib.metadata import PackageNotFoundError
from types import SimpleNamespace

import pytest

from toolkit.rig import graphics


@pytest.mark.parametrize(
    ("installed", "name"), [("0.19.0", "EGL"), ("0.20.0", "Vulkan"), ("0.21.1", "Vulkan"), ("1.0.0", "Vulkan")]
)
def test_the_version_of_open3d_decides(monkeypatch, installed, name):
    monkeypatch.setattr(graphics, "version", lambda _: installed)
    assert graphics.find_graphics().name == name


@pytest.mark.parametrize(("python", "name"), [((3, 12, 9), "EGL"), ((3, 13, 0), "Vulkan")])
def test_without_open3d_the_version_of_python_decides(monkeypatch, python, name):
    def version(package):
        raise PackageNotFoundError(package)

    monkeypatch.setattr(graphics, "version", version)
    monkeypatch.setattr(graphics.sys, "version_info", python)
    assert graphics.find_graphics().name == name


@pytest.mark.parametrize(("interface", "library"), [(graphics.EGL, "libEGL.so.1"), (graphics.VULKAN, "libvulkan.so.1")])
def test_a_missing_library_is_named(monkeypatch, interface, library):
    def load(name):
        raise OSError(name)

    monkeypatch.setattr(ctypes, "CDLL", load)
    assert interface.start() == f"{library} is missing"


@pytest.mark.parametrize(
    ("created", "devices", "expected"),
    [(0, 1, ""), (0, 0, "Vulkan found no device"), (-9, 0, "Vulkan found no driver")],
)
def test_a_vulkan_without_a_device_names_the_package(monkeypatch, created, devices, expected):
    """The codes are Vulkan's: 0 is VK_SUCCESS, -9 VK_ERROR_INCOMPATIBLE_DRIVER."""

    def count(instance, number, _):
        number._obj.value = devices
        return 0

    loader = SimpleNamespace(vkCreateInstance=lambda *_: created, vkEnumeratePhysicalDevices=count)
    monkeypatch.setattr(ctypes, "CDLL", lambda _: loader)
    said = graphics.VULKAN.start()
    assert said.startswith(expected) and bool(said) == bool(expected)
    assert not expected or "mesa-vulkan-drivers" in said


def test_a_driver_that_crashes_ends_only_the_process_that_tries(monkeypatch):
    monkeypatch.setattr(graphics, "run_python", lambda _: SimpleNamespace(returncode=-11, stdout=b""))
    graphics.graphics_trouble.cache_clear()
    try:
        said = graphics.graphics_trouble()
    finally:
        graphics.graphics_trouble.cache_clear()
    assert said == f"{graphics.find_graphics().name}'s driver crashed (signal 11)"
