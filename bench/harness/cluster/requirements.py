"""Requirements that a process elsewhere must meet before it computes for a run."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name

import bench
from bench.errors import DataError
from bench.harness.cache import CacheFolder
from bench.harness.digests import MethodCode, code_digest
from bench.harness.digests.content import SCORING_PACKAGES
from bench.harness.provenance import library_versions
from bench.methods import Scorable

CODE = (*SCORING_PACKAGES, "harness")


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerRequirements:
    """Properties and files that a worker must have in common with a run.

    Attributes:
        versions: of Python, this package and the libraries that decide metrics.
        code: digest of this package's source.
        method: its code.
        folder: where the run was started; relative paths count from it.
        reads: files and folders that must be there, absolute.
        cache: where cached steps are stored; None for nowhere.
    """

    versions: Mapping[str, str]
    code: str
    method: MethodCode
    folder: Path
    reads: tuple[Path, ...]
    cache: CacheFolder | None

    @classmethod
    def of(cls, method: Scorable, *, reads: tuple[Path, ...], cache: CacheFolder | None) -> WorkerRequirements:
        """The requirements of a run that this process starts.

        Args:
            method: to be scored.
            reads: what units read; relative paths count from the working directory.
            cache: where cached steps are stored; None for nowhere.
        """
        folder = Path.cwd()
        return cls(
            versions=_versions(),
            code=code_digest(CODE),
            method=MethodCode.of(method),
            folder=folder,
            reads=tuple(folder / path for path in reads),
            cache=cache if cache is None else CacheFolder(folder=folder / cache.folder, limit_bytes=cache.limit_bytes),
        )

    def unmet(self) -> str | None:
        """Return the reason why this process cannot compute for the run, and what to do about it; None where it can."""
        return self._other_code() or self._other_method() or self._missing_path()

    def _other_code(self) -> str | None:
        here = _versions()
        other = [f"{name} {here.get(name)}, not {version}" for name, version in self.versions.items()
                 if here.get(name) != version]  # fmt: skip
        if other:
            return f"it has {'; '.join(other)}; install the same on all machines and start the workers again"
        if code_digest(CODE) != self.code:
            place = Path(bench.__file__).parent
            return f"it has other code of fisheye-bench, in {place}; install the same and start the workers again"
        return None

    def _other_method(self) -> str | None:
        try:
            resolve_name(self.method.place)
            self.method.refuse_change()
        except (ImportError, AttributeError, ValueError) as error:
            return (
                f"it cannot import the method {self.method.place} ({error}); set PYTHONPATH where workers are started"
            )
        except DataError as error:
            return f"it has other code of the method {self.method.place}: {error}"
        return None

    def _missing_path(self) -> str | None:
        if not os.access(self.folder, os.X_OK):
            return f"it has no folder {self.folder}; start the run in a folder that is there on all machines"
        for path in self.reads:
            if not os.access(path, os.R_OK):
                return f"it does not see {path}; data must be there under the same path on all machines"
        if self.cache is not None:
            try:
                self.cache.prepare()
            except DataError as error:
                return str(error)
        return None


def _versions() -> dict[str, str]:
    python = ".".join(platform.python_version_tuple()[:2])
    return {"Python": python, "fisheye-bench": bench.__version__, **library_versions()}
