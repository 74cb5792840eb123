"""The wheel: what it holds, and that its cards are found from any folder while their data go elsewhere."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROGRAM = """
import os
import sys
from bench.recordings import load_card
from bench.recordings.cards import shipped_folder
card = load_card("demo")
assert card.file.is_relative_to(sys.argv[1]), card.file
assert card.scenario.is_file()
assert (shipped_folder("baselines") / "demo.json").is_file()
print(card.root)
os.environ["FISHEYE_BENCH_DATA"] = "mine"
print(card.root)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The wheel, unpacked where no checkout is."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as content:
        content.extractall(folder / "site")
    return folder / "site"


def test_cards_baselines_and_templates_ship(installed):
    for place, pattern in (("datasets", "*.yaml"), ("reports/baselines", "*.json")):
        shipped = {path.name for path in (installed / "bench/shipped" / Path(place).name).iterdir()}
        assert shipped == {path.name for path in (ROOT / place).glob(pattern)}
    own = {path.relative_to(ROOT) for path in (ROOT / "bench").rglob("*.*") if "__pycache__" not in path.parts}
    assert {path for path in own if not (installed / path).is_file()} == set()


def test_data_of_shipped_cards_go_to_a_cache_folder(installed, tmp_path):
    environment = {name: value for name, value in os.environ.items() if not name.startswith("FISHEYE_BENCH")}
    environment |= {"PYTHONPATH": str(installed), "XDG_CACHE_HOME": str(tmp_path / "cache"), "HOME": str(tmp_path)}
    command = [sys.executable, "-c", PROGRAM, str(installed)]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    cached, named = map(Path, done.stdout.split())
    assert cached.is_relative_to(tmp_path)  # on Linux in its cache, elsewhere in its Library
    assert cached.name == "demo"
    assert named == Path("mine/demo")
    assert not list(installed.rglob("data"))
