"""A system without libEGL, libGL and libX11, on which open3d does not load: every command but one works."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bench.lidar import cloud_files
from bench.synthesis.rays import EMBREEX
from tests.support.clouds import write_points

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not EMBREEX, reason="where embreex has no wheel, rays are cast by open3d"),
]
MISSING = "libEGL.so.1: cannot open shared object file: No such file or directory"


@pytest.fixture(scope="module")
def slim(tmp_path_factory):
    """Environment of processes, and of all that they start, in which open3d fails as it does without its libraries."""
    folder = tmp_path_factory.mktemp("slim")
    (folder / "open3d").mkdir()
    (folder / "open3d" / "__init__.py").write_text(f"raise ImportError({MISSING!r})\n")
    return {**os.environ, "PYTHONPATH": str(folder)}


def call(environment, *words, cwd):
    """Run `fisheye-bench` as its users do."""
    command = [sys.executable, "-m", "bench", *map(str, words)]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


def test_every_command_works_without_the_libraries_of_open3d(slim, tmp_path):
    datasets = tmp_path / "datasets"
    datasets.mkdir()
    for name in ("tiny.yaml", "tiny.scenario.yaml"):
        shutil.copy(Path(__file__).parents[1] / "datasets" / name, datasets)
    card, run, baseline = datasets / "tiny.yaml", tmp_path / "run", tmp_path / "baseline.json"
    drive = ("--dataset", card, "--recording", "standing")
    for words in (
        ("run", card, "--out", run, "--workers", 2),
        ("validate", card),
        ("annotations", "export", "semantickitti", *drive, "--out", tmp_path / "kitti"),
        (
            "annotations",
            "import",
            "semantickitti",
            tmp_path / "kitti" / "standing",
            *drive,
            "--out",
            tmp_path / "labels",
        ),
        ("annotations", "export", "openlabel", *drive, "--out", tmp_path / "openlabel"),
        (
            "annotations",
            "import",
            "openlabel",
            tmp_path / "openlabel" / "standing",
            *drive,
            "--out",
            tmp_path / "labels",
        ),
        ("report", run),
        ("gate", run, "--baseline", baseline, "--update", "--allow-dirty"),
        ("gate", run, "--baseline", baseline),
        ("compare", run, run, "--out", tmp_path / "compare"),
        ("leaderboard", tmp_path, "--out", tmp_path / "leaderboard"),
        ("audit", card, "--out", tmp_path / "audit"),
        ("view", card, "--recording", "standing", "--frame", 1, "--out", tmp_path / "views"),
    ):
        done = call(slim, *words, cwd=tmp_path)
        judged_nothing = words[0] == "gate" and "--update" not in words  # three recordings are too few for a verdict
        assert done.returncode == (3 if judged_nothing else 0), f"{words}\n{done.stdout}\n{done.stderr}"
    assert list((tmp_path / "labels").glob("*.json"))


def test_clouds_are_read_without_it_and_only_compressed_points_ask_for_the_libraries(slim, tmp_path):
    points = np.random.default_rng(3).normal(size=(50, 3)).astype(np.float32)
    for name in ("a.npz", "a.bin", "a.pcd", "a.ply", "a.laz"):
        write_points(tmp_path / name, {"points_lidar": points})
    header = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 50\nHEIGHT 1\nPOINTS 50\n"
    body = np.array([8, 600], dtype="<u4").tobytes() + bytes(8)
    (tmp_path / "c.pcd").write_bytes(header.encode() + b"DATA binary_compressed\n" + body)
    program = (
        "import sys; from pathlib import Path; from bench.lidar import read_points\n"
        "for path in sys.argv[1:]: print(len(read_points(Path(path))['points_lidar']))"
    )
    read = [sys.executable, "-c", program]
    paths = [str(tmp_path / name) for name in ("a.npz", "a.bin", "a.pcd", "a.ply", "a.laz")]
    done = subprocess.run([*read, *paths], env=slim, capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["50"] * 5, done.stderr
    done = subprocess.run([*read, str(tmp_path / "c.pcd")], env=slim, capture_output=True, text=True, check=False)
    assert "libEGL" in done.stderr
    assert "apt-get install" in done.stderr


def test_the_libraries_that_messages_ask_for_are_those_of_the_documentation():
    text = (Path(__file__).parents[1] / "docs" / "index.md").read_text()
    asked = re.search(r"apt-get install [a-z0-9 -]+", Path(cloud_files.__file__).read_text())
    assert asked.group().strip() in text
