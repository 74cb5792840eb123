"""`croissant`: the description of a data set that catalogues and loaders of data sets read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.console import note, say
from bench.cli.options import Dataset


def croissant(
    dataset: Dataset,
    add: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="A property of schema.org's Dataset, as YAML; repeatable."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The file; default: croissant.json beside the data.")] = None,
) -> None:
    """Describe a data set in the native format by Croissant, for catalogues and loaders of data sets."""
    from bench.api.croissant import DEMANDED, FILE, as_json
    from bench.api.croissant import croissant as description
    from bench.atomic import write_output
    from bench.methods.settings import parse_settings
    from bench.recordings import load_card

    card = load_card(dataset)
    described = description(card, parse_settings(add, option="--add"))
    file = out or card.root / FILE
    write_output(file, as_json(described))
    say(str(file))
    if missing := [name for name in DEMANDED if name not in described]:
        note(f"catalogues also ask for {', '.join(missing)}; --add {missing[0]}=... writes it")
