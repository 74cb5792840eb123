"""YAML of plain values, never more of it than a file can be meant to hold.

PyYAML's safe loader makes no objects, but it follows references: a text of ten lines can stand for a billion values,
and one that nests deeply ends in a traceback. Here the tree is measured before anything is made of it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from bench.errors import DataError, UnknownNameError

# libyaml where PyYAML was built with it, ten times as fast.
LOADER: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
DEEPEST = 50
MOST_VALUES = 1_000_000  # with every reference written out


def parse_yaml(text: str, *, file: Path | str) -> Any:
    """Parse a YAML document of plain values: keys, lists, text, numbers, dates.

    Args:
        text: one document.
        file: where it comes from, for messages.

    Raises:
        DataError: not YAML, with tags that stand for objects, a key that stands twice in a mapping, too deep, or too
            large with its references written out.
    """
    try:
        _refuse_deep(text, file)
        loader = LOADER(text)
        tree = loader.get_single_node()
        if tree is None:
            return None
        if _size(tree, {}, file) > MOST_VALUES:
            expected = f"at most {MOST_VALUES} values with references written out"
            raise DataError(file, expected=expected, got="more, by references to references")
        return loader.construct_document(tree)
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # ValueError: days and numbers that cannot be
        raise DataError(file, expected="YAML", got=" ".join(str(error).split())[:200]) from error


def _refuse_deep(text: str, file: Path | str) -> None:
    """Count levels in the text's events, which nest nothing."""
    depth = 0
    for event in yaml.parse(text, Loader=LOADER):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            field = f"line {event.start_mark.line + 1}" if event.start_mark is not None else None
            raise DataError(file, field=field, expected=f"at most {DEEPEST} levels", got="more")


def _size(node: yaml.Node, known: dict[int, int], file: Path | str) -> int:
    """Values below a node with references written out; one that refers to itself has too many."""
    if id(node) not in known:
        known[id(node)] = MOST_VALUES + 1  # until it is counted, so for a reference to itself
        parts = node.value if isinstance(node, yaml.SequenceNode) else []
        if isinstance(node, yaml.MappingNode):
            _refuse_keys_twice(node, file)
            parts = [part for pair in node.value for part in pair]
        known[id(node)] = 1 + sum(_size(part, known, file) for part in parts)
    return known[id(node)]


def _refuse_keys_twice(mapping: yaml.MappingNode, file: Path | str) -> None:
    """Refuse a key that a mapping has twice: the loader takes the last one and says nothing."""
    seen = dict[tuple[str, str], int]()
    for key, _ in mapping.value:
        line, name = key.start_mark.line + 1, (key.tag, str(key.value))
        if isinstance(key, yaml.ScalarNode) and name in seen:
            got = f"{key.value!r} again, as in line {seen[name]}"
            raise DataError(file, field=f"line {line}", expected="each key once", got=got)
        seen[name] = line


def known_rules(folder: Path) -> tuple[str, ...]:
    """Names of the YAML files that the package ships in a folder."""
    return tuple(sorted(file.stem for file in folder.glob("*.yaml")))


def read_rules(name_or_path: str | Path, *, shipped: Path, kind: str) -> tuple[dict[str, Any], Path]:
    """Read a file of rules: one of the package by name, or any other by its path.

    A file with `based_on: NAME`, of the package, takes over what it does not say itself, key by key at every level.

    Args:
        name_or_path: of the file.
        shipped: folder of the package's files.
        kind: of the rules, for messages.

    Returns:
        values: all of them.
        file: where they came from.

    Raises:
        UnknownNameError: neither a name nor a file.
        DataError: not readable, not YAML with keys, or based on what the package does not have.
    """
    known = known_rules(shipped)
    file = shipped / f"{name_or_path}.yaml" if name_or_path in known else Path(name_or_path)
    if not file.is_file():
        raise UnknownNameError(kind, str(name_or_path), known)
    try:
        text = file.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(file, expected="a readable text file", got=" ".join(str(error).split())) from error
    values = parse_yaml(text, file=file)
    if not isinstance(values, dict):
        raise DataError(file, expected="keys and values", got=type(values).__name__)
    if "based_on" not in values:
        return values, file
    base, own = values["based_on"], {key: value for key, value in values.items() if key != "based_on"}
    if base not in known:
        raise DataError(file, field="based_on", expected=f"one of {', '.join(known)}", got=repr(base))
    return _merged(read_rules(base, shipped=shipped, kind=kind)[0], own), file


def _merged(base: Any, own: Any) -> Any:
    if not (isinstance(base, dict) and isinstance(own, dict)):
        return own
    return base | {key: _merged(base.get(key), value) for key, value in own.items()}
