"""`new`: begin something of the user's own: files that run as they are, with the contract in their comments."""

from __future__ import annotations

import ast
import keyword
import re
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from bench.commands.console import say
from bench.commands.options import group
from bench.errors import OutputError, UsageError

app = group("Write a method, a data set or an adapter to start from.")

NewName = Annotated[str, typer.Argument(metavar="NAME", help="Letters, digits, - and _, for example my-method.")]

# Template -> file, both with the names that stand for the user's: my-x in results, my_x as a module, MyX as a class.
METHOD = {"method.py": "my_method.py", "test_method.py": "test_my_method.py"}
DATASET = {
    "card.yaml": "datasets/my-data.yaml",
    "write_dataset.py": "write_my_data.py",
    "test_dataset.py": "test_my_data.py",
}
ADAPTER = {
    "adapter.py": "my-format/my_format.py",
    "adapter_card.yaml": "my-format/my-format.yaml",
    "example_adapter.py": "my-format/example.py",
    "test_adapter.py": "my-format/test_my_format.py",
    "adapter_pyproject.toml": "my-format/pyproject.toml",
}


@app.command("method")
def new_method(name: NewName) -> None:
    """Write NAME.py with a working method, and a test."""
    _write(METHOD, "method", name)
    module, kind = _module(name), _class(name)
    say("it runs as it is; then change `segment`:")
    say(f"  fisheye-bench run tiny --method {module}:{kind}     12 images; rendered first, within a minute")
    say(f"  fisheye-bench run demo --method {module}:{kind}     20 drives")
    say(f"  pytest test_{module}.py")


@app.command("dataset")
def new_dataset(name: NewName) -> None:
    """Write datasets/NAME.yaml, a program that writes an example recording, and a test."""
    _write(DATASET, "data", name)
    called = _called(name)
    say("it runs as it is; then put your own readers into the program, and title, licence and caveats into the card:")
    say(f"  python write_{_module(name)}.py")
    say(f"  fisheye-bench validate {called}")
    say(f"  fisheye-bench run {called}")


@app.command("adapter")
def new_adapter(name: NewName) -> None:
    """Write NAME/: an adapter as a package, an example of its layout, a card, and a test."""
    _write(ADAPTER, "format", name)
    called, module = _called(name), _module(name)
    say("it runs as it is; then change the layout that it reads:")
    say(f"  cd {called} && python example.py")
    say(f"  fisheye-bench validate example --adapter {module}:recordings")
    say("  pip install -e .     so that cards may name it")
    say(f"  fisheye-bench run {called}.yaml --method nothing")


def _write(files: dict[str, str], stem: str, name: str) -> None:
    """Write templates under the user's name, all or none.

    Args:
        files: template -> file.
        stem: what follows "my" in the templates.
        name: as the user wrote it.

    Raises:
        UsageError: a name that cannot be one of a module, or that the files use for something else.
        OutputError: a file is there already.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,60}", name) or keyword.iskeyword(_module(name)):
        raise UsageError(f"expected a name of letters, digits, - and _ that begins with a letter, got {name!r}")
    if find_spec(_module(name)) is not None and not Path(f"{_module(name)}.py").exists():
        raise UsageError(f"{name!r} is the name of an installed package; take another one")
    folder = resources.files("bench.commands") / "templates"
    texts = {template: (folder / f"{template}.txt").read_text("utf-8") for template in files}
    named = {f"my-{stem}": _called(name), f"my_{stem}": _module(name), f"My{stem.title()}": _class(name)}
    taken = {word for template, text in texts.items() if template.endswith(".py") for word in _imported(text)}
    if {_class(name), _module(name).lower()} & (taken - named.keys()):
        raise UsageError(f"{name!r} names something that the new files import; take another one")

    def in_users_words(text: str) -> str:
        return re.sub("|".join(named), lambda found: named[found[0]], text)

    places = {template: Path(in_users_words(file)) for template, file in files.items()}
    for place in places.values():
        if place.exists():
            raise OutputError(place, got="a file that is there already", hint="take another name, or move it away")
    from bench.atomic import write_text

    for template, place in places.items():
        write_text(place, in_users_words(texts[template]))
        say(str(place))


def _imported(text: str) -> set[str]:
    """Names that a module imports, and the modules that it imports them from."""
    imports = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
    names = {alias.asname or alias.name for node in imports for alias in node.names}
    return names | {node.module for node in imports if isinstance(node, ast.ImportFrom) and node.module}


def _called(name: str) -> str:
    return name.replace("_", "-")


def _module(name: str) -> str:
    return name.replace("-", "_")


def _class(name: str) -> str:
    return "".join(word[0].upper() + word[1:] for word in re.split("[-_]+", name) if word)
