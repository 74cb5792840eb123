"""One drive under review: its review in memory and on disk, and what the page asks of it.

Times are told to the page in nanoseconds since the first sweep, which its numbers hold exactly.
"""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.annotation import store
from bench.annotation.decisions import ReviewedTrack, State, after, applied, history, to_track
from bench.annotation.drawing import Lasso, draw_track, sweep_points_world
from bench.annotation.proposals import EXPLAINED
from bench.cameras.model import CameraModel
from bench.errors import DataError, UsageError
from bench.evaluation.protocol import load_protocol
from bench.lidar.sweep import LidarSweep
from bench.recordings import Recording, read_image
from bench.recordings.validation import FileModel, parse_json
from bench.records.recording import MOTION_KINDS
from bench.records.reference import OBJECT_CLASSES
from bench.reference.build import ReferenceBuilder
from bench.reference.regions import Region

Json = dict[str, Any]
PROTOCOL = "surface-v1"  # whose reference the page outlines
AROUND_NS = 2_000_000_000  # an image, of a track whose reference is outlined there
MOST_POINTS, MOST_GROUND = 30_000, 6_000  # of a sweep; the others are left out evenly
FARTHEST_M = 120.0
CM = 100.0
LARGEST_SIDE_PX = 1280
JPEG_QUALITY = 85
GRID = 129  # of the table of a lens, in both directions
WIDEST_RAD = 2.2


class Asked(FileModel):
    """A decision that the page asks for, with time and reviewer."""

    decision: store.Decision


class Watched(FileModel):
    """Sweeps that were played, both included."""

    first: int
    last: int


class ChangedFileError(UsageError):
    """The file is not the one that was read: another program has written it."""


