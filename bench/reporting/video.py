"""Video files, written picture by picture."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import OutputError, ShapeError, UsageError
from bench.recordings.atomic import replacing

# The codecs that the OpenCV wheel carries; H.264 is not among them for its licence. Browsers play .webm only.
CODECS = {".mp4": "mp4v", ".webm": "VP90", ".avi": "MJPG"}


class VideoFile:
    """A video that is being written; see `video_file`."""

    def __init__(self, path: Path, named: Path, frame_rate_hz: float) -> None:
        self._path, self._named, self._rate_hz = path, named, frame_rate_hz
        self._writer: cv2.VideoWriter | None = None
        self._size = (0, 0)
        self.pictures = 0

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Append a picture, (H, W, 3) BGR uint8, of one size throughout.

        Raises:
            ShapeError: another size than the first picture's.
            UsageError: this OpenCV cannot write such files.
        """
        size = picture.shape[1], picture.shape[0]
        if self._writer is None:
            self._writer, self._size = self._opened(size), size
        if size != self._size:
            raise ShapeError(f"video: expected pictures of {self._size}, got {size}")
        self._writer.write(np.ascontiguousarray(picture))
        self.pictures += 1

    def close(self) -> None:
        """Finish the file."""
        if self._writer is not None:
            self._writer.release()

    def check(self) -> None:
        """Read the finished file: OpenCV does not tell that a disk is full.

        Raises:
            OutputError: it does not hold the pictures.
        """
        video = cv2.VideoCapture(str(self._path))
        told, held = video.get(cv2.CAP_PROP_FRAME_COUNT), 0  # by the file's own end, and what comes before it
        while video.grab():
            held += 1
        video.release()
        with self._path.open("rb") as file:
            head = file.read(8)
        length = int.from_bytes(head[4:], "little") + 8 if head.startswith(b"RIFF") else 0  # .avi, its last picture too
        if not self.pictures == told == held or length > self._path.stat().st_size:
            got = "a file that ends before its last picture"
            raise OutputError(self._named, got=got, do="make room, then give the same command again")

    def _opened(self, size: tuple[int, int]) -> cv2.VideoWriter:
        codec = CODECS[self._named.suffix.lower()]
        self._path.touch()  # OpenCV tells a place that cannot be written no other than a missing codec
        writer = cv2.VideoWriter(str(self._path), cv2.VideoWriter.fourcc(*codec), self._rate_hz, size)
        if not writer.isOpened():
            raise UsageError(
                f"{self._named}: expected a codec for {self._named.suffix} in this OpenCV, got none ({codec}); "
                f"try another of {', '.join(CODECS)}"
            )
        return writer


@contextmanager
def video_file(path: Path, *, frame_rate_hz: float) -> Iterator[VideoFile]:
    """A video file that appears whole or not at all; without any picture none is made.

    Args:
        path: .mp4, .webm or .avi.
        frame_rate_hz: pictures per second.

    Yields:
        Takes the pictures.

    Raises:
        UsageError: a suffix or a codec that cannot be written.
        OutputError: the file cannot be written, or not to its end.
    """
    refuse_other_suffix(path)
    with replacing(path) as temporary:
        video = VideoFile(temporary, path, frame_rate_hz)
        try:
            yield video
        finally:
            video.close()
        if not video.pictures:
            raise UsageError(f"{path}: expected at least one picture for a video, got none")
        video.check()


def refuse_other_suffix(path: Path) -> None:
    """Refuse a file that is no video by its suffix.

    Raises:
        UsageError: it is not.
    """
    if path.suffix.lower() not in CODECS:
        raise UsageError(f"video: expected a file {', '.join('*' + s for s in CODECS)}, got {path.name!r}")
