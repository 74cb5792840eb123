"""Point-cloud files, whole and broken."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bench.errors import DataError, UnknownNameError
from bench.lidar import LidarSweep, read_points, read_sweep, write_sweep
from bench.lidar.files import FORMATS
from tests.lidar.clouds import write_points

POINTS = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [-7.5, 8.25, 0.125]], dtype=np.float32)
INTENSITY = np.array([0.0, 0.5, 1.0], dtype=np.float32)


@pytest.mark.parametrize("suffix", FORMATS)
def test_points_and_intensities_survive_every_format(tmp_path, suffix):
    path = tmp_path / f"1{suffix}"
    scale = 100 if suffix == ".laz" else 1
    write_points(path, {"points_lidar": POINTS, "intensity": INTENSITY * scale})
    arrays = read_points(path)
    assert arrays["points_lidar"] == pytest.approx(POINTS, abs=0.001)
    assert arrays["intensity"] == pytest.approx(INTENSITY * scale)


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.97])
def test_a_file_cut_short_is_refused(tmp_path, suffix, share):
    whole, cut = tmp_path / f"whole{suffix}", tmp_path / f"cut{suffix}"
    points = np.random.default_rng(1).normal(size=(101, 3)).astype(np.float32)
    write_points(whole, {"points_lidar": points})
    content = whole.read_bytes()
    cut.write_bytes(content[: int(share * len(content))])
    with pytest.raises(DataError, match=rf"cut\{suffix}: "):
        read_points(cut)


@pytest.mark.parametrize("suffix", [".npz", ".bin", ".pcd", ".ply"])
def test_points_that_are_not_finite_are_refused(tmp_path, suffix):
    path = tmp_path / f"1{suffix}"
    points = POINTS.copy()
    points[1, 2] = np.nan
    write_points(path, {"points_lidar": points})
    with pytest.raises(
        DataError, match=r"points_lidar: expected finite numbers, got NaN or infinity in 1 rows"
    ) as caught:
        read_points(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"intensity": INTENSITY}, "points_lidar: expected an array of this name, got none"),
        ({"points_lidar": POINTS[:, :2]}, r"points_lidar: expected \(N, 3\) floating point, got \(3, 2\)"),
        ({"points_lidar": POINTS.astype(int)}, "points_lidar: expected floating point, got int64"),
        (
            {"points_lidar": POINTS, "intensity": INTENSITY[:2]},
            r"intensity: expected \(3,\), one per point, got \(2,\)",
        ),
        ({"points_lidar": POINTS, "time_offset_ns": INTENSITY}, "time_offset_ns: expected int64, got float32"),
        ({"points_lidar": POINTS, "colour": INTENSITY}, "colour: expected only the arrays points_lidar"),
        ({"points_lidar": POINTS, "ring": np.array([0, 1, 300])}, "ring: expected 0 to 255, got 300"),
    ],
)
def test_arrays_that_do_not_fit_are_named(tmp_path, arrays, message):
    path = tmp_path / "1.npz"
    np.savez(path, **arrays)
    with pytest.raises(DataError, match=message):
        read_points(path)


def test_pickles_are_refused(tmp_path):
    path = tmp_path / "1.npz"
    np.savez(path, points_lidar=np.array([{"a": 1}], dtype=object))
    with pytest.raises(DataError, match="numbers, got Python objects"):
        read_points(path)


def test_a_missing_file_and_an_unknown_suffix(tmp_path):
    with pytest.raises(DataError, match="no such file"):
        read_points(tmp_path / "1.npz")
    with pytest.raises(UnknownNameError, match=r"point-cloud suffix '\.xyz'"):
        read_points(tmp_path / "1.xyz")


@given(
    points=hnp.arrays(np.float32, st.tuples(st.integers(0, 20), st.just(3)), elements=st.floats(-100, 100, width=32)),
    timestamp_ns=st.integers(0, 2**62),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_sweep_comes_back_as_it_was_written(tmp_path_factory, points, timestamp_ns, seed):
    rng = np.random.default_rng(seed)
    sweep = LidarSweep(
        timestamp_ns=timestamp_ns,
        points_lidar=points,
        time_offset_ns=rng.integers(-(10**8), 10**8, len(points)),
        intensity=rng.random(len(points), dtype=np.float32),
        ring=rng.integers(0, 64, len(points), dtype=np.uint8),
    )
    path = tmp_path_factory.mktemp("sweep") / f"{timestamp_ns}.npz"
    write_sweep(path, sweep)
    first = path.read_bytes()
    again = read_sweep(path, timestamp_ns)
    for name in ("points_lidar", "time_offset_ns", "intensity", "ring"):
        assert np.array_equal(getattr(again, name), getattr(sweep, name))
        assert getattr(again, name).dtype == getattr(sweep, name).dtype
    write_sweep(path, again)
    assert path.read_bytes() == first


def test_laz_times_are_nanoseconds_in_the_clock_of_the_sweep(tmp_path):
    path = tmp_path / "1.laz"
    gps_time = np.array([4_833_121_676_000.0, 4_833_189_570_000.0, 4_833_221_925_000.0])
    write_points(path, {"points_lidar": POINTS, "intensity": np.array([0, 51, 255]), "gps_time": gps_time})
    sweep = read_sweep(path, 4_833_189_570_000)
    assert sweep.time_offset_ns.tolist() == [-67_894_000, 0, 32_355_000]
    assert sweep.intensity == pytest.approx([0.0, 0.2, 1.0])
    with pytest.raises(DataError, match="gps_time: expected times within a second of 0, ns"):
        read_sweep(path, 0)
