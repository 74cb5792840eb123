"""Plant mistakes into recordings in the native format: change what the files say, as people get it wrong."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.lidar.files import read_sweep, write_sweep
from bench.lidar.sweep import LidarSweep

Json = dict[str, Any]


def change_json(file: Path, change: Callable[[Json], object]) -> None:
    """Change the content of a JSON file in place."""
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def change_head(root: Path, change: Callable[[Json], object]) -> None:
    """Change recording.json."""
    change_json(root / "recording.json", change)


def change_mounting(root: Path, camera: str = "front", **values: object) -> None:
    """Change keys of a camera's mounting."""
    change_head(root, lambda head: head["cameras"][camera]["vehicle_from_camera"].update(values))


def change_boxes(root: Path, change: Callable[[str, int, Json], object], *, only: str | None = None) -> None:
    """Call `change` with the name, frame number and object data of every annotated state."""

    def each(content: Json) -> None:
        for number, frame in content["openlabel"]["frames"].items():
            for name, entry in frame["objects"].items():
                if only is None or name == only:
                    change(name, int(number), entry["object_data"])

    change_json(root / "annotations.json", each)


def change_bus(root: Path, change: Callable[[dict[str, str]], object]) -> None:
    """Change every row of egomotion.csv."""
    with (root / "egomotion.csv").open() as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        change(row)
    with (root / "egomotion.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def sweep_files(root: Path) -> list[Path]:
    """The files of the sweeps, by time."""
    return sorted((root / "lidar").iterdir())


def change_sweep(path: Path, change: Callable[[LidarSweep], LidarSweep]) -> None:
    """Change one sweep."""
    write_sweep(path, change(read_sweep(path, int(path.stem))))


def change_sweeps(root: Path, change: Callable[[LidarSweep], LidarSweep]) -> None:
    """Change all sweeps."""
    for path in sweep_files(root):
        change_sweep(path, change)


def retime(folder: Path, change: Callable[[int], int]) -> None:
    """Rename the files of a folder, which are called by their times, the last first."""
    for path in sorted(folder.iterdir(), reverse=True):
        path.rename(path.with_stem(str(change(int(path.stem)))))
