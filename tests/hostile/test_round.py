"""Seeded damage to every kind of file that is read: a clear error or an acceptable file, and never another meaning.

What a checksum guards (stored results, PNG and NPZ files) is refused or read as it was written. Other files may say
something else after the damage; then they must be accepted as what they say.
"""

import shutil
import zlib
from random import Random

import cv2
import numpy as np
import pytest
import yaml

from bench.errors import BenchError
from bench.lidar.files import read_sweep
from tests.hostile import files
from tests.hostile.damage import damaged
from tests.support import tiny
from tests.support.clouds import laz, pcd
from tests.support.commands import call
from tests.support.data_sets import DATA_SETS, card_of
from tests.support.limits import at_most

CLOUD_CASES = 40  # of each kind
LONGEST_S = 60  # of a case; the slowest takes two on a machine that does nothing else

pytestmark = pytest.mark.slow


def seeded(*words):
    return Random(zlib.crc32(repr((12, *words)).encode()))


CLOUDS = {
    ".npz": files.NPZ,
    ".laz": laz(files.POINTS.astype(float), gps_time=np.full(500, 1000.0)),
    "layered.laz": laz(files.POINTS.astype(float), point_format=6, gps_time=np.full(500, 1000.0)),
    ".bin": files.ROWS.tobytes(),
    ".pcd": pcd(500, body=files.POINTS.tobytes()),
}


def read_or_told(read, path):
    """What a reader gives, or None where it says in a line that names the file why not."""
    with at_most(LONGEST_S):
        try:
            return read()
        except BenchError as error:
            told = str(error)
    assert str(path) in told
    assert "\n" not in told
    return None


@pytest.mark.parametrize("kind", CLOUDS)
def test_point_clouds(tmp_path, kind):
    path = tmp_path / f"1000.{kind.rpartition('.')[2]}"
    path.write_bytes(CLOUDS[kind])
    whole = read_sweep(path, 1000)
    for case in range(CLOUD_CASES):
        content, how = damaged(CLOUDS[kind], seeded(kind, case))
        path.write_bytes(content)
        sweep = read_or_told(lambda: read_sweep(path, 1000), path)
        if sweep is not None and kind == ".npz":
            assert np.array_equal(sweep.points_lidar, whole.points_lidar), (case, how)
        elif sweep is not None:
            assert sweep.points_lidar.shape[1:] == (3,), (case, how)


def data_set(name):
    def make(folder, _):
        card_of(folder, name, DATA_SETS[name](folder / "data"), file="card.yaml")

    return make


WRITTEN = {  # what users write by hand
    "card.yaml": {
        "name": "drives", "title": "t", "adapter": "native", "root": "data", "licence": "none", "splits": {"all": "*"},
        "exclusions": [{"recording": "drive", "frames": [0, 0], "reason": "the first"}],
        "annotated": {"timestamps_ns": [[0, None]], "left_out_m": [[[50, 50], [60, 50], [60, 60]]]},
    },
    "protocol.yaml": {"based_on": "surface-v1", "name": "mine", "version": 1, "reference": {"range_limit_m": 20.0}},
    "tolerances.yaml": {"based_on": "default-v1", "name": "ours", "slices": {"moving": {"iou": {"decides": True}}}},
    "masks/predictions.yaml": {"sixteen_bits": "score"},
}  # fmt: skip


def written(folder, _):
    tiny.write_recording(folder / "data" / "drive")
    (folder / "masks" / "front").mkdir(parents=True)
    for time_ns in tiny.TIMES_NS:
        cv2.imwrite(str(folder / f"masks/front/{time_ns}.png"), np.eye(tiny.HEIGHT, tiny.WIDTH, dtype=np.uint16))
    for file, content in WRITTEN.items():
        (folder / file).write_text(yaml.safe_dump(content))


def labels(folder, patched):
    data_set("native")(folder, patched)
    words = ("--annotated", "--format", "openlabel", "--out", folder / "tool")
    assert call(patched, "annotate", "export", folder / "card.yaml", *words) == 0


def run_and_baseline(folder, patched):
    written(folder, patched)
    words = ("--method", "everything", "--workers", 1, "--no-pictures", "--out", folder / "run")
    assert call(patched, "run", folder / "card.yaml", *words) == 0
    words = ("--baseline", folder / "baseline", "--update")
    assert call(patched, "gate", folder / "run", *words) == 0


QUIETLY = ("--workers", "1", "--no-pictures", "--out", "{}/out")
RUN = ("run", "{}/card.yaml", "--method", "nothing", *QUIETLY)
VALIDATE = ("validate", "{}/card.yaml", "--deep")
IMPORT = ("annotate", "import", "openlabel", "{}/tool/drive", "--dataset", "{}/card.yaml", "--recording", "drive",
          "--out", "{}/annotations")  # fmt: skip
MASKS = ("evaluate", "{}/card.yaml", "--predictions", "{}/masks", "--protocol", "{}/protocol.yaml", *QUIETLY)
GATE = ("gate", "{}/run", "--baseline", "{}/baseline", "--tolerances", "{}/tolerances.yaml", "--json", "{}/v.json")
RESULTS = ("run/surface-v1/*.json", "run/surface-v1/counts/**/*")
TARGETS = {  # what makes the files, which of them are damaged, the command, how many cases
    **{
        f"run {name}": (data_set(name), ("data/**/*",), RUN, 8) for name in ("native", "aimotive", "kitti360", "rosbag")
    },
    "run woodscape": (data_set("woodscape"), ("data/**/*",), (*RUN, "--protocol", "masks-v1"), 8),
    **{f"validate {name}": (data_set(name), ("data/**/*",), VALIDATE, 14) for name in ("native", "rosbag")},
    "labels": (labels, ("tool/**/*",), IMPORT, 10),
    "written by hand": (written, ("*.yaml", "masks/*.yaml"), MASKS, 40),
    "gate": (run_and_baseline, ("run/surface-v1/*", "baseline/*", "tolerances.yaml"), GATE, 30),
    "report": (run_and_baseline, RESULTS, ("report", "{}/run", "--no-pictures"), 8),
    "page with pictures": (run_and_baseline, ("run/answers/**/*",), ("report", "{}/run"), 5),
    "leaderboard": (run_and_baseline, RESULTS, ("leaderboard", "{}", "--out", "{}/board"), 8),
}


@pytest.mark.parametrize("name", TARGETS)
def test_files_behind_commands(tmp_path, monkeypatch, capsys, name):
    make, harm, command, cases = TARGETS[name]
    source, place = tmp_path / "whole", tmp_path / "place"
    source.mkdir()
    make(source, monkeypatch)
    words = [word.replace("{}", str(place)) for word in command]
    monkeypatch.setenv("FISHEYE_BENCH_CACHE", str(tmp_path / "cache"))
    for case in range(-1, cases):  # the first one with nothing damaged
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(source, place)
        where = f"case {case}"
        if case >= 0:
            rng = seeded(name, case)
            there = {path for pattern in harm for path in place.glob(pattern) if path.is_file()}
            file = rng.choice(sorted(path for path in there if path.stat().st_size))
            content, how = damaged(file.read_bytes(), rng)
            file.write_bytes(content)
            where += f": {how} in {file.relative_to(place)}"
        capsys.readouterr()
        with at_most(LONGEST_S):
            status = call(monkeypatch, *words)
        shown = "".join(capsys.readouterr())
        assert status in ({0, 1, 3} if case < 0 else {0, 1, 2, 3}), (where, shown)  # 70 is a fault of ours
        assert "Traceback" not in shown, where
        assert status != 2 or shown.strip(), where
