"""Every kind of file that adapters read, spoiled in every way we know: a `DataError` that names the file."""

import subprocess
import sys

import pytest

from bench.errors import DataError
from bench.lidar.files import read_sweep
from bench.plain_yaml import parse_yaml
from bench.recordings import load_card
from tests.hostile import files
from tests.support.limits import at_most

pytestmark = pytest.mark.slow

TWICE = {
    "a: 1\nb: 2\na: 3\n": "line 3: expected each key once, got 'a' again, as in line 1",
    "x:\n  - {a: 1, a: 1}\n": "line 2: expected each key once, got 'a' again, as in line 2",
    "x: &x {a: 1}\ny: *x\nz: {b: {c: 1, 'c': 2}}\n": "line 3: expected each key once, got 'c' again, as in line 3",
}


@pytest.mark.parametrize("text", TWICE)
def test_keys_that_stand_twice_in_yaml(text):
    with pytest.raises(DataError) as caught:
        parse_yaml(text, file="card.yaml")
    assert str(caught.value) == f"card.yaml: {TWICE[text]}"
    assert parse_yaml("a: {k: 1}\nb: {k: 1}\n1: x\n'1': y\n", file="card.yaml")["b"] == {"k": 1}
    text = "front: &lens {k: [1, 2]}\nrear: *lens\nleft: {<<: *lens, w: 3}\n"  # references that are meant well
    assert parse_yaml(text, file="x") == {"front": {"k": [1, 2]}, "rear": {"k": [1, 2]}, "left": {"k": [1, 2], "w": 3}}


@pytest.mark.parametrize("what", files.NO_FILES)
def test_nothing_waits_for_a_cloud_that_is_no_file(tmp_path, what):
    files.NO_FILES[what](tmp_path / "1000.pcd")
    with at_most(60), pytest.raises(DataError, match=r"1000\.pcd: expected a point-cloud file, got no such file"):
        read_sweep(tmp_path / "1000.pcd", 1000)


READ_UNDER_A_LIMIT = """
import resource, sys
from pathlib import Path
from bench.errors import DataError
from bench.lidar.files import read_sweep
resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
for path in sorted(Path(sys.argv[1]).iterdir()):
    try:
        read_sweep(path, 1000)
    except DataError as error:
        print(error, flush=True)
"""


def test_no_cloud_of_lies_is_read_or_takes_the_memory_that_it_speaks_of(tmp_path):
    """A decompressor that cannot get its memory aborts the whole process."""
    for suffix, kinds in files.CLOUDS.items():
        for what, content in kinds.items():
            (tmp_path / f"{what}{suffix}").write_bytes(content() if callable(content) else content)
    paths = sorted(tmp_path.iterdir())
    command = [sys.executable, "-W", "error", "-W", "ignore::ResourceWarning", "-c", READ_UNDER_A_LIMIT, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    for path, line in zip(paths, done.stdout.splitlines(), strict=True):
        assert line.startswith(f"{path}: ")
        assert len(line) < 1000
    assert sorted(tmp_path.iterdir()) == paths


@pytest.mark.parametrize("what", files.YAML_FILES)
def test_yaml(tmp_path, monkeypatch, what):
    monkeypatch.chdir(tmp_path)
    content = files.YAML_FILES[what]
    path = tmp_path / "x.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(DataError) as caught:
        load_card(path)
    line = str(caught.value)
    assert str(path) in line
    assert line.isprintable()
    assert len(line) < 2000
    assert [p.name for p in tmp_path.iterdir()] == ["x.yaml"]
