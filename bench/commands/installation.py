"""What a report of a problem has to say about machine and installation: `--version --verbose`."""

from __future__ import annotations

import os
import platform
import re
import shutil
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from bench.commands.console import say
from bench.errors import BenchError

SETTINGS = ("FISHEYE_BENCH_", "OMP_", "OPENBLAS_", "MKL_", "NUMBA_", "OPENCV_", "PYTHON")  # environment variables
DEVELOPMENT = {"dev", "docs"}  # extras that no user needs


def print_installation() -> bool:
    """Print versions, cores, memory, disk, optional parts and what is wrong; return whether nothing is."""
    for name, value in (*_machine(), *_installation()):
        say(f"{name + ':':<15}{value}")
    problems = list(_problems())
    for problem in problems:
        say(f"wrong: {problem}", style="red")
    if not problems:
        say("nothing wrong was found")
    return not problems


def _machine() -> Iterator[tuple[str, str]]:
    from bench.execution import usable_cores

    yield "system", f"{platform.platform()}, {platform.machine()}"
    yield "cores", f"{usable_cores()} of {os.cpu_count()}"
    yield "memory", _memory()
    free_gb = shutil.disk_usage(Path.cwd()).free / 1e9
    yield "disk", f"{free_gb:.0f} GB free in the working folder"
    chosen = sorted(name for name in os.environ if name.startswith(SETTINGS))
    yield "environment", ", ".join(f"{name}={os.environ[name]}" for name in chosen) or "no variable of ours is set"


def _memory() -> str:
    """Physical memory and what of it is free, as Linux tells; the first alone where it does not."""
    told = Path("/proc/meminfo")
    if not told.is_file():
        return f"{os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 1e9:.0f} GB"
    kilobytes = {name: int(rest.split()[0]) for name, _, rest in (x.partition(":") for x in told.open())}
    return f"{kilobytes['MemTotal'] / 1e6:.0f} GB, {kilobytes['MemAvailable'] / 1e6:.0f} GB available"


def _installation() -> Iterator[tuple[str, str]]:
    from bench.harness.digests import library_versions
    from bench.harness.manifest import package_commit

    yield "commit", package_commit() or "unknown"
    yield "Python", f"{platform.python_version()} ({platform.python_implementation()})"
    yield "libraries", ", ".join(f"{name} {number}" for name, number in library_versions().items())
    yield "open3d", _open3d()
    for extra, packages in _extras().items():
        yield f"[{extra}]", ", ".join(f"{name} {_version(name) or 'not installed'}" for name in packages)


def _extras() -> dict[str, list[str]]:
    """The packages of each optional part, as the distribution lists them."""
    found: dict[str, list[str]] = {}
    for line in requires("fisheye-bench") or ():
        named = re.match(r"([\w.-]+).*extra == ['\"]([\w-]+)['\"]", line)
        if named and named[2] not in DEVELOPMENT and named[1] != "fisheye-bench":
            found.setdefault(named[2], []).append(named[1])
    return found


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _open3d() -> str:
    """State of the library, which links against libraries that slim systems lack."""
    from bench.lidar.cloud_files import open3d

    try:
        open3d()
    except BenchError as error:
        return f"does not load, so that compressed point clouds cannot be read: {error}"
    return "loads"


def _problems() -> Iterator[str]:
    """Problems of the installation, each with what to do."""
    others = [name for name in ("opencv-python", "opencv-contrib-python") if _version(name)]
    if others:
        both = " ".join([*others, "opencv-python-headless"])
        yield (
            f"{' and '.join(others)} beside opencv-python-headless, which overwrite each other's files; "
            f"pip uninstall {both}, then pip install opencv-python-headless"
        )
