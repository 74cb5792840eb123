"""The slices of a run by name: categories and breakdowns of its object-frames and image-frames."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation.bins import bin_names, name_bins
from bench.evaluation.protocol import Protocol

IMAGE = ["recording", "camera", "timestamp_ns"]
ALL_MOVING = "all_moving"
FRAMES = "frames"

# The name of each row's slice, and the names of all slices.
Split = tuple[NDArray[np.object_], tuple[str, ...]]


def read_rows(table: pa.Table, *, key: list[str]) -> pd.DataFrame:
    """A table in canonical order, so that no sum depends on how it was sorted; `key` names each row once."""
    # No figure needs lists, and as pandas objects they would be most of the memory.
    flat = table.select([field.name for field in table.schema if not pa.types.is_list(field.type)])
    rows: pd.DataFrame = flat.to_pandas().sort_values(key, ignore_index=True)
    assert not rows.duplicated(key).any(), f"{key} names each row once"
    return rows


def object_splits(evaluated: pd.DataFrame, *, protocol: Protocol, cameras: Iterable[str]) -> dict[str, Split]:
    """The breakdowns of evaluated object-frames by name."""
    return {
        "object_class": (evaluated["object_class"].to_numpy(), protocol.reference.classes),
        "range_m": binned(evaluated, "range_m", protocol.bins.range_m),
        "ego_speed_mps": binned(evaluated, "ego_speed_mps", protocol.bins.ego_speed_mps),
        "camera": (evaluated["camera"].to_numpy(), tuple(cameras)),
        "points": binned(evaluated, "points", protocol.bins.points),
    }


def frame_splits(scored: pd.DataFrame, *, protocol: Protocol, cameras: Iterable[str]) -> dict[str, Split]:
    """The breakdowns of scored image-frames by name."""
    return {
        "ego_speed_mps": binned(scored, "ego_speed_mps", protocol.bins.ego_speed_mps),
        "camera": (scored["camera"].to_numpy(), tuple(cameras)),
    }


def object_slices(
    evaluated: pd.DataFrame, *, protocol: Protocol, cameras: Iterable[str]
) -> dict[str, NDArray[np.bool_]]:
    """Categories, "all_moving", then "<breakdown>=<name>": which rows are in each slice, (N,) bool."""
    category = evaluated["category"].to_numpy()
    found = {str(name): _equal(category, str(name)) for name in protocol.reference.categories}
    found[ALL_MOVING] = np.ones(len(evaluated), dtype=bool)
    return found | _named(object_splits(evaluated, protocol=protocol, cameras=cameras))


def frame_slices(scored: pd.DataFrame, *, protocol: Protocol, cameras: Iterable[str]) -> dict[str, NDArray[np.bool_]]:
    """ "frames", then "<breakdown>=<name>": which rows are in each slice, (N,) bool."""
    found = {FRAMES: np.ones(len(scored), dtype=bool)}
    return found | _named(frame_splits(scored, protocol=protocol, cameras=cameras))


def binned(rows: pd.DataFrame, column: str, edges: tuple[float, ...]) -> Split:
    """A numeric column cut into half-open bins."""
    values = rows[column].to_numpy(dtype=np.float64, na_value=np.nan)
    return name_bins(values, edges=edges), bin_names(edges)


def _named(splits: dict[str, Split]) -> dict[str, NDArray[np.bool_]]:
    return {f"{split}={name}": _equal(of_row, name) for split, (of_row, names) in splits.items() for name in names}


def _equal(of_row: NDArray[np.object_], name: str) -> NDArray[np.bool_]:
    equal: NDArray[np.bool_] = np.asarray(of_row == name, dtype=bool)
    return equal
