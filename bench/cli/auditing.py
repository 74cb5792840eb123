"""`audit`: how good the lidar reference is, and why a method misses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.audit import audit_sources, read_misses, read_polygons, run_audit
from bench.cli.computing import local_executor, parse_settings, render_if_synthetic
from bench.cli.console import print_failures, progress_bar, say, show
from bench.cli.interrupts import interruptible
from bench.evaluation import load_protocol
from bench.methods import build_method
from bench.methods.spherical.method import SphericalMethod
from bench.recordings import load_card
from bench.recordings.atomic import output_folder
from bench.reporting.audit_pictures import write_audit_files, write_cause_pictures, write_examples
from bench.reporting.audit_tables import to_rich

AUDITS = Path("reports/audit")


def audit(
    dataset: str,
    *,
    method: str,
    settings: Sequence[str],
    protocol: str,
    split: str | None,
    out: Path | None,
    recordings: int | None,
    workers: int | None,
    pictures: bool,
) -> int:
    """Audit, write tables and pictures, print the tables and the paths; return the number of failures."""
    card, rules = load_card(dataset), load_protocol(protocol)
    chosen = build_method(method, parse_settings(settings))
    folder = out or AUDITS / card.name
    left = "nothing of the audit is stored, and the same command begins it again"
    with output_folder(folder):
        render_if_synthetic(card)
        with interruptible(left), progress_bar(f"auditing {card.name}", "recordings") as report:
            found = run_audit(
                card,
                method=chosen,
                protocol=rules,
                out=folder,
                split=split,
                recordings=recordings,
                executor=local_executor(workers),
                progress=report,
            )
    files = list(write_audit_files(folder))
    if pictures:
        sources = {source.recorded.name: source for source in audit_sources(card, split=split, recordings=recordings)}
        handles = {name: source.recorded for name, source in sources.items()}
        files += write_examples(folder, found, read_polygons(folder), handles=handles, protocol=rules)
        if isinstance(chosen, SphericalMethod):
            files += write_cause_pictures(folder, read_misses(folder), sources=sources, method=chosen, protocol=rules)
    for table, note in to_rich(found):
        show(table)
        say(note, style="dim")
        say("")
    made = found.provenance
    stages = ", ".join(f"{name} {seconds:.1f}" for name, seconds in made.stage_seconds.items())
    say(f"{made.images} images of {found.recordings} recordings in {made.seconds:.1f} s ({stages})")
    if found.left_out:
        say(f"without exact flow: {found.left_out}")
    print_failures(found.failures, all_in="audit.json")
    for file in files:
        say(str(file))
    return len(found.failures)
