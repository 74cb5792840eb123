"""A table of boxes, CSV or Parquet: one row for each object at each time.

Columns: `timestamp_ns`, `track` (may be empty: such boxes are followed by nearness), `class`, the box's centre `x_m`,
`y_m`, `z_m`, its full `length_m`, `width_m`, `height_m`, `yaw_rad` from the frame's x to its y axis, and `frame`:
"vehicle", "lidar", or "world" for that of the recording's poses. Optional are `vx_mps`, `vy_mps`, `vz_mps`, over the
ground along the axes of the frame; empty where unknown.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.annotation.formats.conversion import (
    LARGEST_BYTES,
    Files,
    LabelFormat,
    LabelOptions,
    Observation,
    ToolLabels,
    lost_lines,
    recording_times,
    vehicle_from_tool,
)
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings import Cuboid, GroundPolygon, PointIndices, Recording, Track
from bench.recordings.annotations import box_state
from bench.recordings.files import read_whole
from bench.recordings.validation import LARGEST_MEASURED

FILE = "boxes.csv"
TIME, WORDS = "timestamp_ns", ["track", "class", "frame"]
CENTRE, SIZE, YAW = ["x_m", "y_m", "z_m"], ["length_m", "width_m", "height_m"], "yaw_rad"
VELOCITY = ["vx_mps", "vy_mps", "vz_mps"]
REQUIRED = [TIME, *WORDS, *CENTRE, *SIZE, YAW]
LEVEL = 1e-3  # sine of how far a box leans, from which on it is said


class BoxTable(LabelFormat):
    """A table of boxes."""

    name = "boxes"
    description = "a table of boxes, CSV or Parquet: time, track, class, centre, size, yaw, frame, velocity"

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> ToolLabels:
        """Read a table; arguments and errors as in `LabelFormat`."""
        file = source / FILE if source.is_dir() else source
        table = _read(file)
        centres_m, sizes_m, yaws_rad = (_numbers(table, names, file) for names in (CENTRE, SIZE, [YAW]))
        unknown = {name: np.nan for name in VELOCITY if name not in table}
        velocities_mps = _numbers(table.assign(**unknown), VELOCITY, file, optional=True)
        times_ns = recording_times(_times(table, file), recording, source=file, field=TIME)
        observations = []
        for row, (track, label, frame) in enumerate(zip(*(table[word] for word in WORDS), strict=True)):
            if sizes_m[row].min() <= 0:
                raise DataError(file, field=f"row {row}", expected="sizes above 0", got=str(sizes_m[row].tolist()))
            vehicle_from_frame = vehicle_from_tool(frame, times_ns[row], recording, options, file, f"row {row}.frame")
            box = vehicle_from_frame @ RigidTransform.from_yaw(yaws_rad[row, 0], centres_m[row])
            state = box_state(times_ns[row], box, sizes_m[row], vehicle_from_frame.rotate(velocities_mps[row]))
            observations.append(Observation(track=track, label=label, state=state))
        unknown_columns = sorted({*map(str, table)} - {*REQUIRED, *VELOCITY})
        lost = [f"column {name[:40]!r}: no field for it" for name in unknown_columns]
        return ToolLabels(observations=observations, timestamps_ns=times_ns, lost=lost)

    def write(self, recording: Recording) -> tuple[Files, list[str]]:
        """Write boxes in the vehicle frame; arguments as in `LabelFormat`."""
        rows = []
        leaning = 0
        for track in recording.tracks:
            for state in track.states:
                if isinstance(state.shape, Cuboid):
                    box = state.shape.vehicle_from_object
                    leaning += bool(np.hypot(*box.rotation[2, :2]) > LEVEL)
                    words = [track.track_id, track.object_class, "vehicle"]
                    size_m, yaw_rad = np.asarray(state.shape.size_m), np.arctan2(box.rotation[1, 0], box.rotation[0, 0])
                    numbers = np.concatenate([box.translation_m, size_m, [yaw_rad], state.velocity_mps])
                    rows.append([state.timestamp_ns, *words, *numbers.tolist()])
        text = pd.DataFrame(rows, columns=[*REQUIRED, *VELOCITY]).to_csv(index=False, lineterminator="\n")
        upright = lost_lines({"boxes that lean against the vehicle: written upright": leaning})
        return {FILE: text.encode()}, [*_not_written(recording.tracks), *upright]


def _not_written(tracks: Sequence[Track]) -> list[str]:
    """Lines for what boxes and velocities alone cannot hold."""
    states = [state for track in tracks for state in track.states]
    counts = {
        "ground outlines": sum(isinstance(state.shape, GroundPolygon) for state in states),
        "places that are given by points": sum(isinstance(state.shape, PointIndices) for state in states),
        "yaw rates": sum(bool(state.yaw_rate_radps) for state in states),
        "kinds of motion (category)": sum(state.category is not None for state in states),
        "marks of unclear objects": sum(state.unclear for state in states),
        "numbers in truth images (instance_id)": sum(track.instance_id is not None for track in tracks),
    }
    return lost_lines({f"{what}: no field for them": count for what, count in counts.items()})


def _read(file: Path) -> pd.DataFrame:
    content = read_whole(file, largest_bytes=LARGEST_BYTES)
    try:
        if content[:4] == b"PAR1":
            table = pd.read_parquet(io.BytesIO(content))
        else:
            words = dict.fromkeys([TIME, *WORDS], "str")  # a time has more digits than a float
            table = pd.read_csv(io.BytesIO(content), dtype=words, keep_default_na=False, na_values=[""])
    except (OSError, ValueError, RecursionError) as error:  # of pandas and pyarrow both
        raise DataError(file, expected="a table, CSV or Parquet", got=str(error)) from error
    if missing := [name for name in REQUIRED if name not in table.columns]:
        got = f"none for {', '.join(missing)}"
        raise DataError(file, field="columns", expected=f"columns {', '.join(REQUIRED)}", got=got)
    return table.assign(**{name: table[name].astype("str").where(table[name].notna(), "") for name in WORDS})


def _times(table: pd.DataFrame, file: Path) -> list[int]:
    """Whole nanoseconds, of numbers or text."""
    times_ns = []
    for row, value in enumerate(table[TIME]):
        text = str(value).removesuffix(".0")
        if not re.fullmatch(r"-?[0-9]{1,19}", text):
            raise DataError(file, field=f"row {row}.{TIME}", expected="whole nanoseconds", got=repr(value))
        times_ns.append(int(text))
    return times_ns


def _numbers(table: pd.DataFrame, names: list[str], file: Path, *, optional: bool = False) -> NDArray[np.float64]:
    """(N, K) float64 of K columns; NaN for what is optional and not there.

    Raises:
        DataError: no finite number, or one beyond any map.
    """
    columns = [pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=np.float64) for name in names]
    for name, values in zip(names, columns, strict=True):
        wrong = ~(np.abs(values) < LARGEST_MEASURED) & ~(optional & table[name].isna().to_numpy())
        if wrong.any():
            row = int(np.argmax(wrong))
            raise DataError(file, field=f"row {row}.{name}", expected="a number", got=repr(table[name].iloc[row]))
    return np.column_stack(columns)
