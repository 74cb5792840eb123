"""Flow on cells, computed once per pair of images and setting, and kept on disk for the next sweep.

One `.npz` of float32 arrays per recording, camera, chunk of images and flow setting; half precision would move flow of
16 px by up to 0.008 px and with it cells at the threshold, and a sweep must give what a run gives. A file's name is a
digest of all that its content depends on: flow, cell size, noise, the images' names, sizes and times of change, the
size at which they are evaluated, the code of `bench.flow`, the versions of this package and of OpenCV.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import bench
from bench.harness.units import Unit
from bench.recordings import Recording, replacing

LIMIT_BYTES = 2_000_000_000
Flow = NDArray[np.float32]


@dataclass(kw_only=True)
class FlowShelf:
    """The flow of one unit's images by one setting.

    Attributes:
        file: where it is kept.
        computed: how many flows were computed.
        read: how many were found.
    """

    file: Path
    computed: int = 0
    read: int = 0
    _stored: np.lib.npyio.NpzFile | None = None
    _new: dict[str, Flow] = field(default_factory=dict)

    def __post_init__(self) -> None:
        try:
            self._stored = np.load(self.file)
        except (OSError, ValueError, zipfile.BadZipFile):  # none yet, or damaged: computed anew
            self._stored = None

    def take(self, timestamp_ns: int, compute: Callable[[], Flow]) -> Flow:
        """The flow of the image of a time, (rows, columns, 2) float32, px."""
        name = str(timestamp_ns)
        found = self._new.get(name)
        if found is None:
            found = self._from_file(name)
        if found is not None:
            self.read += 1
            return found
        self.computed += 1
        self._new[name] = compute()
        return self._new[name]

    def close(self, *, room_bytes: int) -> None:
        """Keep what is new, unless that takes more than `room_bytes`."""
        old = {} if self._stored is None or not self._new else {name: self._stored[name] for name in self._stored.files}
        if self._stored is not None:
            self._stored.close()
        content = old | self._new
        if self._new and sum(flow.nbytes for flow in content.values()) <= room_bytes:
            with replacing(self.file) as temporary:
                np.savez(temporary, **content)  # type: ignore[arg-type]

    def _from_file(self, name: str) -> Flow | None:
        try:
            return None if self._stored is None or name not in self._stored.files else self._stored[name]
        except (OSError, ValueError, zipfile.BadZipFile):
            return None


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowCache:
    """A folder of flow; it may be deleted at any time.

    Attributes:
        folder: where the files lie.
        limit_bytes: beyond this nothing is added; flow is then computed whenever it is needed.
    """

    folder: Path
    limit_bytes: int = LIMIT_BYTES

    def shelf(self, recording: Recording, unit: Unit, setting: object) -> FlowShelf:
        """The flow of a unit.

        Args:
            recording: of the unit.
            unit: which images.
            setting: all that decides the flow beside the images; its `repr` counts.
        """
        digest = hashlib.sha256(f"{code_digest()} {setting!r} {recording.name} {unit!r}".encode())
        model = recording.cameras[unit.camera].model
        digest.update(f"{model.width} x {model.height}".encode())
        for image in recording.images[unit.camera]:
            state = image.path.stat() if image.path.exists() else None
            told = "missing" if state is None else f"{state.st_size} {state.st_mtime_ns}"
            digest.update(f"{image.path.name} {image.timestamp_ns} {told}\n".encode())
        return FlowShelf(file=self.folder / f"{digest.hexdigest()[:32]}.npz")

    @property
    def room_bytes(self) -> int:
        """How much may still be added."""
        return self.limit_bytes - sum(file.stat().st_size for file in self.folder.glob("*.npz"))


@cache
def code_digest() -> str:
    """Digest of the code that computes flow."""
    digest = hashlib.sha256(f"{bench.__version__} {cv2.__version__}".encode())
    for file in sorted(resources.files("bench.flow").iterdir(), key=lambda file: file.name):
        if file.name.endswith(".py"):
            digest.update(file.read_bytes())
    return digest.hexdigest()
