"""`methods`: what can be scored."""

from __future__ import annotations

from bench.cli.console import show


def methods() -> None:
    """List the methods that can be scored."""
    from bench.harness import scorable_methods
    from bench.methods import describe_method
    from bench.plug_ins import described
    from bench.reporting.document import Table

    rows = described(scorable_methods(), lambda _, target: describe_method(target))
    show([Table(columns=["name", "what it is"], rows=rows, words=2)])
