"""What a method is beside its settings: the code that its import loaded, and the files that it reads.

Taken once in the process that starts a run, carried to every worker, and checked there: a worker whose code is another
one computes nothing, and neither does anybody once a file has changed on disk.
"""

from __future__ import annotations

import ast
import hashlib
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import packages_distributions, version
from pathlib import Path
from site import getusersitepackages
from uuid import uuid4

from bench.errors import DataError, UsageError
from bench.harness.keys.digests import METHOD_PACKAGES, digest_of, source_digest
from bench.methods import Scorable
from bench.plug_ins import loaded_with

PROMPT = "typed at a prompt"  # code without a file; nothing tells two states of it apart


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentityFile:
    """A file that decides what a method answers.

    Attributes:
        name: of the module, or of the file among those that the method lists; the same on every machine.
        path: where it lay when the run began.
        sha256: of its content then, hexadecimal.
        module: it is the source of a module.
    """

    name: str
    path: Path
    sha256: str
    module: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodIdentity:
    """The identity of a method.

    Attributes:
        place: "module:Class".
        files: its own modules and the files that it reads.
        libraries: (distribution, version) of what its own modules import beside this package.
        own_code: digest of this package's code that every method uses.
    """

    place: str
    files: tuple[IdentityFile, ...]
    libraries: tuple[tuple[str, str], ...]
    own_code: str

    @classmethod
    def of(cls, method: Scorable) -> MethodIdentity:
        """The identity of a method in this process.

        Raises:
            UsageError: `files` or `settings()` are not what the contract asks for.
            DataError: a file changed since this process loaded it.
        """
        kind = type(method)
        _refuse_settings(method)
        modules, libraries = _modules(kind)
        listed = ((name, path, False) for name, path in _listed_files(method))
        files = tuple(
            IdentityFile(name=name, path=path, sha256=_loaded(name, path) if module else _on_disk(path), module=module)
            for name, path, module in (*((name, path, True) for name, path in sorted(modules.items())), *listed)
        )
        own_code = source_digest(METHOD_PACKAGES)
        if kind.__module__ not in modules and kind.__module__.partition(".")[0] != "bench":
            own_code = f"{PROMPT}: {_PROCESS}"
        identity = cls(
            place=f"{kind.__module__}:{kind.__qualname__}", files=files, libraries=libraries, own_code=own_code
        )
        identity.refuse_change()
        return identity

    @property
    def digest(self) -> str:
        """SHA-256 over all of it but the paths."""
        return self._digest_at(self.place)

    @property
    def steps_digest(self) -> str:
        """SHA-256 for what is cached of the method; those of this package share steps such as flow."""
        return self._digest_at("bench" if self.place.startswith("bench.") else self.place)

    def _digest_at(self, place: str) -> str:
        files = [(file.name, file.sha256, file.module) for file in self.files]
        return digest_of(place, files, self.libraries, self.own_code)

    def refuse_change(self) -> None:
        """Refuse to go on with other code or files than the run began with, here or on disk.

        Raises:
            DataError: this process loaded another state of a module, or a file changed since.
        """
        for file in self.files:
            path = _path_here(file)
            if file.module and _loaded(file.name, path) != file.sha256:
                do = "start the workers again with the code of the run"
                got = f"another state of {file.name}"
                raise DataError(path, expected="the code that the run began with", got=got, do=do)
            if _on_disk(path) != file.sha256:
                do = "start the run again: what is stored stays, and what follows is computed by the new state"
                got = "other content on disk"
                raise DataError(path, expected="the file as it was when the run began", got=got, do=do)


_PROCESS = uuid4().hex
_first: dict[Path, tuple[ModuleSpec | None, str]] = {}  # digests of sources when this process met the module first
_latest: dict[Path, tuple[tuple[int, ...], str]] = {}  # state and digest of files when they were last read


def _loaded(name: str, path: Path) -> str:
    """SHA-256 of a module's source as this process met it first; a module that was loaded again counts anew."""
    spec = getattr(sys.modules.get(name), "__spec__", None)
    if path not in _first or _first[path][0] is not spec:
        _first[path] = spec, _on_disk(path)
    return _first[path][1]


def _on_disk(path: Path) -> str:
    """SHA-256 of a file; read again only when the file system says that something was done to it."""
    try:
        told = path.stat()
        state = told.st_dev, told.st_ino, told.st_size, told.st_mtime_ns, told.st_ctime_ns
        if path not in _latest or _latest[path][0] != state:
            with path.open("rb") as file:
                _latest[path] = state, hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        got = error.strerror or str(error)
        raise DataError(path, expected="a file of the method that can be read", got=got) from error
    return _latest[path][1]


