"""The files of a folder of predictions, by the recording and camera that their place names."""

from __future__ import annotations

import os
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

from bench.errors import DataError
from bench.methods.predictions.faults import Fault, FaultKind
from bench.recordings.paths import refuse_escape

MAP_SUFFIXES = (".png", ".npz")
LIST_SUFFIX = ".json"
Group = dict[str, list[Path]]


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionFiles:
    """What a folder holds.

    Attributes:
        root: the folder.
        maps: by folder relative to the root, with "/" in between, the files of single images.
        lists: by path relative to the root without the suffix, the files of many images; one each.
        faults: files that are no predictions.
    """

    root: Path
    maps: Group = field(default_factory=lambda: defaultdict(list))
    lists: Group = field(default_factory=lambda: defaultdict(list))
    faults: list[Fault] = field(default_factory=list)

    def relative(self, file: Path) -> str:
        """A file as messages name it."""
        return file.relative_to(self.root).as_posix()


def list_predictions(root: Path) -> PredictionFiles:
    """List the files below a folder; hidden ones are passed over, links to folders not followed.

    Raises:
        DataError: there is no such folder, or one below it cannot be read.
    """
    if not root.is_dir():
        raise DataError(root, expected="a folder of predictions", got="no such folder")
    found = PredictionFiles(root=root)

    def unreadable(error: OSError) -> None:
        raise DataError(error.filename or root, expected="a folder to read", got=error.strerror or str(error))

    for folder, subfolders, files in os.walk(root, onerror=unreadable):
        links = [name for name in subfolders if (Path(folder) / name).is_symlink()]
        subfolders[:] = sorted(name for name in subfolders if not name.startswith(".") and name not in links)
        for name in sorted([*files, *links]):
            if not name.startswith("."):
                _sort_in(found, Path(folder) / name)
    return found


def _sort_in(found: PredictionFiles, path: Path) -> None:
    suffix = path.suffix.lower()
    if path.is_dir():
        reason = "a link to a folder, which is not followed"
    elif suffix not in (*MAP_SUFFIXES, LIST_SUFFIX):
        reason = "no .png, .npz or .json"
    elif not path.is_file():
        reason = "no regular file"
    else:
        try:
            refuse_escape(found.root, path, file=path)
        except DataError as error:
            reason = f"{error.got.split(', ')[-1]}, which is not read"
        else:
            if suffix == LIST_SUFFIX:
                found.lists[found.relative(path.with_suffix(""))].append(path)
            else:
                found.maps[found.relative(path.parent)].append(path)
            return
    found.faults.append(Fault(kind=FaultKind.EXTRA, place=found.relative(path), reason=reason))
