"""`perf`: where the time goes."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from bench.cli.computing import parse_settings, render_if_synthetic
from bench.cli.console import progress_bar, say, show
from bench.evaluation import load_protocol
from bench.harness.perf import measure
from bench.methods import build_method
from bench.recordings import load_card, open_dataset


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
    table = Table("stage", "ms per image", "of Farnebäck", box=None)
    rows = {**found.stage_ms, "whole": found.total_ms, "Farnebäck alone": found.flow_ms}
    for name, milliseconds in rows.items():
        table.add_row(name, f"{milliseconds:.2f}", f"{milliseconds / found.flow_ms:.3f}")
    show(table)
    say(f"{found.images} images; whole / Farnebäck alone = {found.ratio:.3f}")
