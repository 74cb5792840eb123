"""Hooks of mkdocs: the README is the landing page, commands, functions, options and schemas are made from the code,
notebooks become pages with what they show, and committed files that pages link to are copied.

Pages link to committed files outside of `docs/` by relative paths, which work on a code host. In the site these files
lie under the same names below the root of the site.
"""

from __future__ import annotations

import ast
import inspect
import io
import json
import os
import re
import sys
from collections.abc import Iterator
from contextlib import chdir, redirect_stdout
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, get_args, get_origin
from unittest.mock import patch

import matplotlib.pyplot as plt
import typer
import typer.main

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
import bench  # noqa: E402 - of this checkout, wherever mkdocs is started
from bench.commands.app import app  # noqa: E402
from bench.commands.schemas import OPTIONS, SCHEMAS, json_schema  # noqa: E402

LINK = re.compile(r"(\]\()([^)#\s]+)([^)\s]*\))")
FENCE = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
MARKER = "<!-- the commands, filled in by docs/hooks.py -->"
SCHEMAS_MARKER = "<!-- the schemas, filled in by docs/hooks.py -->"
FUNCTIONS_MARKER = "<!-- the functions, filled in by docs/hooks.py -->"
OPTIONS_MARKER = "<!-- the options, filled in by docs/hooks.py -->"
LANDING, LANDING_SOURCE = "index.md", ROOT / "README.md"


def commands() -> Iterator[tuple[str, Any]]:
    """Every command with its full name, for example `annotate import`, single commands first."""

    def below(group: Any, before: str) -> Iterator[tuple[str, Any]]:
        for name, command in group.commands.items():
            if hasattr(command, "commands"):
                yield from below(command, f"{before}{name} ")
            else:
                yield f"{before}{name}", command

    yield from below(typer.main.get_command(app), "")


def command_reference() -> str:
    """The reference of all commands as Markdown: one section each, with usage, arguments and options."""
    return "\n".join(line for name, command in commands() for line in _section(name, command))


def _section(name: str, command: Any) -> Iterator[str]:
    arguments = [one for one in command.params if one.param_type_name == "argument"]
    options = [one for one in command.params if one.param_type_name == "option" and "--help" not in one.opts]
    usage = " ".join([f"fisheye-bench {name}", *("[OPTIONS]" for _ in options[:1]), *map(_metavar, arguments)])
    yield from (f"## {name}", "", f"```\n{usage}\n```", "", command.help.replace("<", "&lt;"), "")
    yield from ("```", *command.epilog.splitlines()[3:], "```", "")
    rows = [(f"`{_metavar(one)}`", one) for one in arguments] + [(_flags(one), one) for one in options]
    if rows:
        yield from ("| | | default |", "|---|---|---|")
        yield from (f"| {shown} | {_cell(one.help)} | {_default(one)} |" for shown, one in rows)
        yield ""


def function_reference() -> str:
    """The functions of `bench` as a Markdown table, each with what it returns and the first line of its docstring."""
    rows = ["| function | |", "|---|---|"]
    for name in bench.__all__:
        function = getattr(bench, name)
        if inspect.isfunction(function):
            returns = re.sub(r"\b(?:\w+\.)+", "", str(inspect.signature(function).return_annotation))
            text = (inspect.getdoc(function) or "").splitlines()[0]
            rows.append(f"| `bench.{name}` | {_cell(text)} Returns `{_cell(returns)}`. |")
    return "\n".join(rows)


def option_reference() -> str:
    """The options of every adapter as a Markdown table, from the schema of cards."""
    models = json_schema("card")["$defs"]
    rows = ["| adapter: option | |", "|---|---|"]
    for adapter, model in OPTIONS.items():
        for option, field in models[model.__name__]["properties"].items():
            rows.append(f"| {adapter}: `{option}` | {_cell(field.get('description'))} |")
    return "\n".join(rows)


def _metavar(argument: Any) -> str:
    shown = argument.metavar or argument.name.upper()
    shown = f"{shown}..." if argument.nargs == -1 else shown
    return shown if argument.required else f"[{shown}]"


def _flags(option: Any) -> str:
    value = "" if getattr(option, "is_bool_flag", False) else f" {option.metavar or _value(option)}"
    names = f"`{', '.join(option.opts)}{value}`"
    return _cell(f"{names}, `{', '.join(option.secondary_opts)}`" if option.secondary_opts else names)


def _value(option: Any) -> str:
    """What an option takes: the words of a `Literal`, else its name."""
    kind = getattr(getattr(option, "type_descriptor", None), "annotation", None)
    words = get_args(kind) if get_origin(kind) is Literal else ()
    return "|".join(words) or option.opts[0].lstrip("-").replace("-", "_").upper()


def _default(one: Any) -> str:
    if one.required:
        return "required"
    if isinstance(one.default, bool):
        return f"`{one.opts[0]}`" if one.default else ""
    return "" if one.default in (None, ()) else f"`{one.default}`"


def _cell(text: str | None) -> str:
    return (text or "").replace("<", "&lt;").replace("|", "\\|")


