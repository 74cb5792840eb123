"""Method that made a result, in words and digests; it is never imported or called from here."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib.metadata import packages_distributions, version
from pathlib import Path
from site import getsitepackages, getusersitepackages
from types import MappingProxyType

from pydantic import BaseModel, ConfigDict, Field

from bench.errors import UsageError
from bench.harness.digests import digest_file, digest_of
from bench.harness.exact import ORACLES, build_scorable
from bench.methods import METHODS, Scorable, known_methods
from bench.methods.contract import refuse_unfit
from bench.methods.settings import flat_settings

UNIDENTIFIED = "unidentified"


class MethodOfRun(BaseModel):
    """Method that made the metrics.

    Attributes:
        name: its own.
        settings: every parameter, as the method reports them.
        asked: parameters that the user named, as they were asked for.
        place: "module:Class" of its class; recorded only, never imported from here.
        history: images that it needs before the one that it segments.
        code_digest: of the package that holds its class, or of the modules beside it, and of the files that it reads;
            `UNIDENTIFIED` where no file holds the class, as in a notebook's cell: such a run is computed anew.
        commit: of the checkout that its own code is of, "+" behind it where a file is not as committed; distribution
            and version of an installed one; None for a method of this package, and for code in no commit. It decides
            nothing.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    settings: dict[str, object]
    asked: dict[str, object] = Field(default_factory=dict)
    place: str
    history: int
    code_digest: str
    commit: str | None = None

    @classmethod
    def of(cls, method: Scorable, *, asked: Mapping[str, object] = MappingProxyType({})) -> MethodOfRun:
        """Record a method in this process.

        Raises:
            UsageError: `files` or `settings()` are not what the contract asks for.
        """
        refuse_unfit(method)
        kind = type(method)
        module = getattr(sys.modules.get(kind.__module__), "__file__", None)
        own = kind.__module__.partition(".")[0] == "bench"
        return cls(
            name=method.name,
            settings=json.loads(json.dumps(method.settings(), default=str)),
            asked=json.loads(json.dumps(dict(asked), default=str)),
            place=f"{kind.__module__}:{kind.__qualname__}",
            history=method.history,
            code_digest=method_digest(method),
            commit=None if own or module is None else _origin(kind.__module__, Path(module).resolve()),
        )

    @property
    def is_identified(self) -> bool:
        """True if a file holds its code, so that a change is seen."""
        return self.code_digest != UNIDENTIFIED

    @property
    def is_own(self) -> bool:
        """It is of this package."""
        return self.place.startswith("bench.")

    @property
    def called(self) -> str:
        """Value of `--method` that selects it."""
        return self.name if self.place == known_methods().get(self.name) else self.place

    def options(self) -> list[str]:
        """The options of a command that ask for it: `--method`, and `--set` for each setting that is not its default.

        Of a method that is not of this package the defaults are unknown, since nothing that a stored file names is
        imported; all of its settings are said.
        """
        words = ["--method", self.called]
        for name, value in self.changed_settings().items():
            words += ["--set", f"{name}={json.dumps(value)}"]
        return words

    def changed_settings(self) -> dict[str, object]:
        """The settings that are not the method's defaults, by dotted name; all of them where these are unknown."""
        try:
            own = self.called in METHODS or self.called in ORACLES
            defaults = flat_settings(build_scorable(self.called).settings()) if own else {}
        except UsageError:  # its extra is not installed
            defaults = {}
        flat = flat_settings(self.settings)
        return {name: value for name, value in flat.items() if name not in defaults or defaults[name] != value}


def method_digest(method: Scorable) -> str:
    """Digest of a method's own code and of the files that it reads; `UNIDENTIFIED` where no file holds the code.

    Raises:
        UsageError: a file that it lists is not there.
    """
    sources = dict(_sources(type(method).__module__))
    if not sources and not type(method).__module__.startswith("bench."):
        return UNIDENTIFIED
    files = {f"file {name}": path for name, path in _listed_files(method)}
    return digest_of({name: digest_file(path) for name, path in (sources | files).items()})


def _sources(module: str) -> Iterator[tuple[str, Path]]:
    """Sources of the package that holds a module, or of the modules beside it; none of this package, which counts by
    itself."""
    top = module.partition(".")[0]
    file = getattr(sys.modules.get(module), "__file__", None)
    if top == "bench" or file is None:
        return
    package = getattr(sys.modules.get(top), "__file__", None) if "." in module else file
    place = Path(package or file).resolve()
    if place.name == "__init__.py":
        found = sorted(place.parent.rglob("*.py"))
    elif place.parent in _libraries():
        found = [place]
    else:
        found = sorted({place, *place.parent.glob("*.py")})
    for path in found:
        yield path.relative_to(place.parent).as_posix(), path


def _listed_files(method: Scorable) -> Iterator[tuple[str, Path]]:
    """Name and path of every file that a method lists in `files`, folders walked."""
    for entry in method.files:
        path = Path(entry)
        if path.is_file():
            yield path.name, path
        elif path.is_dir():
            for file in sorted(found for found in path.rglob("*") if found.is_file()):
                yield f"{path.name}/{file.relative_to(path).as_posix()}", file
        else:
            raise UsageError(f"method {method.name!r}: files: expected a file or folder, got no such path {entry!r}")


def _origin(module: str, file: Path) -> str | None:
    if any(file.is_relative_to(folder) for folder in _libraries()):
        names = packages_distributions().get(module.partition(".")[0], ())
        return ", ".join(f"{name} {version(name)}" for name in names) or None
    return commit_of(file)


def _libraries() -> list[Path]:
    return [Path(folder).resolve() for folder in (*getsitepackages(), getusersitepackages())]


def commit_of(file: Path) -> str | None:
    """Commit of the checkout that holds a file, "+" behind it where files of its folder are not as committed; None
    where no commit holds it."""
    if _git(file.parent, "ls-files", "--error-unmatch", "--", file.name) is None:
        return None
    commit, changed = _git(file.parent, "rev-parse", "HEAD"), _git(file.parent, "status", "--porcelain", "--", ".")
    return None if commit is None else commit.strip() + ("" if changed == "" else "+")


def _git(folder: Path, *words: str) -> str | None:
    """Return the output of git; None where it fails or is not installed."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *words], capture_output=True, text=True, check=True, timeout=30
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout
