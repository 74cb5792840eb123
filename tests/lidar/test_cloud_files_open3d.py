"""The one import of open3d."""

import re
from pathlib import Path

from bench.lidar import open3d

PACKAGE = Path(__file__).parents[2] / "bench"


def test_open3d_loads_without_a_system_libusb():
    assert hasattr(open3d(), "t")
    assert open3d() is open3d()


def test_no_other_file_imports_it():
    importing = re.compile(r"^\s*(import open3d|from open3d)", re.MULTILINE)
    found = [
        path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py") if importing.search(path.read_text())
    ]
    assert found == ["lidar/cloud_files.py"]
