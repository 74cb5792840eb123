"""The public interface: its signatures and the fields of its files are those of public.txt.

After a change that is meant, write the file anew (`python -m tests.api.test_public`), and tell it in the changelog.
"""

import ast
import dataclasses
import inspect
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from bench.commands.schemas import SCHEMAS, json_schema

SNAPSHOT = Path(__file__).with_name("public.txt")
MODULES = ("bench", "bench.methods", "bench.errors")


def lines() -> Iterator[str]:
    for name in MODULES:
        module = import_module(name)
        public = getattr(module, "__all__", None) or [
            key
            for key, value in vars(module).items()
            if getattr(value, "__module__", None) == name and not key.startswith("_")
        ]
        for key in sorted(public):
            yield from _described(f"{name}.{key}", getattr(module, key))
    for name in sorted(SCHEMAS):
        yield from _fields(f"file {name}", json_schema(name))


def _described(name: str, thing: Any) -> Iterator[str]:
    if inspect.isfunction(thing):
        yield f"{name}{_signature(thing)}"
    elif inspect.isclass(thing):
        bases = ", ".join(base.__name__ for base in thing.__bases__)
        yield f"{name}({bases})"
        if dataclasses.is_dataclass(thing):
            yield from (
                f"{name}.{field.name}: {field.type}"
                for field in dataclasses.fields(thing)
                if not field.name.startswith("_")
            )
        for key, member in sorted(vars(thing).items()):
            if key.startswith("_") and key != "__call__":
                continue
            called = member.__func__ if isinstance(member, classmethod | staticmethod) else member
            if inspect.isfunction(called):
                yield f"{name}.{key}{_signature(called)}"
            elif isinstance(member, property) or hasattr(member, "attrname"):
                yield f"{name}.{key}"
    else:
        yield f"{name}: {type(thing).__name__}"


def _signature(function: Any) -> inspect.Signature:
    """The signature without the help of options."""
    signature = inspect.signature(function)
    typed = [p.replace(annotation=_typed(p.annotation)) for p in signature.parameters.values()]
    return signature.replace(parameters=typed)


def _typed(annotation: Any) -> Any:
    told = ast.parse(annotation, mode="eval").body if isinstance(annotation, str) else None
    if isinstance(told, ast.Subscript) and ast.unparse(told.value) == "Annotated":
        assert isinstance(told.slice, ast.Tuple)
        return ast.unparse(told.slice.elts[0]).strip("'")
    return annotation


def _fields(name: str, schema: Any) -> Iterator[str]:
    """Every object of a schema with the names of its fields; those that must be there have a star."""
    if isinstance(schema, Mapping):
        if isinstance(properties := schema.get("properties"), Mapping):
            required = schema.get("required", ())
            yield f"{name}: {', '.join(f'{key}*' if key in required else key for key in sorted(properties))}"
        for key in sorted(schema.get("$defs", {})):
            yield from _fields(f"{name} {key}", schema["$defs"][key])


def test_the_public_interface_is_as_the_snapshot_has_it():
    assert list(lines()) == SNAPSHOT.read_text("utf-8").splitlines(), "changed: if it is meant, see this module's text"


if __name__ == "__main__":
    SNAPSHOT.write_text("\n".join(lines()) + "\n", "utf-8")
