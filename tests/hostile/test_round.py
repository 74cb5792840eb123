"""Seeded damage to every kind of file that is read: a clear error or an acceptable file, and never another meaning.

What a checksum guards (stored results, PNG and NPZ files) is refused or read as it was written. Other files may say
something else after the damage; then they must be accepted as what they say.
"""

from __future__ import annotations

import shutil
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import TypeVar

import cv2
import numpy as np
import pytest

from bench.errors import BenchError
from bench.lidar import read_sweep
from bench.recordings import ImageRef, read_image
from bench.recordings.images import read_mask
from tests.hostile import files
from tests.hostile.damage import damaged
from tests.support import tiny, tiny_rosbag
from tests.support.clouds import laz, pcd
from tests.support.commands import call
from tests.support.data_sets import DATA_SETS, card_of
from tests.support.limits import at_most
from tests.support.runs import bytes_of

SEED = 12
CLOUD_CASES, IMAGE_CASES = 60, 80  # of each kind
LONGEST_S = 30  # of a case; the slowest whole one takes two
CLEAR = {0, 1, 2, 3}  # 70 is a fault of ours
Observed = Mapping[str, bytes] | None
Read = TypeVar("Read")

pytestmark = pytest.mark.slow


def seeded(*words: object) -> Random:
    return Random(zlib.crc32(repr((SEED, *words)).encode()))


# Readers of single files

CLOUDS = {
    ".npz": files.NPZ,
    ".laz": laz(files.POINTS.astype(float), gps_time=np.full(500, 1000.0)),
    "layered.laz": laz(files.POINTS.astype(float), point_format=6, gps_time=np.full(500, 1000.0)),
    ".bin": files.ROWS.tobytes(),
    ".pcd": pcd(500, body=files.POINTS.tobytes()),
}


def read_or_told(read: Callable[[], Read], path: Path) -> Read | None:
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


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_images(tmp_path, suffix):
    path = tmp_path / f"1000{suffix}"
    camera, image = tiny.front_camera(), ImageRef(camera="front", timestamp_ns=1000, path=path)
    smooth = cv2.GaussianBlur(tiny.pixels(0), (0, 0), 3)
    whole = cv2.imencode(suffix, smooth)[1].tobytes()
    for case in range(IMAGE_CASES):
        content, how = damaged(whole, seeded(suffix, case))
        path.write_bytes(content)
        pixels = read_or_told(lambda: read_image(image, camera), path)
        mask = read_or_told(lambda: read_mask(path, (tiny.WIDTH, tiny.HEIGHT)), path)
        for found, expected in ((pixels, smooth), (mask, smooth > 0)):
            if found is not None:
                assert found.shape == expected.shape, (case, how)
                assert suffix != ".png" or np.array_equal(found, expected), (case, how)


# Files behind commands


@dataclass(frozen=True)
class Target:
    """A folder of files and a command that reads them.

    Attributes:
        harm: patterns of the files that are damaged, one a case.
        words: of the command; `{}` is the folder.
        cases: how many.
        observe: what the command makes of whole files, where damage must not change it.
    """

    harm: tuple[str, ...]
    words: tuple[str, ...]
    cases: int = 25
    observe: Callable[[Path], Observed] | None = None


def tables(folder: Path) -> Observed:
    return bytes_of(folder / "run")


QUIETLY = ("--workers", "1", "--no-pictures")
DATA = ("run", "{}/card.yaml", "--method", "nothing", *QUIETLY, "--out", "{}/out")
VALIDATE = ("validate", "{}/card.yaml", "--deep")
RUN = ("run", "{}/tiny.yaml", "--method", "everything", *QUIETLY)
GATE = ("gate", "{}/run", "--baseline", "{}/baseline", "--json", "{}/verdict.json")
RESULTS = ("run/paper-v1/*.json", "run/paper-v1/counts/**/*")
TARGETS = {
    **{f"run {name}": Target(("data/**/*",), DATA, 15) for name in ("aimotive", "kitti360", "mcap", "sqlite")},
    "run native": Target(("data/**/*",), DATA, 20),
    "run woodscape": Target(("data/**/*",), (*DATA, "--protocol", "masks-v1"), 15),
    **{f"validate {name}": Target(("data/**/*",), VALIDATE, 25) for name in ("aimotive", "kitti360", "native", "mcap")},
    **{
        f"label format {name}": Target(
            ("tool/**/*",),
            ("annotate", "import", name, "{}/tool/drive", "--dataset", "{}/card.yaml", "--recording", "drive",
             "--out", "{}/annotations"), 15,
        )
        for name in ("boxes", "openlabel", "cvat")
    },
    "predictions": Target(("predictions/**/*",), ("evaluate", "{}/card.yaml", "--predictions", "{}/predictions",
                                               "--missing", "empty", *QUIETLY, "--out", "{}/out"), 40),
    "gate": Target(("run/paper-v1/*",), GATE, 50),
    "baseline": Target(("baseline/*",), GATE, 50),
    "report": Target(RESULTS, ("report", "{}/run", "--no-pictures"), 12),
    "page with pictures": Target(("run/answers/**/*",), ("report", "{}/run"), 10),
    "compare": Target(RESULTS, ("compare", "{}/run", "{}/other", "--no-pictures", "--out", "{}/compared"), 25),
    "leaderboard": Target(RESULTS, ("leaderboard", "{}", "--out", "{}/board"), 20),
    "answers": Target(("run/answers/**/*",), (*RUN, "--protocol", "surface-v1", "--out", "{}/run"), 15),
    "references": Target(("cache/references/**/*.parquet",), (*RUN, "--out", "{}/run"), 12, tables),
}  # fmt: skip


