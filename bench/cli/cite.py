"""`cite`: how to cite the paper and this software."""

from __future__ import annotations

from bench.cli.console import write_out


def cite() -> None:
    """Print BibTeX for the paper and for this software."""
    from bench.reporting.citation import bibtex

    write_out(bibtex())
