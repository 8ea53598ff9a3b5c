"""Imports that need care on a bare machine."""

from __future__ import annotations

import ctypes
from types import ModuleType


def import_open3d() -> ModuleType:
    """Import open3d, giving it the libusb of the `libusb-package` wheel where the system has none.

    open3d's wheel links libusb-1.0 for depth cameras that gsbridge never opens. Loading the wheel's copy first, with global
    symbols, satisfies the linker by its soname without root rights.
    """
    try:
        ctypes.CDLL("libusb-1.0.so.0", mode=ctypes.RTLD_GLOBAL)
    except OSError:
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    import open3d

    return open3d
