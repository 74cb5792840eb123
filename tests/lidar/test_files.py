"""Point-cloud files, whole and broken."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bench.errors import DataError, UnknownNameError
from bench.lidar.fields import is_time
from bench.lidar.files import FORMATS, read_points, read_sweep, write_sweep
from bench.lidar.sweep import LidarSweep
from tests.support.clouds import laz, pcd_of, write_points
from tests.support.clouds import pcd as pcd_head

POINTS = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [-7.5, 8.25, 0.125]], dtype=np.float32)
PLACE = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
XYZ = [("x", 4, "F", 1), ("y", 4, "F", 1), ("z", 4, "F", 1)]
INTENSITY = np.array([0.0, 0.5, 1.0], dtype=np.float32)
SWEEP_NS = 1_700_000_000_000_000_000
OFFSETS_NS = np.array([-50_000_000, 0, 49_000_000])


def pcd(path, *content):
    path.write_bytes(b"# .PCD v0.7\n" + pcd_of(*content))
    return path


@pytest.mark.parametrize("suffix", FORMATS)
def test_points_and_other_fields_survive_every_format(tmp_path, suffix):
    path = tmp_path / f"1{suffix}"
    scale = 100 if suffix in (".las", ".laz") else 1
    write_points(path, {"points_lidar": POINTS, "intensity": INTENSITY * scale})
    arrays = read_points(path)
    assert arrays["points_lidar"] == pytest.approx(POINTS, abs=0.001)
    assert arrays["intensity"] == pytest.approx(INTENSITY * scale)
    sweep = read_sweep(path, 0)
    told = sweep.read_fields if suffix == ".npz" else sweep.unread_fields
    assert told == ("intensity",)


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


@pytest.mark.parametrize("suffix", [".npz", ".bin", ".pcd"])
@pytest.mark.parametrize("hole", [np.nan, np.inf, -np.inf])
def test_returns_without_a_position_are_left_out_and_rows_are_known(tmp_path, suffix, hole):
    path = tmp_path / f"1{suffix}"
    points = POINTS.copy()
    points[1, 2] = hole
    write_points(path, {"points_lidar": points, "intensity": INTENSITY})
    sweep = read_sweep(path, 0)
    assert sweep.points_lidar.tolist() == POINTS[[0, 2]].tolist()
    assert (sweep.stored_rows.tolist(), sweep.rows_stored) == ([0, 2], 3)
    assert sweep.rows_of(np.array([2, 1])).tolist() == [1]
    write_points(path, {"points_lidar": np.full_like(POINTS, hole)})
    with pytest.raises(DataError, match=r"points_lidar: expected finite numbers, got none in any row"):
        read_sweep(path, 0)


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


def test_pickles_a_missing_file_and_an_unknown_suffix_are_refused(tmp_path):
    np.savez(tmp_path / "1.npz", points_lidar=np.array([{"a": 1}], dtype=object))
    with pytest.raises(DataError, match="plain arrays, got Object arrays cannot be loaded"):
        read_points(tmp_path / "1.npz")
    with pytest.raises(DataError, match="no such file"):
        read_points(tmp_path / "2.npz")
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
    write_points(path, {"points_lidar": POINTS, "gps_time": gps_time})
    assert read_sweep(path, 4_833_189_570_000).time_offset_ns.tolist() == [-67_894_000, 0, 32_355_000]
    with pytest.raises(DataError, match=r"gps_time: expected times within a second of .*, in ns 4833\.17 s from it"):
        read_sweep(path, 0)


LEAP_S = 18  # since 2017
SWEEP_S = 1_700_000_000
GPS_S = SWEEP_S - 315_964_800 + LEAP_S


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("point_format", [1, 6])
@pytest.mark.parametrize("zero_s", [SWEEP_S, GPS_S, GPS_S - 10**9, GPS_S % 604_800, SWEEP_S % 3600, 0])
def test_times_of_las_may_be_of_every_clock_that_its_tools_have(tmp_path, suffix, point_format, zero_s):
    times_s = zero_s + np.array([-0.05, 0.0, 0.049])
    content = laz(POINTS, point_format=point_format, packed=suffix == ".laz", gps_time=times_s)
    (tmp_path / f"1{suffix}").write_bytes(content)
    sweep = read_sweep(tmp_path / f"1{suffix}", SWEEP_NS)
    assert sweep.time_offset_ns == pytest.approx(OFFSETS_NS, abs=300)
    content = laz(POINTS, point_format=point_format, packed=suffix == ".laz", gps_time=np.zeros(3))
    (tmp_path / f"1{suffix}").write_bytes(content)
    assert read_sweep(tmp_path / f"1{suffix}", SWEEP_NS).time_offset_ns is None


@pytest.mark.parametrize("columns", range(3, 8))
def test_the_columns_of_a_bin_file_are_those_of_the_card(tmp_path, columns):
    rows = np.random.default_rng(columns).uniform(-40, 40, (200, columns)).astype("<f4")
    rows[:, 5:6] = np.linspace(-0.05, 0.05, 200)[:, None]
    rows.tofile(tmp_path / "1.bin")
    names = ["x", "y", "z", "intensity", "ring", "time", "other"][:columns]
    sweep = read_sweep(tmp_path / "1.bin", 0, bin_columns=names)
    assert sweep.points_lidar.tolist() == rows[:, :3].tolist()
    assert (sweep.time_offset_ns is not None) == (columns > 5)
    assert sweep.unread_fields == tuple(name for name in names[3:] if name != "time")


@pytest.mark.parametrize(
    "name",
    [
        *(
            "t",
            "time",
            "time_stamp",
            "stamps",
            "point_time_offset",
            "offset_ns",
            "Timestamp",
            "timeStamp",
            "offset_time",
        ),
        *("t_us", "gps_time", "ts", "reltime", "firing_time", "t_offset", "dt", "timestampNs", "stampUs", "laserTime"),
        *("relative_time", "point_timestamp_ns", "timestamps"),
    ],
)
def test_fields_with_times_are_known_by_the_words_of_their_names(tmp_path, name):
    unit_ns = 1 if name.lower().endswith("ns") else 1_000  # also where the name says nothing
    columns = [*XYZ, (name, 4, "I", 1), ("label", 4, "I", 1)]
    rows = np.zeros(3, dtype=[*PLACE, (name, "<i4"), ("label", "<i4")])
    rows[name] = OFFSETS_NS // unit_ns
    sweep = read_sweep(pcd(tmp_path / "1.pcd", columns, 3, rows.tobytes()), SWEEP_NS)
    assert sweep.time_offset_ns.tolist() == OFFSETS_NS.tolist()
    assert (sweep.read_fields, sweep.unread_fields) == ((name,), ("label",))


def test_other_fields_are_no_times():
    names = "tag distance offset point ns tint timer curvature state test intensity status points set d"
    assert not [*filter(is_time, names.split())]


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ({"FIELDS": "a b c"}, "header: expected the header of a .pcd file, got the fields a, b, c, without x, y and z"),
        ({"WIDTH": "2"}, "got WIDTH 2 and HEIGHT 1 that do not make POINTS 3"),
        ({"SIZE": "4 4"}, "got 3 FIELDS, 3 TYPE, 2 SIZE and 3 COUNT, not one for each field"),
        ({"TYPE": "F F Q"}, "got a TYPE, SIZE or COUNT that no field has"),
        ({"POINTS": "0", "WIDTH": "0"}, "POINTS: expected points, got 0, an empty cloud; remove the file"),
        ({"FIELDS": "x y z x", "SIZE": "4 4 4 4", "TYPE": "F F F F", "COUNT": "1 1 1 1"}, "or with a name twice"),
    ],
)
def test_each_fault_of_a_head_is_named(tmp_path, lines, told):
    (tmp_path / "1.pcd").write_bytes(pcd_head(3, body=bytes(36), **lines))
    with pytest.raises(DataError, match=re.escape(told)):
        read_points(tmp_path / "1.pcd")


def test_lines_of_a_head_that_say_what_others_say_may_be_left_out(tmp_path):
    lines = pcd_head(3, body=POINTS.tobytes()).split(b"\n", 9)
    kept = [line for line in lines[:-1] if not line.startswith((b"HEIGHT", b"POINTS", b"COUNT", b"VIEWPOINT"))]
    (tmp_path / "1.pcd").write_bytes(b"\n".join([*kept, lines[-1]]))
    assert read_points(tmp_path / "1.pcd")["points_lidar"].tolist() == POINTS.tolist()
    (tmp_path / "1.pcd").write_bytes(b"VERSION 0.7\n")
    with pytest.raises(DataError, match=r"DATA: expected the line that ends the header of a \.pcd file, got none"):
        read_points(tmp_path / "1.pcd")


def test_fields_that_pad_a_point_are_passed_over(tmp_path):
    """As drivers of lidars write them, `_` several times: open3d's process ends on such files."""
    padded = [*PLACE, ("_", "u1", 4), ("intensity", "<f4"), ("t", "<f8"), ("pad", "u1", 6), ("ring", "<u2")]
    rows = np.zeros(3, dtype=padded)
    for i, axis in enumerate("xyz"):
        rows[axis] = POINTS[:, i]
    rows["t"], rows["ring"] = [0.0, 0.05, 0.1], [0, 63, 127]
    padding = [("_", 1, "U", 4), ("intensity", 4, "F", 1), ("t", 8, "F", 1), ("_", 1, "U", 6), ("ring", 2, "U", 1)]
    path = pcd(tmp_path / "1.pcd", [*XYZ, *padding], 3, rows.tobytes() + bytes(1000))
    sweep = read_sweep(path, SWEEP_NS)
    np.testing.assert_array_equal(sweep.points_lidar, POINTS)
    assert read_points(path)["ring"].tolist() == [0, 63, 127]
    assert sweep.time_offset_ns.tolist() == [0, 50_000_000, 100_000_000]
    text = "\n".join("1 2 3 0 0 0 0 9 0.05 0 0 0 0 0 0 7" for _ in range(2)).encode()
    arrays = read_points(pcd(tmp_path / "2.pcd", [*XYZ, *padding], 2, text, "ascii"))
    assert arrays["points_lidar"].tolist() == [[1, 2, 3]] * 2
    assert arrays["ring"].tolist() == [7, 7]


