"""The wheel: what it holds, and that its cards are found from any folder while their data go elsewhere."""

import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]
PROGRAM = """
import os, sys
from bench.recordings import load_card
card = load_card("demo")
assert card.file.is_relative_to(sys.argv[1]), card.file
assert card.scenario.is_file()
assert card.address == "demo", "the same on each machine"
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
    patterns = {"datasets": "*.yaml", "reports/baselines": "*/*", "reports/leaderboard": "leaderboard.json"}
    for place, pattern in patterns.items():
        folder = installed / "bench/shipped" / Path(place).name
        shipped = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}
        assert shipped == {path.relative_to(ROOT / place) for path in (ROOT / place).glob(pattern)}
    own = {path.relative_to(ROOT) for path in (ROOT / "bench").rglob("*.*") if "__pycache__" not in path.parts}
    assert {path for path in own if not (installed / path).is_file()} == set()


def test_data_of_shipped_cards_go_to_a_cache_folder(installed, tmp_path):
    environment = {name: value for name, value in os.environ.items() if not name.startswith("FISHEYE_BENCH")}
    environment |= {"PYTHONPATH": str(installed), "XDG_CACHE_HOME": str(tmp_path / "cache"), "HOME": str(tmp_path)}
    command = [sys.executable, "-c", PROGRAM, str(installed)]
    printed = subprocess.run(
        command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True, check=True
    ).stdout
    cached, named = map(Path, printed.split())
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
