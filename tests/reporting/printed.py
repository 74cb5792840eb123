"""What a terminal shows of a report."""

import io

from rich.console import Console
from rich.text import Text

from bench.reporting.document import Table, to_terminal


def printed(blocks, *, width=110):
    console = Console(width=width, record=True, file=io.StringIO())
    for shown in to_terminal(blocks):
        console.print(shown, soft_wrap=isinstance(shown, Text), crop=False)
    return console.export_text()


def texts(table: Table) -> list[list[str]]:
    """The first lines of the cells of a table, row by row."""
    return [[cell.text for cell in row] for row in table.cells()]
