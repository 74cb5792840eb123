"""`perf`: where the time goes."""

from __future__ import annotations

from collections.abc import Sequence

from bench.cli.computing import parse_settings, render_if_synthetic
from bench.cli.console import progress_bar, say, show
from bench.evaluation import load_protocol
from bench.harness.perf import measure
from bench.methods import build_method
from bench.recordings import load_card, open_dataset
from bench.reporting.document import Column, Table


def perf(dataset: str, *, method: str, settings: Sequence[str], protocol: str, images: int) -> None:
    """Measure and print."""
    card = load_card(dataset)
    render_if_synthetic(card)
    with progress_bar("timing", "images") as report:
        found = measure(
            (handle.open() for handle in open_dataset(card)),
            method=build_method(method, parse_settings(settings)),
            protocol=load_protocol(protocol),
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
