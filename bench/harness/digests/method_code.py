"""Code that is loaded with a method, and the files that it reads.

Taken once, after the method was built, in the process that starts a run; carried to every worker, and checked there: a
worker whose code is another one computes nothing, and neither does anybody once a file has changed on disk.

The code is what the process has loaded from outside of the interpreter, installed libraries and this package: all of
the package of the method's class, and every other module that an import statement of one that counts names. What a
method imports later, while it segments, is refused.
"""

from __future__ import annotations

import hashlib
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.machinery import ModuleSpec
from importlib.metadata import packages_distributions, version
from pathlib import Path
from site import getusersitepackages
from uuid import uuid4

from bench.errors import DataError, UsageError
from bench.harness.digests.content import METHOD_PACKAGES, digest_of, source_digests
from bench.harness.digests.loaded_code import changed_here, imported_names, refuse_stale_bytecode
from bench.methods import Scorable
from bench.methods.contract import refuse_unfit

PROGRAM = ("__main__", "__mp_main__")  # no module imports it


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeFile:
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
class MethodCode:
    """The code of a method, and the files that it reads, by digest.

    Attributes:
        place: "module:Class".
        files: its own modules and the files that it reads.
        libraries: (distribution, version) of what its own modules name beside this package.
        own_code: digest of this package's code that every method uses.
        unidentified: what of it no file holds, as a class of a notebook's cell; "" mostly. Two states of it cannot be
            told apart, so that the digest is a new one each time it is taken: results of it are never found done.
    """

    place: str
    files: tuple[CodeFile, ...]
    libraries: tuple[tuple[str, str], ...]
    own_code: str
    unidentified: str = ""

    @classmethod
    def of(cls, method: Scorable) -> MethodCode:
        """The code of a method in this process.

        Raises:
            UsageError: `files` or `settings()` are not what the contract asks for.
            DataError: a file changed since this process loaded it.
        """
        kind = type(method)
        refuse_unfit(method)
        modules = _own_modules(kind.__module__, held=_held_modules(method))
        files = [
            *(
                CodeFile(name=name, path=path, sha256=_first_met(name, path), module=True)
                for name, path in modules.items()
            ),
            *(
                CodeFile(name=name, path=path, sha256=_on_disk(path), module=False)
                for name, path in _listed_files(method)
            ),
        ]
        unidentified = _unidentified(kind, modules)
        method_code = cls(
            place=f"{kind.__module__}:{kind.__qualname__}",
            files=tuple(files),
            libraries=_libraries(modules),
            own_code=uuid4().hex if unidentified else digest_of(source_digests(METHOD_PACKAGES)),
            unidentified=unidentified,
        )
        method_code.refuse_change()
        return method_code

    @property
    def digest(self) -> str:
        """SHA-256 over all of it but the paths."""
        return self._digest_at(self.place)

    @property
    def steps_digest(self) -> str:
        """SHA-256 for what is cached of the method; those of this package share steps such as flow."""
        return self._digest_at("bench" if self.place.startswith("bench.") else self.place)

    @property
    def parts(self) -> dict[str, str]:
        """Digests of its files and versions of its libraries by name; code of this package is not among them."""
        files = {file.name: file.sha256 for file in self.files}
        unidentified = {self.unidentified: self.own_code} if self.unidentified else {}
        return {"class": self.place, **files, **dict(self.libraries), **unidentified}

    def _digest_at(self, place: str) -> str:
        files = [(file.name, file.sha256, file.module) for file in self.files]
        return digest_of(place, files, self.libraries, self.own_code)

    def refuse_change(self) -> None:
        """Refuse to go on with other code or files than the run began with, here or on disk.

        Raises:
            DataError: this process loaded another state of a module, or one that the run did not begin with, or a file
                changed since.
        """
        names = frozenset(file.name for file in self.files if file.module)
        here = _own_modules(self.place.partition(":")[0], held=names)
        for file in self.files:
            if file.module and file.name not in here:
                continue  # what this process has not loaded decides nothing in it
            path = here[file.name] if file.module else file.path
            if file.module and _first_met(file.name, path) != file.sha256:
                hint = "start the workers again with the code of the run"
                got = f"another state of {file.name}"
                raise DataError(path, expected="the code that the run began with", got=got, hint=hint)
            if _on_disk(path) != file.sha256:
                hint = "start the run again: what is stored stays, and what follows is computed by the new state"
                got = "other content on disk"
                raise DataError(path, expected="the file as it was when the run began", got=got, hint=hint)
        for name in sorted(here.keys() - names):
            hint = "import it at the top of a module, or when the method is built"
            got = f"{name}, which was imported later"
            raise DataError(here[name], expected="code that is loaded when the run begins", got=got, hint=hint)


