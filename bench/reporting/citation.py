"""Citation of the paper and this software, as BibTeX; CITATION.cff says the same for code hosts."""

from __future__ import annotations

import bench
from bench.evaluation import published
from bench.reporting.document import escape_latex

SOFTWARE = "fisheye-bench: benchmark of moving-object segmentation in automotive fisheye images"
YEAR = 2026  # of this version
NO_VENUE = "The manuscript names no journal and no DOI: add both from the publisher's page."
CONTRIBUTORS = "The fisheye-bench contributors"


def bibtex() -> str:
    """Two entries, for every style of BibTeX: the paper, for method and evaluation, and the software.

    The journal of the paper is not stated, and a line above the entry says so: the manuscript that this project follows
    names none. Nor does this project state an address of its own.
    """
    authors = " and ".join(f"{family}, {given}" for family, given in published.AUTHORS)
    paper = {"author": _ascii(authors), "title": f"{{{published.TITLE}}}", "year": str(published.YEAR)}
    software = {
        "author": f"{{{CONTRIBUTORS}}}",
        "title": f"{{{SOFTWARE}}}",
        "year": str(YEAR),
        "note": f"Version {escape_latex(bench.__version__)}, Apache License 2.0",
    }
    key = f"{published.AUTHORS[0][0].lower()}{published.YEAR}spherical"
    return f"{NO_VENUE}\n{_entry(key, paper)}\n\n{_entry('fisheye-bench', software)}\n"


def _entry(key: str, fields: dict[str, str]) -> str:
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items()]
    return "\n".join([f"@misc{{{key},", *lines, "}"])


def _ascii(names: str) -> str:
    r"""Letters that old styles of BibTeX cannot sort, as LaTeX writes them: "\'a" for "á"."""
    return names.replace("á", r"{\'a}")