@pytest.fixture(scope="module")
def whole(tiny_card, tmp_path_factory) -> Callable[[str], Path]:
    """The folder of a target with nothing damaged, made once."""
    made: dict[str, Path] = {}
    patched = pytest.MonkeyPatch()

    def data_set(name: str) -> Path:
        folder = tmp_path_factory.mktemp(name)
        adapter = "rosbag" if name in {"mcap", "sqlite"} else name
        if name == "sqlite":
            tiny_rosbag.write_data_set(folder / "data", storage="sqlite3")
            options = tiny_rosbag.OPTIONS
        else:
            options = DATA_SETS[adapter](folder / "data")
        card_of(folder, adapter, options, file="card.yaml")
        return folder

    def run_of(method: str, folder: Path, *words: str) -> None:
        common = ("--workers", 1, "--no-pictures")
        assert call(patched, "run", tiny_card, "--method", method, *common, "--out", folder, *words) == 0

    def make(name: str) -> Path:
        first, _, last = name.partition(" ")
        if first in {"run", "validate"}:
            return data_set(last)
        if name == "predictions":
            folder = data_set("native")
            (folder / "predictions/front").mkdir(parents=True)
            (folder / "predictions/predictions.yaml").write_text("sixteen_bits: score\n")
            scores = np.eye(tiny.HEIGHT, tiny.WIDTH, dtype=np.uint16)
            for time_ns in tiny.TIMES_NS:
                assert cv2.imwrite(str(folder / f"predictions/front/{time_ns}.png"), scores)
            return folder
        if name.startswith("label format"):
            folder, tool = data_set("native"), name.split()[-1]
            shutil.copytree(folder / "data/drive", folder / "drive")
            words = (folder / "card.yaml", "--annotated", "--format", tool, "--out", folder / "tool")
            assert call(patched, "annotate", "export", *words) == 0
            return folder
        folder = tmp_path_factory.mktemp("stored")
        shutil.copytree(tiny_card.parent, folder, dirs_exist_ok=True)
        if name == "references":
            with pytest.MonkeyPatch.context() as cached:
                cached.setenv("FISHEYE_BENCH_CACHE", str(folder / "cache"))
                run_of("nothing", folder / "first")
            return folder
        run_of("everything", folder / "run")
        if name == "compare":
            run_of("nothing", folder / "other")
        if name in {"gate", "baseline"}:
            words = ("--baseline", folder / "baseline", "--update", "--allow-dirty")
            assert call(patched, "gate", folder / "run", *words) == 0
        return folder

    def folder_of(name: str) -> Path:
        if name not in made:
            made[name] = make(name)
        return made[name]

    yield folder_of
    patched.undo()


def said(words: tuple[str, ...], folder: Path) -> list[str]:
    return [word.replace("{}", str(folder)) for word in words]


@pytest.mark.parametrize("name", TARGETS)
def test_files_behind_commands(whole, tmp_path, monkeypatch, capsys, name):
    target, source, place = TARGETS[name], whole(name), tmp_path / "place"
    monkeypatch.setenv("FISHEYE_BENCH_CACHE", str(place / "cache"))
    words: list[str] = []

    def outcome() -> tuple[int, Observed]:
        capsys.readouterr()
        with at_most(LONGEST_S):
            status = call(monkeypatch, *said(target.words, place))
        shown = capsys.readouterr()
        words.append(shown.err + shown.out)
        assert "Traceback" not in shown.err + shown.out, shown.err
        assert status in CLEAR, shown.err
        if status == 2 and target.words[0] != "run":  # a run that left something out says so in its table
            assert shown.err.startswith("error: ") or shown.out, "no word of what is wrong"
        return status, target.observe(place) if target.observe is not None and status != 2 else None

    shutil.copytree(source, place)
    expected = outcome()
    assert expected[0] != 2, words
    wrong = []
    for case in range(target.cases):
        shutil.rmtree(place)
        shutil.copytree(source, place)
        rng = seeded(name, case)
        found = {path for pattern in target.harm for path in place.glob(pattern) if path.is_file()}
        file = rng.choice(sorted(path for path in found if path.stat().st_size))
        content, how = damaged(file.read_bytes(), rng)
        file.write_bytes(content)
        where = f"case {case}: {how} in {file.relative_to(place)}"
        try:
            status, observed = outcome()
        except AssertionError as error:
            wrong.append(f"{where}: {str(error)[-1500:]}")
            continue
        if target.observe is not None and status != 2 and (status, observed) != expected:
            wrong.append(f"{where}: another result, status {status}")
    assert not wrong, "\n".join(wrong)
