"""Asking EGL for a display before Filament does: where it cannot start, Filament ends the whole process."""

import ctypes
import ctypes.util
import os

EGL_PLATFORM_SURFACELESS_MESA = 0x31DD
PACKAGES = "libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri libgomp1 libusb-1.0-0"


def egl_trouble() -> str | None:
    """None where an EGL display can be opened without a screen, else the reason in a few words."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return "libEGL.so.1 is missing"
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    address = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    if not address:
        return "EGL has no platform displays"
    get_display = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)(address)
    display = get_display(EGL_PLATFORM_SURFACELESS_MESA, None, None)
    if not display:
        return "EGL has no surfaceless display"
    major, minor = ctypes.c_int(), ctypes.c_int()
    egl.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_int), ctypes.POINTER(ctypes.c_int)]
    if not egl.eglInitialize(display, ctypes.byref(major), ctypes.byref(minor)):
        return "EGL found no driver (is libgl1-mesa-dri installed?)"
    return None


def go_surfaceless() -> None:
    """Tell Open3D's EGL to do without a display; has no effect once a renderer exists."""
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")
