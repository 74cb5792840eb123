"""What a terminal shows of a report."""

import io

from rich.console import Console
from rich.text import Text

from bench.reporting.document import to_terminal


def printed(blocks, *, width=110):
    console = Console(width=width, record=True, file=io.StringIO())
    for shown in to_terminal(blocks):
        console.print(shown, soft_wrap=isinstance(shown, Text))
    return console.export_text()
