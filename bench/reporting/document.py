"""A report as a list of blocks, and its writers: terminal, Markdown, HTML; and CSV of its numbers.

A report is made once, of blocks, and `Report` writes all its files. All text in a block is text and no markup, wherever
it comes from: names, titles and messages from data files may hold anything. The writers escape it, here and nowhere
else. A page is one file: `page.html.j2` with `page.css` and `page.js`, which sorts, filters, folds and enlarges.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import jinja2
import pydantic_core
from markupsafe import Markup
from rich.box import SIMPLE_HEAD
from rich.table import Table as RichTable
from rich.text import Text

from bench.atomic import refuse_foreign, write_text
from bench.plain_text import escape_markdown, plain

if TYPE_CHECKING:
    import pandas as pd

Style = Literal["", "strong", "dim", "good", "warn", "bad"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """A share as a bar; all in [0, 1].

    Attributes:
        share: its length.
        interval: a line across it.
        tick: a mark across it, as of a ceiling.
        dot: draw the share as a dot on a line instead, as of a difference beside the tick of none.
    """

    share: float
    interval: tuple[float, float] | None = None
    tick: float | None = None
    dot: bool = False


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell that is more than one value.

    Attributes:
        text: the first line.
        below: further lines; Markdown, which has none, writes them behind the first.
        style: of the first line; on the terminal of all lines, but for "strong".
        bar: above the text, in HTML.
        link: address of the text, in HTML; ours, never one from outside.
    """

    text: str
    below: tuple[str, ...] = ()
    style: Style = ""
    bar: Bar | None = None
    link: str = ""


def as_text(value: object) -> str:
    """A value as text: "n/a" for NaN, few digits of other floats."""
    if isinstance(value, float):
        return "n/a" if math.isnan(value) else f"{value:g}"
    return str(value)


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table: its heading, and how its values are written; a `Cell` stays as it is, None is empty."""

    heading: str
    form: Callable[[Any], str | Cell] = as_text


Heads = Column | str
Tags = Mapping[str, str]  # what filters of a page find a row or a group by; "" is found by no choice


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Table:
    """A table.

    Attributes:
        columns: headings, as `Column` where values need a format of their own; by name, those of a frame to show.
        rows: as many values each, or a frame with as many columns.
        title: stands above it.
        note: how to read it, below it.
        words: how many columns from the left hold words; the others hold numbers.
        look: of HTML: "tiles" makes a card of each value, "about" a list of terms, "narrow" keeps it small.
        tags: of each row, by which a page's filters find it; none for no row at all.
    """

    columns: Sequence[Heads] | Mapping[str, Heads]
    rows: Sequence[Sequence[object]] | pd.DataFrame
    title: str = ""
    note: str = ""
    words: int = 1
    look: str = ""
    tags: Sequence[Tags] = ()

    def headings(self) -> list[str]:
        """Headings of the columns."""
        return [column.heading if isinstance(column, Column) else column for column in self._columns()]

    def cells(self) -> list[list[Cell]]:
        """The rows, every value written in the format of its column."""
        forms = [c.form if isinstance(c, Column) else as_text for c in self._columns()]
        if isinstance(self.rows, Sequence):
            rows: Iterable[Iterable[object]] = self.rows
        else:
            shown = self.rows[list(self.columns)] if isinstance(self.columns, Mapping) else self.rows
            rows = shown.itertuples(index=False)
        return [[self._cell(value, form) for value, form in zip(row, forms, strict=True)] for row in rows]

    @staticmethod
    def _cell(value: object, form: Callable[[Any], str | Cell]) -> Cell:
        shown = value if isinstance(value, Cell) else "" if value is None else form(value)
        return shown if isinstance(shown, Cell) else Cell(shown)

    def _columns(self) -> Sequence[Heads]:
        return [*self.columns.values()] if isinstance(self.columns, Mapping) else self.columns


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading, of level 1 to 6."""

    text: str
    level: int = 2


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph; "dim" is for notes and remarks."""

    text: str
    style: Style = ""


@dataclass(frozen=True, slots=True)
class Items:
    """A list."""

    texts: Sequence[str]


@dataclass(frozen=True, slots=True)
class Code:
    """Commands or other text of a program, lines as they are."""

    text: str


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture: its address, what it shows in words, a line below.

    The address is ours: `data:` on a page, which is one file; of Markdown, which leaves those out, a file beside it.
    """

    address: str
    text: str
    caption: str = ""


@dataclass(frozen=True, slots=True)
class Drawing:
    """A chart drawn in lines, on pages alone: an `<svg>` of our own making."""

    svg: Markup


