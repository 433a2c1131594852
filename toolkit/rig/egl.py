"""Asking EGL for a display before Filament does: where it cannot start, Filament ends the whole process."""

import ctypes
import os
from functools import lru_cache

from toolkit.core.child import run_python

EGL_PLATFORM_SURFACELESS_MESA = 0x31DD
PACKAGES = "libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri libgomp1 libusb-1.0-0"


@lru_cache(maxsize=1)
def egl_trouble() -> str | None:
    """None where an EGL display opens without a screen, else the reason in a few words.

    Asked in a process of its own: a graphics driver that is loaded here would meet torch's libraries, and one that
    fails may end the process that asked.
    """
    # in a process of its own: a driver that crashes takes only that one down
    done = run_python("from toolkit.rig.egl import _probe; print(_probe())")
    if done.returncode < 0:
        return f"EGL's driver crashed (signal {-done.returncode})"
    return done.stdout.decode("utf-8", "replace").strip() or None


def go_surfaceless() -> None:
    """Tell Open3D's EGL to do without a display; has no effect once a renderer exists."""
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")


def _probe() -> str:
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return "libEGL.so.1 is missing"
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
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