@cache
def _rendered() -> TemporaryDirectory[str]:
    """Where notebooks render data sets, each once for all of them."""
    return TemporaryDirectory()


@cache
def notebook_page(file: Path) -> tuple[str, dict[str, bytes]]:
    """A notebook's text, code and outputs as Markdown, and its pictures (PNG) by name; its cells run for that."""
    cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(file.read_text("utf-8"))["cells"]]
    shown: list[str] = []
    pictures: dict[str, bytes] = {}

    def keep(*_: object) -> None:
        name, picture = f"{file.stem}-{len(pictures) + 1}.png", io.BytesIO()
        plt.savefig(picture, format="png", dpi=100, bbox_inches="tight")
        plt.close()
        pictures[name] = picture.getvalue()

    backend, names = plt.get_backend(), {"__name__": "__main__"}
    plt.switch_backend("agg")
    with TemporaryDirectory() as folder, chdir(folder), patch.object(plt, "show", keep), patch.dict(os.environ):
        os.environ |= {"FISHEYE_BENCH_DATA": _rendered().name, "FISHEYE_BENCH_DATASETS": str(ROOT / "datasets")}
        for kind, text in cells:
            if kind != "code":
                shown.append(text)
                continue
            before = len(pictures)
            printed = _output(text, names)
            shown.append(f"```python\n{text}\n```")
            shown += [f"```text\n{printed}\n```"] if printed else []
            shown += [f"![Drawn by the cell above]({name})" for name in list(pictures)[before:]]
    plt.switch_backend(backend)
    return "\n\n".join([*shown, f"This page is the notebook [{file.name}]({file.name})."]) + "\n", pictures


def _output(code: str, names: dict[str, Any]) -> str:
    """Run a cell; return what it prints, and the value of its last line if that is an expression."""
    program = ast.parse(code)
    last = program.body.pop() if isinstance(program.body[-1], ast.Expr) else None
    with redirect_stdout(io.StringIO()) as printed:
        exec(compile(program, "cell", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names) if isinstance(last, ast.Expr) else None
        if value is not None:
            sys.stdout.write(str(value))
    return printed.getvalue().rstrip()


def on_files(files: Any, config: Any) -> Any:
    """Add a page for each notebook, the schemas, committed files that pages link to, and those that these link to."""
    from mkdocs.structure.files import File

    for name in SCHEMAS:
        content = json.dumps(json_schema(name), indent=1, ensure_ascii=False) + "\n"
        files.append(File.generated(config, f"schemas/{name}.json", content=content))
    for notebook in sorted((ROOT / "docs").glob("*.ipynb")):
        page, pictures = notebook_page(notebook)
        files.append(File.generated(config, f"{notebook.stem}.md", content=page))
        for name, picture in pictures.items():
            files.append(File.generated(config, name, content=picture))
    files.append(File.generated(config, LANDING, content=LANDING_SOURCE.read_text("utf-8")))
    waiting = [page for file in files.documentation_pages() if (page := ROOT / "docs" / file.src_uri).is_file()]
    waiting.append(LANDING_SOURCE)
    while waiting:
        page = waiting.pop()
        for target in _linked(page):
            name = target.relative_to(ROOT).as_posix()
            if not name.startswith("docs/") and target != LANDING_SOURCE and files.get_file_from_path(name) is None:
                files.append(File(name, str(ROOT), config.site_dir, config.use_directory_urls))
                waiting += [target] if target.suffix == ".md" else []
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Fill in what is made from the code, and point links at where the files lie in the site."""
    for marker, content in (
        (MARKER, command_reference),
        (FUNCTIONS_MARKER, function_reference),
        (OPTIONS_MARKER, option_reference),
        (SCHEMAS_MARKER, _schema_links),
    ):
        if marker in markdown:
            markdown = markdown.replace(marker, content())
    source = ROOT / page.file.src_uri
    source = source if source.is_file() and page.file.src_dir == str(ROOT) else ROOT / "docs" / page.file.src_uri
    source = LANDING_SOURCE if page.file.src_uri == LANDING else source
    here = Path(page.file.src_uri).parent

    def in_site(link: re.Match[str]) -> str:
        target = (source.parent / link[2]).resolve()
        if "://" in link[2] or not target.is_file():
            return link[0]
        name = LANDING if target == LANDING_SOURCE else target.relative_to(ROOT).as_posix().removeprefix("docs/")
        if target.suffix == ".ipynb" and target.stem != Path(page.file.src_uri).stem:
            name = Path(name).with_suffix(".md").as_posix()
        return f"{link[1]}{Path(os.path.relpath(name, here)).as_posix()}{link[3]}"

    return LINK.sub(in_site, markdown)


def _schema_links() -> str:
    return f"Here they are: {', '.join(f'[{name}](schemas/{name}.json)' for name in SCHEMAS)}."


def _linked(page: Path) -> Iterator[Path]:
    for _, link, _ in LINK.findall(FENCE.sub("", page.read_text("utf-8"))):
        target = (page.parent / link).resolve()
        if "://" not in link and target.is_file():
            yield target
