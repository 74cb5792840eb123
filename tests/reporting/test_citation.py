"""BibTeX and CITATION.cff name the same paper and the same software."""

from pathlib import Path

import yaml

import bench
from bench.cli.console import write_out
from bench.evaluation import published
from bench.reporting.citation import CONTRIBUTORS, bibtex

CITATION = Path(__file__).parents[2] / "CITATION.cff"


def test_the_file_for_code_hosts_says_the_same(capsys):
    stated = yaml.safe_load(CITATION.read_text("utf-8"))
    paper = stated["preferred-citation"]
    assert (paper["title"], paper["year"]) == (published.TITLE, published.YEAR)
    authors = tuple((author["family-names"], author["given-names"]) for author in paper["authors"])
    assert authors == published.AUTHORS
    assert stated["version"] == bench.__version__
    assert [author["name"] for author in stated["authors"]] == [CONTRIBUTORS]
    write_out(bibtex())
    shown = capsys.readouterr().out
    assert shown.isascii()
    assert shown.strip() == bibtex().strip()
    assert shown.count("@misc{") == shown.count("  year = ") == 2
    assert paper["type"] == "generic", "which is @misc: no journal is known"
    assert r"Mariotti, Letizia and Eising, Ciar{\'a}n" in shown
    assert f"Version {bench.__version__}" in shown
