"""CITATION.cff and the BibTeX of the docs name the paper and this software as the package does."""

import tomllib
from pathlib import Path

import yaml
from typer.testing import CliRunner

import bench
from bench.commands.app import DOCUMENTATION, app
from bench.evaluation import published

ROOT = Path(__file__).parents[1]


def test_the_file_for_code_hosts_names_the_paper_and_this_version():
    stated = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    paper = stated["preferred-citation"]
    assert (paper["title"], paper["year"], stated["version"]) == (published.TITLE, published.YEAR, bench.__version__)
    assert tuple((author["family-names"], author["given-names"]) for author in paper["authors"]) == published.AUTHORS


def test_everything_names_one_repository():
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["urls"]
    home = urls["Homepage"]
    assert all(url.startswith(home) for url in urls.values())
    assert urls["Documentation"] == DOCUMENTATION
    assert f"Documentation: {DOCUMENTATION}" in CliRunner().invoke(app, ["--help"]).output.replace("\n", " ")
    for name in ("CITATION.cff", "mkdocs.yml", "docs/results.md", "docs/gate.md", "CONTRIBUTING.md"):
        assert home.removeprefix("https://github.com/") in (ROOT / name).read_text("utf-8"), name


def test_the_bibtex_names_the_same():
    page = (ROOT / "docs/results.md").read_text("utf-8")
    version = f"Version {bench.__version__}, Apache License 2.0"
    assert all(part in page for part in (f"{{{{{published.TITLE}}}}}", f"year = {{{published.YEAR}}}", version))
