"""Frames as a film: a video, a log for the viewer rerun, or both in one pass.

The viewer knows pinhole cameras only, so what a fisheye sees is drawn here and logged as a flat picture, beside the
path, the lidar in the world, and boxes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.atomic import refuse_foreign, replacing
from bench.errors import OutputError, ShapeError, UsageError
from bench.harness import FramePipeline
from bench.harness.frames import UnscorableFrame
from bench.harness.stages import Progress
from bench.recordings import Cuboid, ImageRef, Recording, read_image
from bench.reporting.canvas import figure_pixels
from bench.reporting.formats import image_name
from bench.reporting.frame import Layers, SeenSweep, SweepViewer, draw_frames, reference_layers, scored_layers

# The codecs that the OpenCV wheel carries; H.264 is not among them for its licence. Browsers play .webm only.
CODECS = {".mp4": "mp4v", ".webm": "VP90", ".avi": "MJPG"}


class VideoFile:
    """A video that is being written, by `video_file`."""

    def __init__(self, path: Path, named: Path, frame_rate_hz: float) -> None:
        self._path, self._named, self._rate_hz = path, named, frame_rate_hz
        self._writer: cv2.VideoWriter | None = None
        self._size = (0, 0)
        self.pictures = 0

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Append a picture, (H, W, 3) BGR uint8, of one size throughout; without the last row or column if odd.

        Raises:
            ShapeError: another size than the first picture's.
            UsageError: this OpenCV cannot write such files.
        """
        even = picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]  # as codecs need it
        size = even.shape[1], even.shape[0]
        if self._writer is None:
            self._writer, self._size = self._opened(size), size
        if size != self._size:
            raise ShapeError(f"video: expected pictures of {self._size}, got {size}")
        self._writer.write(np.ascontiguousarray(even))
        self.pictures += 1

    def close(self) -> None:
        """Finish the file."""
        if self._writer is not None:
            self._writer.release()

    def check(self) -> None:
        """Read the finished file: OpenCV does not report that a disk is full.

        Raises:
            OutputError: it does not hold the pictures.
        """
        video = cv2.VideoCapture(str(self._path))
        stated, held = video.get(cv2.CAP_PROP_FRAME_COUNT), 0  # by the file's own end, and what comes before it
        while video.grab():
            held += 1
        video.release()
        with self._path.open("rb") as file:
            head = file.read(8)
        length = int.from_bytes(head[4:], "little") + 8 if head.startswith(b"RIFF") else 0  # .avi, its last picture too
        if not self.pictures == stated == held or length > self._path.stat().st_size:
            got = "a file that ends before its last picture"
            raise OutputError(self._named, got=got, hint="free some disk space, then run the same command again")

    def _opened(self, size: tuple[int, int]) -> cv2.VideoWriter:
        codec = CODECS[self._named.suffix.lower()]
        self._path.touch()  # OpenCV reports a path that cannot be written as it does a missing codec
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
        OutputError: the file is there, cannot be written, or not to its end.
    """
    refuse_other_suffix(path)
    refuse_foreign(path)
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


TIMELINE = "exposure"
NEAR_STATE_NS = 60_000_000
POINT_RADIUS_M = 0.03
LEAST_ROOM_BYTES = 65_536  # with less the library waits for ever


class RerunLog:
    """A log that is being written, by `rerun_log`."""

    def __init__(self, rerun: ModuleType, stream: Any, recording: Recording) -> None:
        self._rr, self._stream, self._recording = rerun, stream, recording
        stream.log("world", rerun.ViewCoordinates.FLU, static=True)
        path_m = recording.trajectory.positions_m.astype(np.float32)
        stream.log("world/path", rerun.LineStrips3D([path_m]), static=True)
        outline = np.column_stack([recording.vehicle_outline_m, np.zeros(len(recording.vehicle_outline_m))])
        stream.log("world/vehicle/outline", rerun.LineStrips3D([np.vstack([outline, outline[:1]])]), static=True)

    def add(self, image: ImageRef, picture: NDArray[np.uint8], seen: SeenSweep | None) -> None:
        """Log one image.

        Args:
            image: which.
            picture: (H, W, 3) BGR uint8, its overlay.
            seen: its lidar sweep, if there is one.

        Raises:
            DataError: no ego-motion at the image.
        """
        rr, stream = self._rr, self._stream
        stream.set_time(TIMELINE, timestamp=np.datetime64(image.timestamp_ns, "ns"))
        pose = self._recording.trajectory.world_from_vehicle(image.timestamp_ns)
        stream.log("world/vehicle", rr.Transform3D(translation=pose.translation_m, mat3x3=pose.rotation))
        rgb = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
        stream.log(f"images/{image.camera}", rr.Image(rgb).compress(jpeg_quality=90))
        if seen is not None:
            stream.log("world/lidar", rr.Points3D(seen.points_world.astype(np.float32), radii=POINT_RADIUS_M))
        self._boxes(image.timestamp_ns)

    def _boxes(self, time_ns: int) -> None:
        centres, halves, turns, labels = [], [], [], []
        for track in self._recording.tracks:
            state = track.state_near(time_ns, within_ns=NEAR_STATE_NS)
            if state is None or not isinstance(state.shape, Cuboid):
                continue
            pose = self._recording.trajectory.world_from_vehicle(state.timestamp_ns) @ state.shape.vehicle_from_object
            centres.append(pose.translation_m)
            halves.append(state.shape.size_m / 2)
            turns.append(Rotation.from_matrix(pose.rotation).as_quat(scalar_first=False))
            labels.append(f"{track.object_class} {track.track_id}")
        boxes = self._rr.Boxes3D(
            centers=np.array(centres).reshape(-1, 3),
            half_sizes=np.array(halves).reshape(-1, 3),
            quaternions=np.array(turns).reshape(-1, 4),
            labels=labels,
        )
        self._stream.log("world/objects", boxes)


@contextmanager
def rerun_log(path: Path, *, recording: Recording, cameras: Sequence[str]) -> Iterator[RerunLog]:
    """A file for the viewer that appears whole or not at all.

    Args:
        path: *.rrd.
        recording: the drive.
        cameras: names of the cameras whose images are logged.

    Yields:
        Takes the frames.

    Raises:
        UsageError: the viewer's library is not installed, or another suffix.
        OutputError: the file is there, cannot be written, or not to its end.
    """
    rerun = viewer()
    refuse_other_log(path)
    refuse_foreign(path)
    with replacing(path) as temporary:
        stream = rerun.RecordingStream("fisheye-bench", recording_id="-".join([recording.name, *cameras]))
        temporary.write_bytes(bytes(LEAST_ROOM_BYTES))
        with _write_errors(path):
            stream.save(str(temporary))
        try:
            yield RerunLog(rerun, stream, recording)
            with _write_errors(path):
                stream.flush()
        finally:
            stream.disconnect()


@contextmanager
def _write_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except RuntimeError as error:  # the library's thread that writes has ended; why, it prints itself
        raise OutputError(path, got=str(error), hint="free some disk space, then run the same command again") from error


def viewer() -> ModuleType:
    """The viewer's library, which is optional.

    Raises:
        UsageError: it is not installed.
    """
    try:
        import rerun
    except ImportError as error:
        raise UsageError(
            f"--rrd: expected the optional viewer rerun, got none ({error}); "
            "install it: pip install 'fisheye-bench[viewer]', or write a --video instead"
        ) from error
    module: ModuleType = rerun
    return module


def refuse_other_log(path: Path) -> None:
    """Refuse a file that is not *.rrd.

    Raises:
        UsageError: it is not.
    """
    if path.suffix.lower() != ".rrd":
        raise UsageError(f"--rrd: expected a file *.rrd, got {path.name!r}")


def refuse_other_files(*, video: Path | None, rrd: Path | None) -> None:
    """Refuse what `write_film` could not write, before anything is rendered.

    Raises:
        UsageError: another suffix, or no viewer.
    """
    if video is not None:
        refuse_other_suffix(video)
    if rrd is not None:
        refuse_other_log(rrd)
        viewer()


def write_film(
    pipeline: FramePipeline,
    indices: range,
    *,
    video: Path | None,
    rrd: Path | None,
    lidar: bool,
    made_by: str,
    with_method: bool,
    progress: Progress,
) -> list[Path]:
    """Draw frames, those without a score as they are.

    Args:
        pipeline: processes the images of a camera.
        indices: of images, in steps that give the rate.
        video: the video file; None for none.
        rrd: the file for the viewer; None for none.
        lidar: draw lidar points into the pictures.
        made_by: method and protocol, in every picture.
        with_method: ask the method; else the reference is drawn alone.
        progress: called with the pictures done and their number.

    Returns:
        The files.

    Raises:
        UsageError: as `refuse_other_files`, or a codec that is missing.
        OutputError: a file cannot be written.
        DataError: an image or sweep cannot be read.
    """
    recording, camera = pipeline.recording, pipeline.camera
    sweeps = SweepViewer(recording, camera)
    rate_hz = 1e9 / recording.frame_interval_ns / indices.step
    with ExitStack() as stack:
        film = None if video is None else stack.enter_context(video_file(video, frame_rate_hz=rate_hz))
        log = None if rrd is None else stack.enter_context(rerun_log(rrd, recording=recording, cameras=[camera.name]))
        for number, index in enumerate(indices, start=1):
            image = pipeline.images[index]
            sweep = sweeps.see(image) if lidar or log is not None else None
            shown = sweep if lidar else None
            try:
                if with_method:
                    layers = scored_layers(pipeline.process(index), label=made_by, sweep=shown)
                else:
                    pixels, reference = read_image(image, camera), pipeline.reference(index)
                    layers = reference_layers(pixels, reference, label=made_by, sweep=shown)
            except UnscorableFrame as reason:
                pixels = read_image(image, camera)
                layers = Layers(pixels=pixels, reference=None, label=made_by, note=f"no score: {reason}")
            figure = draw_frames([layers], name=image_name(recording.name, camera.name, image.timestamp_ns))
            picture = figure_pixels(figure)
            if film is not None:
                film.add(picture)
            if log is not None:
                log.add(image, picture, sweep)
            progress(number, len(indices))
    return [file for file in (video, rrd) if file is not None]