_met: dict[str, tuple[ModuleSpec | None, str]] = {}  # digests of sources when this process met the module first


def _first_met(name: str, path: Path) -> str:
    """SHA-256 of a module's source as this process met it first; a module that was loaded again counts anew."""
    spec = getattr(sys.modules[name], "__spec__", None)
    if name not in _met or _met[name][0] is not spec:
        _met[name] = spec, _on_disk(path)
        if path.suffix == ".py":
            refuse_stale_bytecode(sys.modules[name], path, _met[name][1])
    return _met[name][1]


def _unidentified(kind: type, modules: Mapping[str, Path]) -> str:
    """Name of code of a method that is not as a file has it; "" where all of it is."""
    if kind.__module__ not in modules and not _of_bench(kind.__module__):
        return f"{kind.__module__}.{kind.__qualname__}"
    sources = ((sys.modules[name], path) for name, path in modules.items() if path.suffix == ".py")
    return next(filter(None, (changed_here(module, path, _on_disk(path)) for module, path in sources)), "")


def _on_disk(path: Path) -> str:
    """SHA-256 of a file; read again only when the file system says that something was done to it."""
    try:
        state = path.stat()
        return _sha256(path, state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns)
    except OSError as error:
        got = error.strerror or str(error)
        raise DataError(path, expected="a file of the method that can be read", got=got) from error


@cache
def _sha256(path: Path, *_: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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


def _held_modules(method: Scorable) -> frozenset[str]:
    """Names of modules that a method's attributes are of, or name: it may have imported them when it was built."""
    held = [value for one in getattr(method, "__dict__", {}).values() for value in _parts_of(one)]
    of = (getattr(value, "__module__", None) or getattr(type(value), "__module__", None) for value in held)
    named = (value if isinstance(value, str) else getattr(value, "__name__", None) for value in held)
    return frozenset(name for name in (*of, *named) if isinstance(name, str))


def _parts_of(value: object) -> Iterable[object]:
    if isinstance(value, Mapping):
        return value.values()
    return value if isinstance(value, list | tuple | set) else (value,)


def _own_modules(module: str, *, held: frozenset[str] = frozenset()) -> dict[str, Path]:
    """Sources of the loaded modules that make a method, by name; none for a class of this package.

    Args:
        module: of the method's class. The package that holds it counts wherever it lies.
        held: names of further modules that count.
    """
    if _of_bench(module):
        return {}
    package = module.partition(".")[0]
    loaded = {name: getattr(one, "__file__", None) for name, one in list(sys.modules.items())}
    sources = {
        name: Path(source)
        for name, source in loaded.items()
        if source is not None and (_is_in(name, package) or not _is_of_others(name, source))
    }
    found = {name for name in sources if _is_in(name, package) or name in held}
    new = found
    while new:
        new = (sources.keys() & _named({name: sources[name] for name in new})) - found
        found |= new
    return {name: sources[name] for name in sorted(found)}


def _is_in(module: str, package: str) -> bool:
    return module.partition(".")[0] == package


def _of_bench(module: str) -> bool:
    return _is_in(module, "bench")


def _is_of_others(module: str, source: str) -> bool:
    """True for a module of this package, of the interpreter or an installed package, and for the program itself."""
    return _of_bench(module) or module in PROGRAM or _is_library(source)


@cache
def _is_library(source: str) -> bool:
    """True if a file belongs to the interpreter or to an installed package."""
    paths = sysconfig.get_paths()
    named = (paths[name] for name in ("stdlib", "platstdlib", "purelib", "platlib"))
    others = (place for place in sys.path if Path(place).name in {"site-packages", "dist-packages"})
    folders = (Path(place).resolve() for place in (*named, getusersitepackages(), *others))
    return any(Path(source).resolve().is_relative_to(folder) for folder in folders)


def _libraries(modules: Mapping[str, Path]) -> tuple[tuple[str, str], ...]:
    """Versions of the installed libraries whose names are words in a method's modules."""
    tops = {name.partition(".")[0] for name in _named(modules)} - {"bench"}
    names = {name for top in tops for name in _distributions().get(top, ())} if modules else ()
    return tuple((name, version(name)) for name in sorted(names))


@cache
def _distributions() -> Mapping[str, list[str]]:
    """Names of the distributions that hold a package; reads lists of all installed files, half a second."""
    return packages_distributions()


def _named(modules: Mapping[str, Path]) -> frozenset[str]:
    """Names of all that import statements of modules name, and of the packages that hold it."""
    return frozenset().union(*(imported_names(name, path, _on_disk(path)) for name, path in modules.items()))