Look = Literal["section", "folded", "box", "charts", "pairs", "boxes", ""]


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Blocks that stand together.

    Attributes:
        title: above them; of what is folded the line that opens it.
        blocks: they.
        look: on a page: "section" folds on a phone and is in the navigation, "folded" opens by its title, "box" has a
            frame, "charts", "pairs" and "boxes" stand side by side.
        name: to which links lead.
        tags: by which a page's filters find it.
    """

    blocks: Sequence[Block]
    title: str = ""
    look: Look = ""
    name: str = ""
    tags: Tags = field(default_factory=dict)


def section(name: str, title: str, blocks: Iterable[Block]) -> Group:
    """A section of a page."""
    return Group(look="section", name=name, title=title, blocks=list(blocks))


@dataclass(frozen=True, slots=True)
class Choice:
    """A filter of a page: hides the rows and groups whose tag is another; what has no such tag stays.

    Two choices of one tag show what either chooses.
    """

    tag: str
    label: str
    chosen: str = ""


@dataclass(frozen=True, slots=True)
class Filters:
    """The filters of a page, one for each, and a field to search the tagged rows."""

    choices: Sequence[Choice]
    search: str = ""


Block = Heading | Paragraph | Items | Code | Picture | Drawing | Table | Group | Filters


LONGEST_WORD = 30  # letters, as of the longest metric; longer words of a narrow table are broken
_RICH = {"": "", "strong": "bold", "dim": "dim", "good": "green", "warn": "yellow", "bad": "red"}


def to_terminal(blocks: Iterable[Block], *, clean: Callable[[str], str] = plain) -> Iterator[RichTable | Text]:
    """Convert to what a `rich` console prints, line by line and table by table.

    Args:
        blocks: headings, paragraphs, tables, code of one line; others are for pages and Markdown.
        clean: makes a line harmless, whatever it holds.
    """
    for block in blocks:
        match block:
            case Heading():
                yield Text(clean(block.text), style="bold")
            case Paragraph():
                yield Text(clean(block.text), style=_RICH[block.style])
            case Code():
                yield Text(f"  {clean(block.text)}")
            case Table():
                yield from (Text(clean(title), style="bold") for title in (block.title,) if title)
                yield _rich_table(block, clean)
                yield from (Text(line, style="dim") for line in (clean(block.note), "") if block.note)


def _rich_table(table: Table, clean: Callable[[str], str]) -> RichTable:
    """Columns of numbers are as wide as these, their headings wrap; a first word as the one above is left out."""
    rows, headings = table.cells(), table.headings()
    lines = any(cell.below for row in rows for cell in row)
    shown = RichTable(box=SIMPLE_HEAD, show_edge=False, padding=(0, int(not lines), int(lines), 0))
    for place, heading in enumerate(headings):
        of_words = place < table.words
        parts = [line for row in rows for line in (row[place].text, *row[place].below)]
        words = [word for part in (heading, *(parts if of_words else ())) for word in part.split()]
        least = min(max(map(len, words), default=1), LONGEST_WORD)
        least = least if of_words else max([least, *map(len, parts)])
        shown.add_column(
            Text(clean(heading)),
            justify="left" if of_words else "right",
            min_width=least,
            max_width=None if of_words else least,
            overflow="fold",
        )
    above = None
    for first, *others in rows:
        same = table.words > 1 and first == above
        shown.add_row(*(_rich_text(cell, clean) for cell in (Cell("") if same else first, *others)))
        above = first
    return shown


def _rich_text(cell: Cell, clean: Callable[[str], str]) -> Text:
    below = "".join(f"\n{clean(line)}" for line in cell.below)
    return Text(clean(cell.text), style=_RICH[cell.style]).append(below, style="not bold")


def to_markdown(blocks: Iterable[Block]) -> str:
    """GitHub's Markdown."""
    return "\n\n".join(filter(None, map(_markdown, blocks))) + "\n"


def _markdown(block: Block) -> str:
    match block:
        case Heading():
            return f"{'#' * block.level} {_markdown_text(block.text)}"
        case Paragraph():
            mark = {"strong": "**", "dim": "*"}.get(block.style, "")
            return f"{mark}{_markdown_text(block.text)}{mark}"
        case Items():
            return "\n".join(f"- {_markdown_text(text)}" for text in block.texts)
        case Code():
            fence = "`" * max(3, 1 + max(map(len, re.findall("`+", block.text)), default=0))
            return "\n".join([fence, *map(plain, block.text.splitlines()), fence])
        case Picture() if not block.address.startswith("data:"):
            shown = f"![{escape_markdown(block.text)}]({block.address})"
            return f"{shown}\n\n*{escape_markdown(block.caption)}*" if block.caption else shown
        case Group(look="folded"):
            inner = to_markdown(block.blocks)
            return f"<details><summary>{escape_markdown(block.title)}</summary>\n\n{inner}\n</details>"
        case Group():
            heading = [Heading(block.title, 2 if block.look == "section" else 3)] if block.title else []
            return to_markdown([*heading, *block.blocks]).rstrip("\n")
        case Drawing() | Filters() | Picture():
            return ""
        case Table():
            title = [f"**{escape_markdown(block.title)}**"] if block.title else []
            return "\n\n".join([*title, markdown_table(block), *([_markdown_text(block.note)] if block.note else [])])


