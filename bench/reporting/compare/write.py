"""The files of a comparison."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.recordings import write_bytes, write_text
from bench.reporting.compare.comparison import RunComparison, compare_runs
from bench.reporting.compare.comparison_files import to_csv, to_json, write_object_changes
from bench.reporting.compare.comparison_text import to_markdown
from bench.reporting.compare.pictures import DrawnFrame, draw_changed_frames
from bench.reporting.compare.stored_runs import read_comparable

CHANGES = "object_changes.csv"
NAMES = ("compare.md", "compare.csv", CHANGES, "compare.json")
_PICTURE_NAME = re.compile(r"\d\d-\d\d-[a-z-]+\.jpg")


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenComparison:
    """What was written.

    Attributes:
        comparisons: the first run with each of the others, for the terminal.
        remarks: about pictures that could not be made, or that do not show what was stored.
        files: paths, texts first.
    """

    comparisons: tuple[RunComparison, ...]
    remarks: tuple[str, ...]
    files: tuple[Path, ...]


def write_comparison(
    folders: Sequence[Path],
    out: Path,
    *,
    pictures: bool = True,
    progress: Callable[[float, int], None] | None = None,
) -> WrittenComparison:
    """Compare runs and write `compare.md`, `.csv`, `.json`, `object_changes.csv` and `pictures/`.

    Each file appears whole or not at all. Pictures of an earlier comparison in `out` are removed, other files are left.

    Args:
        folders: of the runs, the one compared against first.
        out: folder, is made.
        pictures: draw the frames that changed most; needs the data set and the methods.
        progress: called with the pictures done and their number, for each pair anew.

    Raises:
        DataError: a run is damaged.
        UsageError: fewer than two runs, or runs that do not compare.
    """
    comparisons = compare_runs(read_comparable(folders))
    drawn: list[list[DrawnFrame]] = []
    remarks: list[list[str]] = []
    for number, comparison in enumerate(comparisons, start=1):
        made, said = draw_changed_frames(comparison, number=number, progress=progress) if pictures else ([], [])
        drawn.append(made)
        remarks.append(said)
    texts = {
        "compare.md": to_markdown(comparisons, drawn=drawn, remarks=remarks),
        "compare.csv": to_csv(comparisons),
        "compare.json": to_json(comparisons, drawn=drawn, remarks=remarks),
    }
    shown = {picture.name: picture.jpeg for made in drawn for picture in made}
    for name, jpeg in shown.items():
        write_bytes(out / "pictures" / name, jpeg)
    for name, text in texts.items():
        write_text(out / name, text)
    write_object_changes(out / CHANGES, comparisons)
    for old in sorted((out / "pictures").glob("*.jpg")):
        if old.name not in shown and _PICTURE_NAME.fullmatch(old.name):
            old.unlink()
    return WrittenComparison(
        comparisons=tuple(comparisons),
        remarks=tuple(line for said in remarks for line in said),
        files=(*(out / name for name in NAMES), *(out / "pictures" / name for name in shown)),
    )
