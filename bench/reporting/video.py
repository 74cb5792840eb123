"""Frames as a video: true and false areas tinted, reference polygons, the lidar sweep, and a line of text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from shapely.affinity import affine_transform

from bench.atomic import refuse_foreign, replacing
from bench.errors import OutputError, ShapeError, UsageError
from bench.evaluation.counts import count_frame
from bench.harness import ProcessedFrame
from bench.recordings import ImageRef, MountedCamera, Recording
from bench.records.reference import ReferenceFrame
from bench.reference.exposure import Readout
from bench.reference.sweeps import SweepCache
from bench.reporting.canvas import GREEN, category_colour
from bench.reporting.overlay import (
    AREA_COLOURS,
    AREA_NAMES,
    UNSCORED_COLOURS,
    Legend,
    PixelClass,
    bgr_image,
    captioned,
    detected_pixels,
    kind_legend,
    outlined,
    overlay_areas,
    overlay_counts,
    overlay_polygons,
    pixel_classes,
)

FARTHEST_SWEEP_NS = 100_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenSweep:
    """A sweep at an exposure.

    Attributes:
        points_world: (N, 3) float64, m.
        points_vehicle: (N, 3) float64, m, vehicle frame at exposure.
        pixels: (K, 2) float64, px, of the points in the image.
        range_m: (K,) float64, m, of these points from the camera.
    """

    points_world: NDArray[np.float64]
    points_vehicle: NDArray[np.float64]
    pixels: NDArray[np.float64]
    range_m: NDArray[np.float64]


class SweepViewer:
    """Projects the sweep nearest to an exposure.

    Args:
        recording: the drive.
        camera: whose images the sweeps are projected into.
    """

    def __init__(self, recording: Recording, camera: MountedCamera) -> None:
        self._recording, self._camera = recording, camera
        self._sweeps = SweepCache(recording, FARTHEST_SWEEP_NS)

    def see(self, image: ImageRef, *, compensated: bool = True) -> SeenSweep | None:
        """The sweep at an exposure; None where there is none within 100 ms, or no ego-motion.

        Args:
            image: the exposure.
            compensated: False for points as they were measured, as if nothing moved meanwhile.

        Raises:
            DataError: the sweep's file cannot be read.
        """
        placed = self._sweeps.nearest(None, image.timestamp_ns)
        if placed is None:
            return None
        world_from_vehicle = self._recording.trajectory.world_from_vehicle(image.timestamp_ns)
        if compensated:
            points_world = placed.points_world()
            points_vehicle = world_from_vehicle.inverse().apply(points_world)
            readout = Readout.at(image.timestamp_ns, trajectory=self._recording.trajectory, camera=self._camera)
        else:
            points_vehicle = self._recording.vehicle_from_lidar.apply(placed.sweep.points_lidar.astype(np.float64))
            points_world, readout = world_from_vehicle.apply(points_vehicle), None
        points_camera = self._camera.vehicle_from_camera.inverse().apply(points_vehicle)
        shown = points_camera if readout is None else readout.seen(points_camera, self._camera.model)
        pixels, valid = self._camera.model.project(shown)
        seen = valid & self._camera.model.contains(pixels)
        return SeenSweep(
            points_world=points_world,
            points_vehicle=points_vehicle,
            pixels=pixels[seen],
            range_m=np.linalg.norm(points_camera[seen], axis=1),
        )


NEAREST_M, FARTHEST_M = 2.0, 40.0
LEAST_WIDTH_PX = 640  # smaller images are enlarged, or nobody can read the lines
LIDAR_COLOUR = "#7ad151"  # the middle of the colours of lidar points


LEGEND = [(colour, AREA_NAMES[area]) for area, colour in AREA_COLOURS.items() if area is not PixelClass.UNKNOWN]
UNKNOWN = (AREA_COLOURS[PixelClass.UNKNOWN], "unknown")
IGNORED = (UNSCORED_COLOURS[PixelClass.IGNORED], "ignored")
LIDAR = (LIDAR_COLOUR, "lidar, yellow near, blue far")


def draw_frame(processed: ProcessedFrame, name: str, seen: SeenSweep | None = None) -> NDArray[np.uint8]:
    """Draw a processed frame.

    Args:
        processed: the frame.
        name: which image it is, of which method and protocol.
        seen: its lidar sweep, if it is to be drawn; near points are yellow, far ones blue.

    Returns:
        (H, W, 3) BGR uint8 of even sides; below the image which one it is, its counts and a legend.
    """
    reference = processed.reference
    frame, objects = count_frame(reference, detected_pixels(processed), component_size_px=0)
    tp, fn = sum(o.tp for o in objects), sum(o.fn for o in objects)
    counts = f"TP {tp}  FN {fn}  FP {frame.fp_px} px   {len(outlined(reference.objects))} objects"
    return _drawn(overlay_counts(processed), reference, [name, counts], LEGEND, seen)


def draw_reference(
    image: NDArray[np.uint8], reference: ReferenceFrame, name: str, seen: SeenSweep | None = None
) -> NDArray[np.uint8]:
    """Draw the reference of an image alone.

    Args:
        image: (H, W) grey or (H, W, 3) BGR uint8.
        reference: of it.
        name: which image it is, of which protocol.
        seen: its lidar sweep, if it is to be drawn.

    Returns:
        (H, W, 3) BGR uint8 of even sides; below the image which one it is, its objects and a legend.
    """
    classes = pixel_classes(reference, detected=reference.labels > 0)
    colours = {**AREA_COLOURS, **UNSCORED_COLOURS}
    areas = {colour: classes == kind for kind, colour in colours.items()}
    objects = f"{len(outlined(reference.objects))} evaluated objects of {len(reference.objects)} annotated ones"
    picture = overlay_areas(image, areas, strength=0.4)
    return _drawn(picture, reference, [name, objects], [(GREEN, "reference")], seen)


def _drawn(
    tinted: NDArray[np.uint8], reference: ReferenceFrame, lines: Sequence[str], legend: Legend, seen: SeenSweep | None
) -> NDArray[np.uint8]:
    """A tinted image, enlarged, with lidar points, outlines, lines of text and a legend."""
    picture, scale = _enlarged(tinted)
    if seen is not None:
        picture = _with_points(picture, seen, scale)
    shown = outlined(reference.objects)
    has_bands = any(target.unknown_px for target, _ in shown)
    shift = 0.5 * scale - 0.5
    picture = overlay_polygons(
        picture,
        polygons=[affine_transform(polygon, [scale, 0, 0, scale, shift, shift]) for _, polygon in shown],
        colours=[category_colour(target.category) for target, _ in shown],
        thickness=1 if has_bands else 2,  # unknown bands stay visible beside it
    )
    has_ignored = (reference.ignored & ~reference.unknown).any()
    drawn = zip((UNKNOWN, IGNORED, LIDAR), (has_bands, has_ignored, seen is not None), strict=True)
    entries = [*legend, *(entry for entry, is_drawn in drawn if is_drawn), *kind_legend(reference)]
    return captioned(picture, lines, legend=entries)


def draw_plain(image: NDArray[np.uint8], name: str, text: str) -> NDArray[np.uint8]:
    """An image that could not be scored, of the size that `draw_frame` gives, with its name and the reason."""
    return captioned(_enlarged(bgr_image(image))[0], [name, text], legend=LEGEND)


def _enlarged(picture: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], int]:
    """The picture at the smallest whole scale that makes it wide enough, and the scale."""
    scale = max(1, -(-LEAST_WIDTH_PX // picture.shape[1]))
    return np.repeat(np.repeat(picture, scale, axis=0), scale, axis=1), scale


def _with_points(picture: NDArray[np.uint8], seen: SeenSweep, scale: int) -> NDArray[np.uint8]:
    share = np.clip(np.log(seen.range_m / NEAREST_M) / np.log(FARTHEST_M / NEAREST_M), 0.0, 1.0)
    levels = np.round(255 * (1.0 - share)).astype(np.uint8)
    colours = np.asarray(cv2.applyColorMap(levels[:, None], cv2.COLORMAP_VIRIDIS), dtype=np.uint8).reshape(-1, 3)
    positions = np.round((seen.pixels + 0.5) * scale - 0.5).astype(np.int64)
    order = np.argsort(-seen.range_m)  # near points over far ones
    drawn = picture.copy()
    rows = np.clip(positions[order, 1], 0, picture.shape[0] - 1)
    columns = np.clip(positions[order, 0], 0, picture.shape[1] - 1)
    drawn[rows, columns] = colours[order]
    return drawn


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
        """Read the finished file: OpenCV does not report that a disk is full.

        Raises:
            OutputError: it does not hold the pictures.
        """
        video = cv2.VideoCapture(str(self._path))
        stated, found = video.get(cv2.CAP_PROP_FRAME_COUNT), 0  # by the file's own end, and what comes before it
        while video.grab():
            found += 1
        video.release()
        with self._path.open("rb") as file:
            head = file.read(8)
        length = int.from_bytes(head[4:], "little") + 8 if head.startswith(b"RIFF") else 0  # .avi, its last picture too
        if not self.pictures == stated == found or length > self._path.stat().st_size:
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
