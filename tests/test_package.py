"""The wheel finds its cards from any folder, while their data go elsewhere; statements about the project agree."""

import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml
from packaging.specifiers import SpecifierSet
from typer.testing import CliRunner

import bench
from bench.commands.app import DOCUMENTATION, app
from bench.evaluation import published

ROOT = Path(__file__).parents[1]
PROGRAM = """
import os, sys
from bench.recordings import load_card
from bench.recordings.cards import shipped_folder
card = load_card("demo")
assert card.file.is_relative_to(sys.argv[1]), card.file
assert card.scenario.is_file()
assert card.address == "demo", "the same on each machine"
assert (shipped_folder("baselines") / "demo" / "sums.csv").is_file()
print(card.root)
os.environ["FISHEYE_BENCH_DATA"] = "mine"
print(card.root)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The wheel, unpacked where no checkout is."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as content:
        content.extractall(folder / "site")
    return folder / "site"


def test_cards_baselines_and_templates_ship(installed):
    patterns = {
        "datasets": "*.yaml",
        "docs": "*.md",
        "reports/baselines": "*/*",
        "reports/leaderboard": "leaderboard.json",
    }
    for place, pattern in patterns.items():
        folder = installed / "bench/shipped" / Path(place).name
        shipped = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}
        assert shipped == {path.relative_to(ROOT / place) for path in (ROOT / place).glob(pattern)}
    help_text = run_in(installed, installed, "-m", "bench", "--help").replace("\n", " ")
    assert "offline in" in help_text
    own = {path.relative_to(ROOT) for path in (ROOT / "bench").rglob("*.*") if "__pycache__" not in path.parts}
    assert {path for path in own if not (installed / path).is_file()} == set()


def run_in(folder, installed, *arguments):
    """What Python prints where only the wheel is installed."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("FISHEYE_BENCH")}
    environment |= {"PYTHONPATH": str(installed), "XDG_CACHE_HOME": str(folder / "cache"), "HOME": str(folder)}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout


def test_data_of_shipped_cards_go_to_a_cache_folder(installed, tmp_path):
    cached, named = map(Path, run_in(tmp_path, installed, "-c", PROGRAM, str(installed)).split())
    assert cached.is_relative_to(tmp_path)  # on Linux in its cache, elsewhere in its Library
    assert (cached.name, named) == ("demo", Path("mine/demo"))
    assert not list(installed.rglob("data"))


def test_the_versions_of_python_that_ci_tries_are_promised_and_no_others():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    promised = SpecifierSet(project["requires-python"])
    tried = [f"3.{minor}" for minor in range(11, 15)]
    assert f"python: {str(tried).replace(chr(39), chr(34))}" in (ROOT / ".github/workflows/ci.yml").read_text()
    assert [*promised.filter(["3.10.9", *(f"{version}.0" for version in tried), "3.15.0"])] == [f"{v}.0" for v in tried]
    assert all(f"Programming Language :: Python :: {version}" in project["classifiers"] for version in tried)


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
