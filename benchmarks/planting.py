"""Changes of the files of a recording in the native format, by which mistakes are planted."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from bench.lidar.files import read_sweep, write_sweep
from bench.lidar.sweep import LidarSweep

Json = dict[str, Any]


def change_json(file: Path, change: Callable[[Json], object]) -> None:
    """Change the content of a JSON file in place."""
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def change_boxes(root: Path, change: Callable[[str, int, Json], object], *, only: str | None = None) -> None:
    """Call `change` with the name, frame number and object data of every annotated state."""

    def each(content: Json) -> None:
        for number, frame in content["openlabel"]["frames"].items():
            for name, entry in frame["objects"].items():
                if only in {None, name}:
                    change(name, int(number), entry["object_data"])

    change_json(root / "annotations.json", each)


def change_bus(root: Path, column: str, change: Callable[[str], object]) -> None:
    """Change a column of egomotion.csv, value by value, as text."""
    table = pd.read_csv(root / "egomotion.csv", dtype=str, keep_default_na=False)
    table[column] = [str(change(text)) for text in table[column]]
    table.to_csv(root / "egomotion.csv", index=False)


def change_sweeps(root: Path, change: Callable[[LidarSweep], LidarSweep]) -> None:
    """Change all sweeps."""
    for path in sorted((root / "lidar").iterdir()):
        write_sweep(path, change(read_sweep(path, int(path.stem))))


def shift_times(folder: Path, offset_ns: int) -> None:
    """Rename the files of a folder, which are called by their times, to times that are later by the offset."""
    for path in sorted(folder.iterdir(), reverse=offset_ns > 0):
        path.rename(path.with_stem(str(int(path.stem) + offset_ns)))
