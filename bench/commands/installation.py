"""What a report of a problem has to say about machine and installation: `--version --verbose`."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

from bench.commands.console import say
from bench.errors import BenchError

SETTINGS = ("FISHEYE_BENCH_", "OMP_", "OPENBLAS_", "MKL_", "NUMBA_", "OPENCV_", "PYTHON")  # environment variables
OPTIONAL = ("distributed", "rerun-sdk", "onnxruntime", "torch")
OTHER_OPENCVS = ("opencv-python", "opencv-contrib-python")


def print_installation() -> bool:
    """Print versions, cores, settings, optional parts and what is wrong; return whether nothing is."""
    for name, value in _installation():
        say(f"{name + ':':<13}{value}")
    others = [name for name in OTHER_OPENCVS if _version(name)]
    if not others:
        say("nothing wrong was found")
        return True
    both = " ".join([*others, "opencv-python-headless"])
    say(
        f"wrong: {' and '.join(others)} beside opencv-python-headless, which overwrite each other's files; "
        f"pip uninstall {both}, then pip install opencv-python-headless",
        style="red",
    )
    return False


def _installation() -> Iterator[tuple[str, str]]:
    from bench.execution import usable_cores
    from bench.harness.digests import library_versions
    from bench.harness.manifest import package_commit
    from bench.lidar.cloud_files import open3d

    yield "commit", package_commit() or "unknown"
    yield "system", f"{platform.platform()}, {usable_cores()} of {os.cpu_count()} cores"
    yield "Python", f"{platform.python_version()} ({platform.python_implementation()})"
    yield "libraries", ", ".join(f"{name} {number}" for name, number in library_versions().items())
    yield "optional", ", ".join(f"{name} {_version(name) or 'not installed'}" for name in OPTIONAL)
    try:
        open3d()
        yield "open3d", "loads"
    except BenchError as error:  # it links against libraries that slim systems lack
        yield "open3d", f"does not load, so that compressed point clouds cannot be read: {error}"
    chosen = sorted(name for name in os.environ if name.startswith(SETTINGS))
    yield "environment", ", ".join(f"{name}={os.environ[name]}" for name in chosen) or "no variable of ours is set"


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
