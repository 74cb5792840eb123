"""Seeded damage to every kind of file that is read: a clear error or an acceptable file, and never another meaning.

What a checksum guards (stored results, PNG and NPZ files) is refused or read as it was written. Other files may say
something else after the damage; then they must be accepted as what they say.
"""

import json
import shutil
import zlib
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from bench.errors import BenchError
from bench.evaluation import load_protocol
from bench.gate.tolerances import load_tolerances
from bench.lidar import read_sweep
from bench.methods.predictions.pairing import index_predictions
from bench.recordings import load_card, open_dataset
from bench.reference import ReferenceBuilder
from tests.hostile import files
from tests.hostile.damage import damaged
from tests.support import tiny
from tests.support.clouds import laz, pcd
from tests.support.commands import call
from tests.support.data_sets import DATA_SETS, card_of
from tests.support.limits import at_most

CLOUD_CASES = 40  # of each kind
LONGEST_S = 30  # of a case; the slowest whole one takes two

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


def labels(folder, patched):
    data_set("native")(folder, patched)
    words = ("--annotated", "--format", "openlabel", "--out", folder / "tool")
    assert call(patched, "annotate", "export", folder / "card.yaml", *words) == 0


def run_and_baseline(folder, patched):
    data_set("native")(folder, patched)
    words = ("--method", "everything", "--workers", 1, "--no-pictures", "--out", folder / "run")
    assert call(patched, "run", folder / "card.yaml", *words) == 0
    words = ("--baseline", folder / "baseline", "--update", "--allow-dirty")
    assert call(patched, "gate", folder / "run", *words) == 0


QUIETLY = ("--workers", "1", "--no-pictures", "--out", "{}/out")
RUN = ("run", "{}/card.yaml", "--method", "nothing", *QUIETLY)
VALIDATE = ("validate", "{}/card.yaml", "--deep")
IMPORT = ("annotate", "import", "openlabel", "{}/tool/drive", "--dataset", "{}/card.yaml", "--recording", "drive",
          "--out", "{}/annotations")  # fmt: skip
GATE = ("gate", "{}/run", "--baseline", "{}/baseline", "--json", "{}/verdict.json")
RESULTS = ("run/surface-v1/*.json", "run/surface-v1/counts/**/*")
TARGETS = {  # what makes the files, which of them are damaged, the command, how many cases
    **{
        f"run {name}": (data_set(name), ("data/**/*",), RUN, 8) for name in ("native", "aimotive", "kitti360", "rosbag")
    },
    "run woodscape": (data_set("woodscape"), ("data/**/*",), (*RUN, "--protocol", "masks-v1"), 8),
    **{f"validate {name}": (data_set(name), ("data/**/*",), VALIDATE, 14) for name in ("native", "rosbag")},
    "labels": (labels, ("tool/**/*",), IMPORT, 10),
    "gate": (run_and_baseline, ("run/surface-v1/*", "baseline/*"), GATE, 25),
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


# Files that users write by hand, mistyped as people do it.

MISTYPED_CASES = 15  # of each file
VALUES = (None, True, "", "nope", 0, -1, 1e300, 10**25, "5", "1_000", [], {}, [1], 1e-300, "\u0661", "a\nb", "../..")
FACTORS = (1000, 1e-3, 1e9, -1, 3.6, 57.29578, 1.01)
WRITTEN = {
    "card.yaml": {
        "name": "drives", "title": "t", "adapter": "native", "root": "data", "licence": "none", "splits": {"all": "*"},
        "exclusions": [{"recording": "drive", "frames": [0, 0], "reason": "the first"}],
        "annotated": {"timestamps_ns": [[0, None]], "left_out_m": [[[50, 50], [60, 50], [60, 60]]]},
    },
    "protocol.yaml": {"based_on": "surface-v1", "name": "mine", "version": 1, "reference": {"range_limit_m": 20.0}},
    "tolerances.yaml": {"based_on": "default-v1", "name": "ours", "slices": {"moving": {"iou": {"decides": True}}}},
    "masks/predictions.yaml": {"sixteen_bits": "score"},
}  # fmt: skip


def nodes(value: Any, parent: Any = None, key: Any = None) -> Iterator[tuple[Any, Any]]:
    """Every part of a document, as the part that holds it and its key there."""
    if parent is not None:
        yield parent, key
    for inner in value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield from nodes(value[inner], value, inner)


def mistyped(document: Any, rng: Random) -> Any:
    changed = deepcopy(document)
    parent, key = rng.choice(list(nodes(changed)))
    value = parent[key]
    others = [rng.choice(VALUES), f"{value} "]
    others += [value * rng.choice(FACTORS)] if isinstance(value, int | float) else []
    kind = rng.choice(("another value", "left out", "another key"))
    if kind == "another value":
        parent[key] = rng.choice(others)
    else:
        del parent[key]
    if kind == "another key" and isinstance(parent, dict):
        place = rng.randrange(len(key))
        parent[key[:place] + rng.choice("abx") + key[place + 1 :]] = value
    return changed


def read(folder: Path) -> None:
    """Each of the files, and the reference that they lead to."""
    settings = load_protocol(folder / "protocol.yaml").reference
    load_tolerances(folder / "tolerances.yaml")
    card = load_card(folder / "card.yaml")
    for handle in open_dataset(card):
        recording = handle.open()
        for camera, images in recording.images.items():
            ReferenceBuilder(recording, camera, settings).build(images[-1])
    index_predictions(folder / "masks", card)


@pytest.mark.parametrize("name", [*WRITTEN, "data/drive/recording.json", "data/drive/annotations.json"])
def test_mistyped_files(tmp_path, name):
    tiny.write_recording(tmp_path / "data" / "drive")
    (tmp_path / "masks" / "front").mkdir(parents=True)
    for time_ns in tiny.TIMES_NS:
        cv2.imwrite(str(tmp_path / f"masks/front/{time_ns}.png"), np.eye(tiny.HEIGHT, tiny.WIDTH, dtype=np.uint16))
    for file, content in WRITTEN.items():
        (tmp_path / file).write_text(yaml.safe_dump(content))
    read(tmp_path)
    document = yaml.safe_load((tmp_path / name).read_text())
    for case in range(MISTYPED_CASES):
        changed = mistyped(document, Random(f"{name} {case}"))
        (tmp_path / name).write_text(json.dumps(changed))  # which is YAML, too
        told = name
        with at_most(seconds=30):
            try:
                read(tmp_path)
            except BenchError as error:
                told = str(error)
        assert "\n" not in told, case
        assert any(place in told for place in (name, "annotations", "drive", "masks")), (case, told)