def _path_here(file: IdentityFile) -> Path:
    """The file in this process: of a module that is loaded, the one that it was loaded from."""
    module = sys.modules.get(file.name) if file.module and file.name != "__main__" else None
    source = getattr(module, "__file__", None)
    return file.path if source is None else Path(source)


def _refuse_settings(method: Scorable) -> None:
    try:
        digest_of(method.settings())
    except TypeError as error:
        raise UsageError(f"method {method.name!r}: settings(): {error}") from error


def _listed_files(method: Scorable) -> Iterator[tuple[str, Path]]:
    """Name and path of every file that a method lists in `files`, folders walked."""
    listed = method.files
    if isinstance(listed, str | bytes | Path) or not isinstance(listed, Iterable):
        raise UsageError(f"method {method.name!r}: files: expected a sequence of paths, got {listed!r}")
    for entry in listed:
        path = Path(entry)
        if path.is_file():
            yield path.name, path
        elif path.is_dir():
            for file in sorted(found for found in path.rglob("*") if found.is_file()):
                yield f"{path.name}/{file.relative_to(path).as_posix()}", file
        else:
            raise UsageError(f"method {method.name!r}: files: expected a file or folder, got no such path {entry!r}")


def _modules(kind: type) -> tuple[dict[str, Path], tuple[tuple[str, str], ...]]:
    """Sources of the modules that a class needs, by name, and the installed libraries among them.

    Followed are the class, its bases, the packages around them, and every import that stands in their sources, also
    one within a function, and what the import of the method loaded by other means. This package, the interpreter's
    library and what is installed are not followed further, but for the package of the class itself.
    """
    waiting = {base.__module__ for base in kind.__mro__}
    own_packages = {name.partition(".")[0] for name in waiting}
    waiting |= loaded_with(kind.__module__)
    known: set[str] = set()
    found: dict[str, Path] = {}
    libraries: set[str] = set()
    while waiting:
        name = waiting.pop()
        top = name.partition(".")[0]
        if name in known or top == "bench":
            continue
        known.add(name)
        if "." in name:
            waiting.add(name.rpartition(".")[0])
        source = _source(name)
        if source is None:
            continue
        if top not in own_packages and _lies_in(source, _installed_folders()):
            libraries.add(top)
            continue
        if _lies_in(source, _interpreter_folders()) and not _lies_in(source, _installed_folders()):
            continue
        found[name] = source
        if source.suffix == ".py":
            waiting |= set(_imports(name, source))
    return found, _versions(libraries)


def _source(name: str) -> Path | None:
    """File of a module, loaded or not; None for a namespace, a built-in module, or something that is no module."""
    if name in sys.modules:
        file = getattr(sys.modules[name], "__file__", None)
        return None if file is None else Path(file)
    spec = _spec(name)
    return Path(spec.origin) if spec is not None and spec.has_location and spec.origin is not None else None


def _spec(name: str) -> ModuleSpec | None:
    """Where a module would be loaded from; unlike `importlib.util.find_spec` it never imports a parent."""
    parent = name.rpartition(".")[0]
    if not parent:
        return PathFinder.find_spec(name)
    if parent in sys.modules:
        places = getattr(sys.modules[parent], "__path__", None)
    else:
        above = _spec(parent)
        places = None if above is None else above.submodule_search_locations
    return None if places is None else PathFinder.find_spec(name, list(places))


def _imports(name: str, source: Path) -> Iterator[str]:
    """Names of all modules that a source may import; some are no modules but things inside of one."""
    package = name if source.stem == "__init__" else name.rpartition(".")[0]
    try:
        tree = ast.parse(source.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            outer = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*outer, *([node.module] if node.module else [])])
            if base:
                yield base
                yield from (f"{base}.{alias.name}" for alias in node.names)


@cache
def _installed_folders() -> tuple[Path, ...]:
    paths = sysconfig.get_paths()
    others = (place for place in sys.path if Path(place).name in {"site-packages", "dist-packages"})
    return tuple(
        Path(place).resolve() for place in (paths["purelib"], paths["platlib"], getusersitepackages(), *others)
    )


@cache
def _interpreter_folders() -> tuple[Path, ...]:
    paths = sysconfig.get_paths()
    return tuple(Path(paths[name]).resolve() for name in ("stdlib", "platstdlib"))


def _lies_in(source: Path, folders: Iterable[Path]) -> bool:
    resolved = source.resolve()
    return any(resolved.is_relative_to(folder) for folder in folders)


@cache
def _distributions() -> Mapping[str, list[str]]:
    """Names of the distributions that hold a package; reads lists of all installed files, half a second."""
    return packages_distributions()


def _versions(libraries: set[str]) -> tuple[tuple[str, str], ...]:
    if not libraries:
        return ()
    names = {name for top in libraries for name in _distributions().get(top, [])}
    return tuple((name, version(name)) for name in sorted(names))
