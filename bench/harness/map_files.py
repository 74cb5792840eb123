"""Image maps as files: plain arrays and an index, no pickles."""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO
from zipfile import BadZipFile

import numpy as np

from bench.errors import DataError
from bench.evaluation import ImageMap
from bench.recordings.atomic import write_bytes

_WORDS = ("camera", "width", "height", "cell_px", "frames")
_GRIDS = ("reference_px", "missed_px", "false_px")


def write_image_maps(file: Path, maps: Sequence[ImageMap]) -> None:
    """Write an `.npz`: `index` (JSON, one entry per map), and `<number>.reference_px` and so on; atomically."""
    write_bytes(file, image_maps_bytes(maps))


def image_maps_bytes(maps: Sequence[ImageMap]) -> bytes:
    """The content of the `.npz`; the same for the same maps."""
    index = [{name: getattr(item, name) for name in _WORDS} for item in maps]
    grids = {f"{number}.{name}": getattr(item, name) for number, item in enumerate(maps) for name in _GRIDS}
    content = io.BytesIO()
    np.savez_compressed(content, index=np.array(json.dumps(index)), **grids)
    return content.getvalue()


def load_image_maps(file: Path, content: BinaryIO | None = None) -> tuple[ImageMap, ...]:
    """Read what `write_image_maps` wrote.

    Args:
        file: that holds it.
        content: the `.npz`, where it is a part of that file; None to read the file.

    Raises:
        DataError: missing or damaged.
    """
    try:
        with np.load(file if content is None else content, allow_pickle=False) as stored:
            index = json.loads(str(stored["index"]))
            return tuple(
                ImageMap(**{name: entry[name] for name in _WORDS}, **{g: stored[f"{number}.{g}"] for g in _GRIDS})
                for number, entry in enumerate(index)
            )
    except FileNotFoundError as error:
        got = "no such file; runs of older versions have none"
        raise DataError(file, expected="the image maps of a run", got=got) from error
    except (OSError, ValueError, KeyError, TypeError, NotImplementedError, BadZipFile, EOFError, zlib.error) as error:
        raise DataError(file, expected="the image maps of a run", got=" ".join(str(error).split())[:200]) from error
