"""`new`: begin something of the user's own: files that run as they are, with the contract in their comments."""

from __future__ import annotations

import keyword
import re
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

import typer

from bench.commands.console import say
from bench.errors import OutputError, UsageError

Kind = Literal["method", "dataset", "adapter"]
STEMS: dict[Kind, str] = {"method": "method", "dataset": "data", "adapter": "format"}  # behind "my" in the templates

# Template -> file, both with the names that stand for the user's: my-x in results, my_x as a module, MyX as a class.
FILES = {
    "method": {"method.py": "my_method.py", "test_method.py": "test_my_method.py"},
    "data": {
        "card.yaml": "datasets/my-data.yaml",
        "write_dataset.py": "write_my_data.py",
        "test_dataset.py": "test_my_data.py",
    },
    "format": {
        "adapter.py": "my-format/my_format.py",
        "adapter_card.yaml": "my-format/my-format.yaml",
        "example_adapter.py": "my-format/example.py",
        "test_adapter.py": "my-format/test_my_format.py",
        "adapter_pyproject.toml": "my-format/pyproject.toml",
    },
}
THEN = {
    "method": ("fisheye-bench run tiny --method my_method:MyMethod", "pytest test_my_method.py"),
    "data": ("python write_my_data.py", "fisheye-bench validate my-data", "fisheye-bench run my-data"),
    "format": (
        "cd my-format && python example.py && pytest test_my_format.py",
        "pip install -e . && fisheye-bench run my-format.yaml --method nothing",
    ),
}


def new(
    kind: Annotated[Kind, typer.Argument(metavar="method|dataset|adapter")],
    name: Annotated[str, typer.Argument(metavar="NAME")],
) -> None:
    """Write a method, a data set or an adapter to start from, all files or none.

    A method is NAME.py with a test; a data set is datasets/NAME.yaml with a program that writes an example
    recording, and a test; an adapter is a package NAME/ with an example of its layout, a card and a test.

    Args:
        kind: what to write.
        name: letters, digits, - and _, such as my_method, my-data or my_format.

    Raises:
        UsageError: a name that cannot be one of a module, or that the files use for something else.
        OutputError: a file is there already.

    Examples:
        fisheye-bench new method my-method
        fisheye-bench new dataset my-data
        fisheye-bench new adapter my-format
    """
    from bench.atomic import write_text

    stem, dashed, module = STEMS[kind], name.replace("_", "-"), name.replace("-", "_")
    camel = "".join(word[0].upper() + word[1:] for word in re.split("[-_]+", name) if word)
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,60}", name) or keyword.iskeyword(module):
        raise UsageError(f"expected a name of letters, digits, - and _ that begins with a letter, got {name!r}")
    if find_spec(module) is not None and not Path(f"{module}.py").exists():
        raise UsageError(f"{name!r} is the name of an installed package; take another one")
    folder = resources.files("bench.commands") / "templates"
    texts = {file: (folder / f"{template}.txt").read_text("utf-8") for template, file in FILES[stem].items()}
    named = {f"my-{stem}": dashed, f"my_{stem}": module, f"My{stem.title()}": camel}
    imports = [line for text in texts.values() for line in text.splitlines() if "import " in line]
    if {camel, module.lower()} & ({word for line in imports for word in re.findall(r"\w+", line)} - named.keys()):
        raise UsageError(f"{name!r} names something that the new files import; take another one")

    def renamed(text: str) -> str:
        return re.sub("|".join(named), lambda word: named[word[0]], text)

    written = {Path(renamed(file)): renamed(text) for file, text in texts.items()}
    for place in written:
        if place.exists():
            raise OutputError(place, got="a file that is there already", hint="take another name, or move it away")
    for place, text in written.items():
        write_text(place, text)
        say(str(place))
    say("they run as they are; next:")
    for line in THEN[stem]:
        say(f"  {renamed(line)}")
