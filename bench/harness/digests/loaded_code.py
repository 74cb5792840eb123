"""The source of a loaded module: what it imports, whether it was loaded from it, what was changed since."""

from __future__ import annotations

import ast
import marshal
import sys
from collections.abc import Iterator
from functools import cache
from importlib.machinery import SourceFileLoader
from importlib.util import MAGIC_NUMBER
from inspect import getattr_static
from itertools import accumulate
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

from bench.errors import DataError


@cache
def imported_names(module: str, path: Path, sha256: str) -> frozenset[str]:
    """Dotted names that the import statements of a module name, and calls of `import_module`; and what holds them.

    Args:
        module: its name.
        path: of its source.
        sha256: of the source's content.
    """
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    found = set[str]()
    for node in ast.walk(_tree(path, sha256)):
        match node:
            case ast.Import(names=names):
                found |= {alias.name for alias in names}
            case ast.ImportFrom(module=base, names=names, level=level):
                above = package.split(".")[: len(package.split(".")) - level + 1] if level else []
                found |= {".".join([*above, *([base] if base else []), alias.name]) for alias in names}
            case ast.Call(
                func=ast.Name(id="import_module") | ast.Attribute(attr="import_module"),
                args=[ast.Constant(value=str(name)), *_],
            ):
                found.add(name)
    return frozenset(start for name in found for start in accumulate(name.split("."), "{}.{}".format))


def refuse_stale_bytecode(module: ModuleType, path: Path, sha256: str) -> None:
    """Refuse a module whose bytecode Python takes for that of its source, by time and size, though it is of another.

    Args:
        module: as it is loaded.
        path: of its source.
        sha256: of the source's content.

    Raises:
        DataError: it is.
    """
    cached = getattr(module, "__cached__", None)
    if cached is None or not Path(cached).is_file():
        return
    content, state = Path(cached).read_bytes(), path.stat()
    flags, seconds, size = (int.from_bytes(content[place : place + 4], "little") for place in (4, 8, 12))
    by_time = not flags and (seconds, size) == (int(state.st_mtime) & 0xFFFFFFFF, state.st_size & 0xFFFFFFFF)
    if content[:4] == MAGIC_NUMBER and by_time and marshal.loads(content[16:]) != _compiled(path, sha256):
        hint = "remove that file, and start again"
        raise DataError(path, expected="bytecode of this source", got=f"that of another one, in {cached}", hint=hint)


def changed_here(module: ModuleType, path: Path, sha256: str) -> str | None:
    """Name of something in a module that is not as its source has it; None where nothing shows.

    The process changed it after it was loaded, or the source was edited since.

    Args:
        module: as it is loaded.
        path: of its source.
        sha256: of the source's content.
    """
    for name, value in _constants(path, sha256).items():
        if _canonical(getattr(module, name, None)) != _canonical(value):
            return f"{module.__name__}.{name}"
    compiled_by_python = type(module.__loader__) is SourceFileLoader  # tools such as pytest compile by themselves
    for name, function in _functions(module):
        of_this_file = compiled_by_python and function.__code__.co_filename == module.__file__
        if _is_typed(function) or (of_this_file and _code(function.__code__) not in _codes(path, sha256)):
            return f"{module.__name__}.{name}"
    return None


def _canonical(value: object) -> str:
    """Text that is the same for values that a source may write alike: equal sets may be in another order."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{_canonical(key)}: {_canonical(held)}' for key, held in value.items())}}}"
    if isinstance(value, list | tuple | set | frozenset):
        parts = [_canonical(held) for held in value]
        return f"{type(value).__name__}({', '.join(sorted(parts) if isinstance(value, set | frozenset) else parts)})"
    return repr(value)


@cache
def _tree(path: Path, _: str) -> ast.Module:
    """The statements of a source; none of what is no Python, as a library of machine code or a file half edited."""
    try:
        return ast.parse(path.read_bytes())
    except (SyntaxError, ValueError):
        return ast.Module(body=[], type_ignores=[])


@cache
def _compiled(path: Path, _: str) -> CodeType:
    return compile(path.read_bytes(), path, "exec", dont_inherit=True)


@cache
def _constants(path: Path, sha256: str) -> dict[str, object]:
    """Values that the source gives to names of the module once, but for those that its functions change."""
    tree = _tree(path, sha256)
    changed = {name for node in ast.walk(tree) if isinstance(node, ast.Global) for name in node.names}
    names = [node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)]
    found: dict[str, object] = {}
    for statement in tree.body:
        targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
        for target in targets:
            if isinstance(target, ast.Name) and names.count(target.id) == 1 and target.id not in changed:
                try:
                    found[target.id] = ast.literal_eval(statement.value)  # type: ignore[attr-defined]
                except (ValueError, TypeError, AttributeError):
                    continue  # it is computed
    return found


@cache
def _codes(path: Path, sha256: str) -> frozenset[object]:
    """All code of functions of a source; none of what does not compile, as a file half edited."""
    try:
        found = [_compiled(path, sha256)]
    except (SyntaxError, ValueError):
        return frozenset()
    for code in found:  # it grows meanwhile
        found += [inner for inner in code.co_consts if isinstance(inner, CodeType)]
    return frozenset(map(_code, found))


def _code(code: CodeType) -> object:
    """All that decides what code does, the same wherever its lines stand."""
    constants = [_code(one) if isinstance(one, CodeType) else _canonical(one) for one in code.co_consts]
    return code.co_qualname, code.co_code, code.co_names, code.co_varnames, code.co_freevars, tuple(constants)


def _functions(module: ModuleType) -> Iterator[tuple[str, FunctionType]]:
    """Functions of a module and of its own classes, by name."""
    for name, value in list(vars(module).items()):
        own = isinstance(value, type) and value.__module__ == module.__name__
        inside = {f"{name}.{part}": held for part, held in vars(value).items()} if own else {name: value}
        for inner, held in inside.items():
            if isinstance(held, property):
                held = held.fget
            elif isinstance(held, staticmethod | classmethod):
                held = held.__func__
            held = getattr_static(held, "__wrapped__", held)  # it runs no code, as some modules' objects would
            if isinstance(held, FunctionType):
                yield inner, held


def _is_typed(function: FunctionType) -> bool:
    """True for a function of no file: typed at a prompt, or in a notebook's cell."""
    module = sys.modules.get(function.__module__ or "")
    return module is not None and getattr(module, "__file__", None) is None and not hasattr(module, "__path__")