def test_points_of_text_may_be_lost_and_lines_end_as_on_windows(tmp_path):
    body = b"1 2 3 \r\n-nan nan -inf\r\n 4 5e-1 6\r\n"
    sweep = read_sweep(pcd(tmp_path / "1.pcd", XYZ, 3, body, "ascii"), 0)
    assert sweep.points_lidar.tolist() == [[1, 2, 3], [4, 0.5, 6]]
    assert sweep.stored_rows.tolist() == [0, 2]


def test_compressed_points_are_refused_with_the_remedy(tmp_path):
    path = pcd(tmp_path / "1.pcd", XYZ, 3, bytes(40), "binary_compressed")
    with pytest.raises(DataError, match=r"DATA: expected ascii or binary, got binary_compressed; pcl_convert_pcd_asc"):
        read_points(path)


def test_behind_a_field_of_no_numbers_nothing_is_read(tmp_path):
    """A real file with COUNT 0 has its times four bytes further on than its header says."""
    rows = np.zeros(3, dtype=[*PLACE, ("rest", "u1", 12)])
    rows["x"] = 1.0
    columns = [*XYZ, ("_", 4, "F", 0), ("label", 4, "U", 1), ("timestamp", 8, "F", 1)]
    with pytest.raises(DataError, match=r"COUNT: expected a COUNT of 1 or more for each field before timestamp, got 0"):
        read_points(pcd(tmp_path / "1.pcd", columns, 3, rows.tobytes()))
    columns[-1] = ("other", 8, "F", 1)
    assert set(read_points(pcd(tmp_path / "2.pcd", columns, 3, rows.tobytes()))) == {"points_lidar", "label", "other"}