def markdown_table(table: Table) -> str:
    """The table alone, its lines as wide as their content, so that a changed value changes one line."""
    rule = "|".join(":--" if place < table.words else "--:" for place in range(len(table.columns)))
    head = " | ".join(map(escape_markdown, table.headings()))
    body = [
        " | ".join("<br>".join(map(escape_markdown, (cell.text, *cell.below))) for cell in row) for row in table.cells()
    ]
    return "\n".join([f"| {head} |", f"|{rule}|", *(f"| {line} |" for line in body)])


def _markdown_text(text: str) -> str:
    """Text that stands alone, where marks at its start would make it a heading, a list or a quotation."""
    return re.sub(r"^\s*(\d*)([#>+=.)-])", r"\1\\\2", escape_markdown(text))


def to_html(blocks: Iterable[Block]) -> Markup:
    """A fragment of HTML for a page of `to_page`; lines of a cell are small below it, bars are drawn."""
    macros: Any = environment().get_template("page.html.j2").module
    parts = [
        getattr(macros, type(block).__name__.lower())(
            block, *([to_html(block.blocks)] if isinstance(block, Group) else ())
        )
        for block in blocks
    ]
    return Markup("").join(parts)


def to_page(title: str, blocks: Iterable[Block]) -> str:
    """A whole page of HTML in one file.

    Args:
        title: of the page.
        blocks: of the report; what comes before the first section stands above the navigation.
    """
    shown = list(blocks)
    sections = [block for block in shown if isinstance(block, Group) and block.look == "section"]
    head = shown[: shown.index(sections[0])] if sections else []
    macros: Any = environment().get_template("page.html.j2").module
    style, script = (Markup(resources.files("bench.reporting").joinpath(name).read_text("utf-8"))
                     for name in ("page.css", "page.js"))  # fmt: skip
    page: Markup = macros.page(title, to_html(head), sections, to_html(shown[len(head) :]), style, script)
    return str(page)


@cache
def environment() -> jinja2.Environment:
    """The template of pages, which escapes what it is given."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("bench.reporting", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        # HTML has no escape for control characters, as in a title; markup is a subclass of text and stays.
        finalize=lambda value: "\n".join(map(plain, value.split("\n"))) if type(value) is str else value,
    )


def to_json(content: Mapping[str, object]) -> str:
    """JSON with null for NaN and infinity."""
    return pydantic_core.to_json(content, indent=1, inf_nan_mode="null").decode() + "\n"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Report:
    """A report, told once: what people read of it and what programs do.

    Attributes:
        title: above the blocks; "" for none.
        blocks: what people read.
        numbers: lines of the CSV file, at full precision; empty for NaN and None.
        page: also write the blocks as a page.
    """

    title: str
    blocks: Sequence[Block]
    numbers: pd.DataFrame
    page: bool = False

    def write(self, folder: Path, name: str) -> tuple[Path, ...]:
        """Write `<name>.html`, `.md` and `.csv`, each whole or not at all; paths of those that it has.

        Raises:
            OutputError: a file cannot be written, or one of another kind is in its place.
        """
        heading = [Heading(self.title, 1)] if self.title else []
        page = {f"{name}.html": to_page(self.title, self.blocks)} if self.page else {}
        numbers = self.numbers.to_csv(index=False, lineterminator="\n")
        others = {f"{name}.md": to_markdown([*heading, *self.blocks]), f"{name}.csv": numbers}
        return write_together(folder, page | others)


def write_together(folder: Path, texts: Mapping[str, str]) -> tuple[Path, ...]:
    """Write files of one report by name, none where one of another kind is in the place of any; their paths.

    Markdown, which shows nothing of its kind, is taken for an earlier one where another of the files is there.

    Raises:
        OutputError: a file cannot be written, or one of another kind is in its place.
    """
    files = {folder / name: text for name, text in texts.items()}
    beside = any(file.is_file() for file in files if file.suffix != ".md")
    for file, text in files.items():
        if file.suffix != ".md":
            refuse_foreign(file, text)
        elif not beside:
            refuse_foreign(file)
    for file, text in files.items():
        write_text(file, text)
    return tuple(files)
