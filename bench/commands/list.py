"""`list`: the names that commands take, and what each stands for."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.commands.console import print_blocks, write_out
from bench.errors import UsageError
from bench.plain_text import counted

if TYPE_CHECKING:
    from bench.reporting.document import Table

What = Literal["datasets", "methods", "protocols", "formats"]


def command(
    what: Annotated[What | None, typer.Argument(metavar="datasets|methods|protocols|formats")] = None,
    schema: Annotated[str | None, typer.Option(metavar="KIND")] = None,
) -> None:
    """List the data sets, methods, protocols and formats that commands accept by name.

    Args:
        what: which list; default: all.
        schema: print the JSON Schema of a kind of file; `list formats` names the kinds.

    Examples:
        fisheye-bench list methods
        fisheye-bench list --schema card
    """
    if schema is not None:
        if what is not None:
            raise UsageError(f"--schema: expected no list beside it, got {what}")
        from bench.commands.schemas import json_schema

        write_out(json.dumps(json_schema(schema), indent=1, ensure_ascii=False))
        return
    lists = {"datasets": _datasets, "methods": _methods, "protocols": _protocols, "formats": _formats}
    for name in lists if what is None else (what,):
        print_blocks(lists[name]())


def _datasets() -> list[Table]:
    from bench.recordings import list_cards
    from bench.recordings.cards import card_folders
    from bench.reporting.document import Table

    folders = {place: list_cards(place) for place in card_folders()}
    cards = {card.file.stem: card for place in reversed(folders) for card in folders[place]}
    rows = [[name, cards[name].content.adapter, cards[name].content.licence, cards[name].content.title]
            for name in sorted(cards)]  # fmt: skip
    found = "; ".join(f"{place}: {counted(len(of_place), 'card')}" for place, of_place in folders.items())
    columns = ["name", "adapter", "licence", "what it is"]
    return [Table(title="Data sets", columns=columns, rows=rows, words=4, note=found)]


def _methods() -> list[Table]:
    from bench.harness.exact import scorable_methods
    from bench.methods import describe_method
    from bench.plug_ins import described
    from bench.reporting.document import Table

    rows = described(scorable_methods(), lambda _, target: describe_method(target))
    return [Table(title="Methods", columns=["name", "what it is"], rows=rows, words=2)]


def _protocols() -> list[Table]:
    from bench.evaluation.protocol import known_protocols, load_protocol
    from bench.records.reference import Category
    from bench.reporting.document import Table

    rows = []
    for name in known_protocols():
        rules = load_protocol(name).reference
        masks = rules.categories == (Category.MOVING,)  # which know neither range nor polygons
        range_, kind = ("any range", "masks") if masks else (f"{rules.range_limit_m:g} m", rules.polygon_kind)
        rows.append([name, range_, kind, ", ".join(rules.classes)])
    return [Table(title="Protocols", columns=["name", "objects within", "reference", "classes"], rows=rows, words=4)]


def _formats() -> list[Table]:
    from bench.annotation.formats.conversion import LABEL_FORMATS, label_format
    from bench.commands.schemas import SCHEMAS, json_schema
    from bench.plug_ins import described
    from bench.recordings.catalogue import describe_adapter, known_adapters
    from bench.reporting.document import Table

    adapters = described(known_adapters(), lambda _, target: describe_adapter(target))
    labels = described(LABEL_FORMATS, lambda name, _: label_format(name).description)
    schemas = [[name, json_schema(name)["description"].partition("\n")[0]] for name in SCHEMAS]
    heads = ["name", "what it is"]
    return [
        Table(title="Recordings: the adapter of a card", columns=heads, rows=adapters, words=2),
        Table(title="Labels: annotate import, export", columns=heads, rows=labels, words=2),
        Table(title="Files: --schema", columns=heads, rows=schemas, words=2),
    ]