@pytest.mark.parametrize(
    ("times", "dtype"),
    [
        (OFFSETS_NS / 1e9, "<f4"),
        (OFFSETS_NS / 1e6, "<f4"),
        (OFFSETS_NS / 1e3, "<i4"),
        (OFFSETS_NS, "<i4"),
        ((SWEEP_NS + OFFSETS_NS) / 1e9, "<f8"),
        ((SWEEP_NS + OFFSETS_NS) // 1000, "<u8"),
        (SWEEP_NS + OFFSETS_NS, "<u8"),
        (SWEEP_NS + OFFSETS_NS, "ascii"),
    ],
)
def test_times_of_points_are_read_in_any_unit_from_the_sweep_or_its_clock(tmp_path, times, dtype):
    text = dtype == "ascii"
    kind = np.dtype("<u8" if text else dtype)
    rows = np.zeros(3, dtype=[*PLACE, ("timestamp", kind)])
    rows["x"], rows["timestamp"] = [1, 2, 3], times.astype(kind)
    letter = {"f": "F", "u": "U", "i": "I"}[kind.kind]
    body = "\n".join(" ".join(map(str, row)) for row in rows.tolist()).encode() if text else rows.tobytes()
    columns = [*XYZ, ("timestamp", kind.itemsize, letter, 1)]
    path = pcd(tmp_path / "1.pcd", columns, 3, body, "ascii" if text else "binary")
    assert read_sweep(path, SWEEP_NS).time_offset_ns == pytest.approx(OFFSETS_NS, abs=300)


def test_times_of_points_that_make_no_sweep_are_refused(tmp_path):
    def sweep_of(times, timestamp_ns=SWEEP_NS):
        rows = np.zeros(3, dtype=[*PLACE, ("t", "<f8")])
        rows["t"] = times
        path = pcd(tmp_path / "1.pcd", [*XYZ, ("t", 8, "F", 1)], 3, rows.tobytes())
        return read_sweep(path, timestamp_ns)

    assert sweep_of([0.0, 0.0, 0.0]).time_offset_ns is None
    with pytest.raises(DataError, match=r"t: expected times of points that are 10 ms to a second apart, .* 0.0 to 5.0"):
        sweep_of([0.0, 1.0, 5.0])
    told = rf"t: expected times within a second of the sweep at {SWEEP_NS} ns, or of 0, got 999.95 to 1000.1, in s"
    with pytest.raises(DataError, match=told):
        sweep_of([1000.0, 1000.1, 999.95])
    assert sweep_of([0.5, 0.55, 0.6], 520_000_000).time_offset_ns.tolist() == [-20_000_000, 30_000_000, 80_000_000]
