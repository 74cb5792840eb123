"""The one import of open3d."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from bench.errors import UsageError
from bench.lidar import cloud_files, open3d

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


def test_open3d_loads_without_the_viewers_that_it_brings():
    program = (
        "import sys; sys.modules['plotly'] = sys.modules['dash'] = None\n"
        "from bench.lidar import open3d\n"
        "print(open3d().core.Tensor([1.0]).shape, 'open3d.visualization' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.stdout == "SizeVector[1] False\n", done.stderr


def test_an_open3d_that_does_not_load_says_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(UsageError, match=r"open3d: expected a library that loads.*apt-get install"):
        cloud_files.open3d.__wrapped__()
