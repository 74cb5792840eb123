"""`schema`: JSON Schemas of files, by which editors complete and check them."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from bench.cli.console import show, write_out


def schema(
    name: Annotated[str | None, typer.Argument(help="Of the schema; default: list them.")] = None,
) -> None:
    """Print the JSON Schema of a kind of file, by which editors complete and check it."""
    from bench.api.schemas import SCHEMAS, json_schema
    from bench.reporting.document import Table

    if name is not None:
        write_out(json.dumps(json_schema(name), indent=1, ensure_ascii=False))
        return
    rows = [[one, json_schema(one)["description"].partition("\n")[0]] for one in SCHEMAS]
    show([Table(columns=["name", "what it is of"], rows=rows, words=2)])
