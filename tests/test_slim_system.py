"""A system without libEGL, libGL and libX11, on which open3d does not load: every command but one works."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bench.lidar.files import FORMATS
from bench.synthesis import rays
from tests.support.clouds import write_points

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not rays.EMBREEX, reason="where embreex has no wheel, rays are cast by open3d"),
]
MISSING = "libEGL.so.1: cannot open shared object file: No such file or directory"


@pytest.fixture
def slim(tmp_path):
    """Environment of processes, and of all that they start, in which open3d fails as it does without its libraries."""
    (tmp_path / "open3d.py").write_text(f"raise ImportError({MISSING!r})\n")
    return {**os.environ, "PYTHONPATH": str(tmp_path)}


CALLS = """
import json, sys
from bench.commands.app import main
for words in json.loads(sys.argv[1]):
    sys.argv[:] = ["fisheye-bench", *words]
    try:
        main()
    except SystemExit as ended:
        assert not ended.code, words
"""


def test_every_command_works_without_the_libraries_of_open3d(slim, tmp_path):
    datasets = tmp_path / "datasets"
    datasets.mkdir()
    for name in ("tiny.yaml", "tiny.scenario.yaml"):
        shutil.copy(Path(__file__).parents[1] / "datasets" / name, datasets)
    card, run = datasets / "tiny.yaml", tmp_path / "run"
    drive = ("--dataset", card, "--recording", "standing")
    calls = [("run", card, "--out", run, "--workers", 2), ("validate", card)]
    for tool in ("boxes", "openlabel"):
        made = tmp_path / tool
        calls.append(("annotate", "export", card, "--annotated", "--format", tool, "--out", made))
        calls.append(("annotate", "import", tool, made / "standing", *drive, "--out", tmp_path / "labels" / tool))
    calls += [
        ("report", run),
        ("gate", run, "--baseline", tmp_path / "baseline", "--update"),
        ("compare", run, run, "--out", tmp_path / "compare"),
        ("leaderboard", tmp_path, "--out", tmp_path / "leaderboard"),
        ("audit", card, "--out", tmp_path / "audit"),
        ("view", card, "--recording", "standing", "--frame", 1, "--out", tmp_path / "views"),
    ]
    words = json.dumps([[str(word) for word in words] for words in calls])
    subprocess.run([sys.executable, "-c", CALLS, words], cwd=tmp_path, env=slim, check=True)
    assert len([*(tmp_path / "labels").glob("*/*.json")]) == 2


def test_clouds_are_read_without_it(slim, tmp_path):
    points = np.random.default_rng(3).normal(size=(50, 3)).astype(np.float32)
    paths = [tmp_path / f"a{suffix}" for suffix in FORMATS]
    for path in paths:
        write_points(path, {"points_lidar": points})
    reads = "import sys; from pathlib import Path; from bench.lidar.files import read_points\n"
    reads += "for path in sys.argv[1:]: assert len(read_points(Path(path))['points_lidar']) == 50"
    subprocess.run([sys.executable, "-c", reads, *paths], env=slim, check=True)


def test_the_libraries_that_messages_ask_for_are_those_of_the_documentation():
    text = (Path(__file__).parents[1] / "docs" / "start.md").read_text()
    asked = re.search(r"apt-get install [a-z0-9 -]+", Path(rays.__file__).read_text())
    assert asked.group().strip() in text
