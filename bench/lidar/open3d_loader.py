"""The one place that imports open3d.

The import takes 0.6 s, so it waits until it is needed. The wheel links against `libusb-1.0.so.0`, which servers and
containers often lack; the `libusb-package` wheel carries that library, and once it is loaded for the whole process the
import finds it, with no system package and no root.
"""

from __future__ import annotations

import ctypes
from functools import cache
from types import ModuleType


@cache
def open3d() -> ModuleType:
    """The open3d module, imported on the first call."""
    try:
        import libusb_package
    except ImportError:  # only wanted on Linux
        pass
    else:
        library = libusb_package.get_library_path()
        if library is not None:
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    import open3d as module

    return module
