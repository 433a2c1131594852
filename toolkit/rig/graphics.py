"""The graphics interface that Open3D's Filament draws through, and whether it starts on this machine.

Open3D draws through EGL up to 0.19 and through Vulkan from 0.20. Filament ends the process if the interface does not
start, so another process tries it first.
"""

import ctypes
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version

from toolkit.core.child import run_python

EGL_PLATFORM_SURFACELESS_MESA = 0x31DD
VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO = 1
APT = "sudo apt-get install -y --no-install-recommends"
LOADED = "libegl1 libgl1 libgomp1 libidn2-0 libusb-1.0-0 libx11-6"
"""Debian's packages of the libraries that every Open3D loads when it is imported."""


@dataclass(frozen=True)
class Graphics:
    """A graphics interface."""

    name: str  # its name
    found: str  # what a successful start shows
    packages: str  # Debian's packages that Open3D and a software driver need
    # tries the interface in the current process, and returns why it does not start, or nothing
    start: Callable[[], str]


def find_graphics() -> Graphics:
    """Return the interface of the installed Open3D, or of the version for this Python."""
    try:
        has_vulkan = [*map(int, version("open3d").split(".")[:2])] >= [0, 20]
    except PackageNotFoundError:
        has_vulkan = sys.version_info >= (3, 13)
    return VULKAN if has_vulkan else EGL


@lru_cache(maxsize=1)
def graphics_trouble() -> str | None:
    """Return why Filament's graphics interface does not start without a screen, in a few words, or None if it does."""
    # in another process: a driver that crashes ends that process alone, and no driver meets torch's libraries here
    done = run_python("from toolkit.rig.graphics import find_graphics; print(find_graphics().start())")
    if done.returncode < 0:
        return f"{find_graphics().name}'s driver crashed (signal {-done.returncode})"
    return done.stdout.decode("utf-8", "replace").strip() or None


def go_surfaceless() -> None:
    """Tell Open3D's EGL to do without a display; has no effect once a renderer exists."""
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")


def _start_egl() -> str:
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return "libEGL.so.1 is missing"
    # without types, ctypes cuts a pointer to 32 bits
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    # a display without a screen: the function for it is an extension, found by name
    address = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    if not address:
        return "EGL has no platform displays"
    prototype = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)
    display = prototype(address)(EGL_PLATFORM_SURFACELESS_MESA, None, None)
    if not display:
        return "EGL has no surfaceless display"
    egl.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    if not egl.eglInitialize(display, None, None):
        return "EGL found no driver (is libgl1-mesa-dri installed?)"
    return ""


class _InstanceCreateInfo(ctypes.Structure):
    """Vulkan's `VkInstanceCreateInfo`."""

    _fields_ = (
        ("type", ctypes.c_uint32),
        ("next", ctypes.c_void_p),
        ("flags", ctypes.c_uint32),
        ("application", ctypes.c_void_p),
        ("layer_count", ctypes.c_uint32),
        ("layers", ctypes.c_void_p),
        ("extension_count", ctypes.c_uint32),
        ("extensions", ctypes.c_void_p),
    )


def _start_vulkan() -> str:
    try:
        vulkan = ctypes.CDLL("libvulkan.so.1")
    except OSError:
        return "libvulkan.so.1 is missing"
    # the loader makes no instance without a driver
    wanted, instance, count = _InstanceCreateInfo(), ctypes.c_void_p(), ctypes.c_uint32()
    wanted.type = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO
    if vulkan.vkCreateInstance(ctypes.byref(wanted), None, ctypes.byref(instance)):
        return "Vulkan found no driver (is mesa-vulkan-drivers installed?)"
    # the loader counts the devices; none is opened
    failed = vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    if failed or not count.value:
        return "Vulkan found no device (is mesa-vulkan-drivers installed?)"
    return ""


EGL = Graphics("EGL", "a surfaceless display opens", f"{LOADED} libegl-mesa0 libgl1-mesa-dri", _start_egl)
VULKAN = Graphics("Vulkan", "a device is found", f"{LOADED} libvulkan1 mesa-vulkan-drivers", _start_vulkan)