class Session:
    """A recording and its review; every decision is on disk before it is answered.

    Args:
        recording: the drive, opened; its own annotations are not looked at.
        dataset: name of the data set.
        folder: of the reviews.
        reviewer: who decides.

    Raises:
        DataError: a recording without sweeps, or a review that cannot be used.
    """

    def __init__(self, recording: Recording, *, dataset: str, folder: Path, reviewer: str) -> None:
        if not recording.sweeps:
            got = f"none in {recording.name!r}"
            raise DataError(recording.root, expected="lidar sweeps, which are reviewed", got=got)
        self.recording, self._reviewer = recording, reviewer
        self.file = store.review_file(folder, recording.name)
        self._lock, self._drawing, self._reading = Lock(), Lock(), Lock()
        self._builders: dict[str, ReferenceBuilder] = {}
        empty = store.Review(dataset=dataset, recording=recording.name)
        self.review = store.read_review(self.file) if self.file.exists() else empty
        self._on_disk = _file_state(self.file)
        self._state = applied(self.review)
        self._start_ns = recording.sweeps[0].timestamp_ns
        self._times_ns = np.array([sweep.timestamp_ns for sweep in recording.sweeps], dtype=np.int64)

    def drive(self) -> Json:
        """Tell the page all of the drive that it needs before it draws anything."""
        rotations, positions_m, valid = self.recording.trajectory.at(self._times_ns)
        headings = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
        poses = np.column_stack([positions_m, headings])
        poses[~valid] = 0.0
        return {
            "name": self.recording.name,
            "times": (self._times_ns - self._start_ns).tolist(),
            "poses": np.round(poses, 4).tolist(),
            "outline": np.asarray(self.recording.vehicle_outline_m).tolist(),
            "classes": list(OBJECT_CLASSES),
            "kinds": list(MOTION_KINDS),
            "doubts": EXPLAINED,
            "cameras": [
                {
                    "name": name,
                    "width": camera.model.width,
                    "height": camera.model.height,
                    "limit": lens_limit_rad(camera.model),
                    "mounting": camera.vehicle_from_camera.matrix.tolist(),
                    "times": [image.timestamp_ns - self._start_ns for image in self.recording.images[name]],
                }
                for name, camera in self.recording.cameras.items()
            ],
            **self.changes({}),
        }

    def changes(self, before: State) -> Json:
        """Tracks that are new or changed since `before`, those that are gone, and how far the review is."""
        made, taken_back = history(self.review.decisions)
        return {
            "tracks": [self._track(track) for name, track in self._state.items() if before.get(name) is not track],
            "gone": [name for name in before if name not in self._state],
            "order": list(self._state),
            "watched": [time_ns - self._start_ns for time_ns in self.review.watched_ns],
            "decisions": len(made),
            "undone": len(taken_back),
            "last": _in_words(made[-1]) if made else "",
        }

    def decide(self, content: bytes) -> Json:
        """Carry out a decision that the page sends, and store it.

        Args:
            content: JSON of a decision; its time since the first sweep, without time and name of the reviewer.

        Raises:
            UsageError: unknown words, or a decision that cannot be carried out; nothing changes.
            OutputError: it cannot be stored; nothing changes.
        """
        return self._add(self._parsed(content))

    def draw(self, content: bytes) -> Json:
        """Make a track from the points inside of a lasso, and follow it through the drive.

        Raises:
            UsageError: too few points.
            DataError: unknown words, or sweeps that cannot be read.
        """
        lasso = parse_json(Lasso, content, Path("lasso"))
        taken = {track.id for track in self.review.tracks} | set(self._state)
        taken |= {decision.drawn.id for decision in self.review.decisions if isinstance(decision, store.Draw)}
        name = next(name for i in range(1, len(taken) + 2) if (name := f"d{i:03d}") not in taken)
        drawn = draw_track(self.recording, lasso, name=name)
        return self._add(store.Draw(made_at=datetime.now(UTC), reviewer=self._reviewer, drawn=drawn))

    def watch(self, content: bytes) -> Json:
        """Note that sweeps were played.

        Raises:
            DataError: unknown words.
            UsageError: sweeps that do not exist.
        """
        span = parse_json(Watched, content, Path("watched"))
        last = len(self._times_ns) - 1
        if not 0 <= span.first <= span.last <= last:
            raise UsageError(f"watched: expected sweeps from 0 to {last}, got {span.first} to {span.last}")
        with self._lock:
            self._store(self.review.watched(self._times_ns[span.first : span.last + 1].tolist()))
            return self.changes(self._state)

    def sweep(self, index: int) -> bytes:
        """Return a sweep as `packed_sweep` does.

        Raises:
            IndexError: no such sweep.
            DataError: it cannot be read.
        """
        with self._reading:  # Python 3.11 can fail where threads parse headers of .npz at once (cpython#106905)
            sweep = self.recording.sweeps[index].read()
        return packed_sweep(sweep, self.recording)

    def image(self, camera: int, index: int) -> tuple[bytes, Json]:
        """Return an image as JPEG, made smaller where it is large, and where its camera was: rows of camera_from_world.

        Raises:
            IndexError: no such camera or image.
            DataError: it cannot be read.
        """
        name = list(self.recording.cameras)[camera]
        mounted, image = self.recording.cameras[name], self.recording.images[name][index]
        pixels = read_image(image, mounted, colour=True)
        if (scale := LARGEST_SIDE_PX / max(pixels.shape[:2])) < 1:
            pixels = np.asarray(cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        written, encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        assert written
        world_from_vehicle = self.recording.trajectory.world_from_vehicle(image.timestamp_ns)
        camera_from_world = (world_from_vehicle @ mounted.vehicle_from_camera).inverse()
        return encoded.tobytes(), {"camera_from_world": camera_from_world.matrix.tolist()}

    def lens(self, camera: int) -> bytes:
        """Return the table of a lens as `lens_table` does.

        Raises:
            IndexError: no such camera.
        """
        return lens_table(list(self.recording.cameras.values())[camera].model)

    def outline(self, content: bytes, camera: int, image: int) -> Json:
        """Outline in an image what the reference would be with a box where the page has it; nothing is stored.

        Args:
            content: JSON of a key frame, as `decide` takes it.
            camera: number of the camera.
            image: number of the image.

        Returns:
            As `region_outlines`; of the object alone, as if nothing hid it. Empty where the track has no such box,
            as the page may ask while a split or a merge takes the track away.

        Raises:
            IndexError: no such camera or image.
            UsageError: no key frame.
            DataError: a sweep or the ego-motion cannot be used.
        """
        key = self._parsed(content)
        if not isinstance(key, store.SetBox):
            raise UsageError(f"outline: expected set_box, got {key.action}")
        name = list(self.recording.cameras)[camera]
        shown, model = self.recording.images[name][image], self.recording.cameras[name].model
        try:
            track = after(self._state, key)[key.track]
        except UsageError:
            return region_outlines(None, model)
        near = np.abs(track.motion.times_ns - shown.timestamp_ns) <= AROUND_NS
        if not near.any():
            return region_outlines(None, model)
        track = replace(track, uncorrected=track.motion.where(near), keys={})
        with self._drawing:
            recording = replace(self.recording, tracks=(to_track(track, self.recording, reviewed=False),))
            settings = load_protocol(PROTOCOL).reference
            builder = ReferenceBuilder(recording, name, settings, beside=self._builders.get(name))
            self._builders[name] = builder  # which holds the sweep for the next
            return region_outlines(builder.region(track.id, shown), model)

    def _add(self, decision: store.Decision) -> Json:
        with self._lock:
            review = self.review.model_copy(update={"decisions": (*self.review.decisions, decision)})
            undoing = isinstance(decision, store.Undo | store.Redo)
            state = applied(review) if undoing else after(self._state, decision)
            self._store(review)
            before, self._state = self._state, state
            return self.changes(before)

    def _store(self, review: store.Review) -> None:
        if _file_state(self.file) != self._on_disk:
            raise ChangedFileError(f"{self.file}: expected the file that was read, got another; start the review again")
        store.write_review(self.file, review)
        self.review, self._on_disk = review, _file_state(self.file)

    def _parsed(self, content: bytes) -> store.Decision:
        """The decision with time and reviewer, its time since 1970 as the file has it."""
        try:
            values = json.loads(content)
        except (ValueError, RecursionError) as error:
            raise UsageError(f"decision: expected JSON, got {error}") from None
        if not isinstance(values, dict) or {"made_at", "reviewer", "drawn"} & values.keys():
            raise UsageError("decision: expected an object without made_at, reviewer and drawn")
        if isinstance(time_ns := values.get("timestamp_ns"), int):
            values["timestamp_ns"] = time_ns + self._start_ns
        values |= {"made_at": datetime.now(UTC).isoformat(), "reviewer": self._reviewer}
        return parse_json(Asked, json.dumps({"decision": values}).encode(), Path("page")).decision

    def _track(self, track: ReviewedTrack) -> Json:
        motion = track.motion
        return {
            "id": track.id,
            "status": track.status,
            "class": track.object_class,
            "category": track.category,
            "unclear": track.unclear,
            "size": np.round(track.size_m, 3).tolist(),
            "doubts": [{"reason": doubt.reason, "value": doubt.value} for doubt in track.doubts],
            "points": track.points_median,
            "times": (motion.times_ns - self._start_ns).tolist(),
            "rows": np.round(motion.rows, 3).tolist(),
            "keys": [time_ns - self._start_ns for time_ns in track.keys],
        }


def _in_words(decision: store.Decision) -> str:
    """A decision in words, for the page's undo."""
    names = getattr(decision, "tracks", None) or [getattr(decision, "track", "")]
    return " ".join([decision.action.replace("_", " "), *names[:3]]).strip()


def _file_state(file: Path) -> tuple[int, int, int] | None:
    try:
        state = file.stat()
    except FileNotFoundError:
        return None
    return state.st_ino, state.st_mtime_ns, state.st_size


def packed_sweep(sweep: LidarSweep, recording: Recording) -> bytes:
    """A sweep in few bytes: what stands on the road, then some of the road.

    Returns:
        Little-endian: int32 points, int32 of them on the road (the last), float64 x, y, z of the origin in the world
        (m), int16 x, y, z of each point from there (cm), int8 time of each point minus that of the sweep (ms).

    Raises:
        DataError: as `sweep_points_world`.
    """
    points, ground = sweep_points_world(sweep, recording)
    origin_m = recording.trajectory.world_from_vehicle(sweep.timestamp_ns).translation_m
    near = np.abs(points - origin_m).max(axis=1, initial=0.0) < FARTHEST_M
    standing = _thinned(np.flatnonzero(near & ~ground), MOST_POINTS)
    road = _thinned(np.flatnonzero(near & ground), MOST_GROUND)
    rows = np.concatenate([standing, road])
    cm = ((points[rows] - origin_m) * CM).round().astype("<i2")
    ms = np.clip(np.round((sweep.times_ns[rows] - sweep.timestamp_ns) / 1e6), -127, 127).astype("i1")
    return b"".join((struct.pack("<iiddd", len(rows), len(road), *origin_m), cm.tobytes(), ms.tobytes()))


def _thinned(rows: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    return rows if len(rows) <= most else rows[np.linspace(0, len(rows) - 1, most).astype(np.intp)]


def region_outlines(region: Region | None, camera: CameraModel) -> dict[str, list[list[list[float]]]]:
    """Outlines of a region's pixels: `core`, which is certain, and `possible`, the core and the band around it.

    Returns:
        Closed lines of u and v as parts of the image's width and height; none where the region has no such pixels.
    """
    if region is None:
        return {"core": [], "possible": []}
    rows, columns = region.window
    corner, size = np.array([columns.start, rows.start]) + 0.5, np.array([camera.width, camera.height])
    return {
        name: [
            ((line[:, 0] + corner) / size).round(4).tolist()
            for line in cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
        ]
        for name, mask in (("core", region.core), ("possible", region.possible))
    }


def lens_limit_rad(camera: CameraModel) -> float:
    """Largest angle to the optical axis of the table of a lens."""
    return min(camera.limit_angle_rad, WIDEST_RAD)


def lens_table(camera: CameraModel) -> bytes:
    """Pixels of rays on a grid, to look up between its nodes: any lens in a page that knows none.

    A node (a, b) of the grid, both from -1 to 1, is the ray at the angle r * `lens_limit_rad` from the optical axis in
    the direction (a, b), with r their length.

    Returns:
        (129, 129, 2) float32, little-endian, rows by b: u and v as parts of the image's width and height; NaN where
        the lens maps nothing.
    """
    a, b = np.meshgrid(np.linspace(-1, 1, GRID), np.linspace(-1, 1, GRID))
    radius = np.hypot(a, b)
    angle = radius * lens_limit_rad(camera)
    sideways = np.where(radius > 0, np.sin(angle) / np.where(radius > 0, radius, 1.0), 0.0)
    rays = np.stack([a * sideways, b * sideways, np.cos(angle)], axis=-1).reshape(-1, 3)
    pixels, valid = camera.project(rays)
    pixels[~valid] = np.nan
    parts = (pixels + 0.5) / np.array([camera.width, camera.height])
    return bytes(parts.astype("<f4").data)
