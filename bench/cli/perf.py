"""`perf`: where the time goes."""

from __future__ import annotations

from typing import Annotated

import typer

from bench.cli import options
from bench.cli.console import say, show
from bench.cli.progress import progress_bar


def perf(
    dataset: options.Dataset = "demo",
    method: options.MethodName = "spherical",
    set_: options.Settings = None,
    protocol: options.ProtocolName = "paper-v1",
    images: Annotated[int, typer.Option(help="Images to time.")] = 200,
) -> None:
    """Time every stage, and the whole against its Farnebäck call alone in the same run."""
    from bench.cli.request import rendered_card
    from bench.evaluation import load_protocol
    from bench.harness.perf import measure
    from bench.methods import build_method
    from bench.methods.settings import parse_settings
    from bench.recordings import open_dataset
    from bench.reporting.document import Column, Table

    built, rules = build_method(method, parse_settings(set_)), load_protocol(protocol)
    card = rendered_card(dataset)
    with progress_bar("timing", "images") as report:
        found = measure(
            (handle.open() for handle in open_dataset(card)),
            method=built,
            protocol=rules,
            images=images,
            progress=report,
        )
    stages = {**found.stage_ms, "whole": found.total_ms, "Farnebäck alone": found.flow_ms}
    columns: list[Column | str] = [
        "stage",
        Column("ms per image", "{:.2f}".format),
        Column("of Farnebäck", "{:.3f}".format),
    ]
    show([Table(columns=columns, rows=[[name, ms, ms / found.flow_ms] for name, ms in stages.items()])])
    say(f"{found.images} images; whole / Farnebäck alone = {found.ratio:.3f}")
