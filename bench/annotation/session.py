"""One drive under review: its review in memory and on disk, and what the page asks of it.

Times are told to the page in nanoseconds since the first sweep, which its numbers hold exactly.
"""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from bench.annotation.decisions import ReviewedTrack, State, after, history, opening, replayed
from bench.annotation.doubts import EXPLAINED
from bench.annotation.drawing import Lasso, draw_track
from bench.annotation.export import to_track
from bench.annotation.store import (
    Decision,
    Draw,
    Redo,
    Review,
    SetBox,
    Undo,
    parse_decision,
    read_review,
    review_file,
    write_review,
)
from bench.annotation.views import encoded_image, lens_limit_rad, lens_table, packed_sweep, region_outlines
from bench.errors import DataError, UsageError
from bench.evaluation import load_protocol
from bench.recordings import MOTION_KINDS, OBJECT_CLASSES, Recording
from bench.recordings.validation import FileModel, parse_json
from bench.reference import ReferenceBuilder

Json = dict[str, Any]
PROTOCOL = "surface-v1"  # whose reference the page outlines
AROUND_NS = 2_000_000_000  # an image, of a track whose reference is outlined there


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
            raise DataError(
                recording.root, expected="lidar sweeps, which are reviewed", got=f"none in {recording.name!r}"
            )
        self.recording, self._reviewer = recording, reviewer
        self.file = review_file(folder, recording.name)
        self._lock, self._drawing = Lock(), Lock()
        self._builders: dict[str, ReferenceBuilder] = {}
        empty = Review(dataset=dataset, recording=recording.name)
        self.review = read_review(self.file) if self.file.exists() else empty
        self._on_disk = _file_state(self.file)
        self._proposed = opening(self.review)
        self._state = replayed(self._proposed, self.review.decisions)
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
                    "mounting": _numbers(camera.vehicle_from_camera.matrix),
                    "times": [image.timestamp_ns - self._start_ns for image in self.recording.images[name]],
                }
                for name, camera in self.recording.cameras.items()
            ],
            **self.changes({}),
        }

    def work(self) -> Json:
        """Count what is left to do: tracks that are undecided, those of them in doubt, sweeps that were not watched."""
        undecided = [track for track in self._state.values() if track.status == "open"]
        return {
            "undecided": len(undecided),
            "doubted": sum(bool(track.doubts) for track in undecided),
            "unwatched": sum(not self.review.covers([int(time_ns)]) for time_ns in self._times_ns),
        }

    def changes(self, before: State) -> Json:
        """Tracks that are new or changed since `before`, those that are gone, and how far the review is."""
        made, taken_back = history(self.review.decisions)
        return {
            "tracks": [self._track(track) for name, track in self._state.items() if before.get(name) is not track],
            "gone": [name for name in before if name not in self._state],
            "order": list(self._state),
            "watched": [[first - self._start_ns, last - self._start_ns] for first, last in self.review.watched_ns],
            "decisions": len(made),
            "undone": len(taken_back),
            "last": _in_words(made[-1]) if made else None,
        }

    def decide(self, content: bytes) -> Json:
        """Carry out a decision that the page sends, and store it.

        Args:
            content: JSON of a decision; its times since the first sweep, without time and name of the reviewer.

        Raises:
            UsageError: unknown words, or a decision that cannot be carried out; nothing changes.
            OutputError: it cannot be stored; nothing changes.
        """
        return self._add(parse_decision(json.dumps(self._complete(content)).encode()))

    def draw(self, content: bytes) -> Json:
        """Make a track from the points inside of a lasso, and follow it through the drive.

        Raises:
            UsageError: too few points.
            DataError: unknown words, or sweeps that cannot be read.
        """
        lasso = parse_json(Lasso, content, Path("lasso"))
        taken = {track.id for track in self.review.tracks} | set(self._state)
        taken |= {one.drawn.id for one in self.review.decisions if isinstance(one, Draw)}
        name = next(name for i in range(1, len(taken) + 2) if (name := f"d{i:03d}") not in taken)
        drawn = draw_track(self.recording, lasso, name=name)
        return self._add(Draw(made_at=datetime.now(UTC), reviewer=self._reviewer, drawn=drawn))

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
            self._store(self.review.watched(int(self._times_ns[span.first]), int(self._times_ns[span.last])))
            return self.changes(self._state)

    def sweep(self, index: int) -> bytes:
        """Return a sweep as `packed_sweep` does.

        Raises:
            IndexError: no such sweep.
            DataError: it cannot be read.
        """
        return packed_sweep(_at(self.recording.sweeps, index).read(), self.recording)

    def image(self, camera: int, index: int) -> tuple[bytes, Json]:
        """Return an image as JPEG, and where its camera was: the rows of camera_from_world.

        Raises:
            IndexError: no such camera or image.
            DataError: it cannot be read.
        """
        name = _at(tuple(self.recording.cameras), camera)
        mounted, image = self.recording.cameras[name], _at(self.recording.images[name], index)
        world_from_vehicle = self.recording.trajectory.world_from_vehicle(image.timestamp_ns)
        camera_from_world = (world_from_vehicle @ mounted.vehicle_from_camera).inverse()
        return encoded_image(image, mounted), {"camera_from_world": _numbers(camera_from_world.matrix)}

    def lens(self, camera: int) -> bytes:
        """Return the table of a lens as `lens_table` does.

        Raises:
            IndexError: no such camera.
        """
        return lens_table(self.recording.cameras[_at(tuple(self.recording.cameras), camera)].model)

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
        key = parse_decision(json.dumps(self._complete(content)).encode())
        if not isinstance(key, SetBox):
            raise UsageError(f"outline: expected set_box, got {key.action}")
        name = _at(tuple(self.recording.cameras), camera)
        shown = _at(self.recording.images[name], image)
        nothing = region_outlines(None, self.recording.cameras[name].model)
        try:
            track = after(self._state, key)[key.track]
        except UsageError:
            return nothing
        near = np.abs(track.motion.times_ns - shown.timestamp_ns) <= AROUND_NS
        if not near.any():
            return nothing
        track = replace(track, motion=track.motion.where(near))
        with self._drawing:
            tracks = (to_track(track, self.recording, reviewed=False),)
            recording, settings = replace(self.recording, tracks=tracks), load_protocol(PROTOCOL).reference_settings()
            builder = ReferenceBuilder(recording, name, settings, beside=self._builders.get(name))
            self._builders[name] = builder  # which holds the sweep for the next
            return region_outlines(builder.region(track.id, shown), builder.camera.model)

    def _add(self, decision: Decision) -> Json:
        with self._lock:
            review = self.review.model_copy(update={"decisions": (*self.review.decisions, decision)})
            undoing = isinstance(decision, Undo | Redo)
            state = replayed(self._proposed, review.decisions) if undoing else after(self._state, decision)
            if undoing:  # an equal track is the same object, so that only what changed is sent
                state = {name: self._known(track) for name, track in state.items()}
            told = None
            if undoing:
                made, taken_back = history(self.review.decisions)
                undo = isinstance(decision, Undo)
                told = f"{'Taken back' if undo else 'Done again'}: {_in_words((made if undo else taken_back)[-1])}"
            self._store(review)
            before, self._state = self._state, state
            return self.changes(before) | {"told": told}

    def _known(self, track: ReviewedTrack) -> ReviewedTrack:
        known = self._state.get(track.id, track)
        return known if known is track or self._track(known) == self._track(track) else track

    def _store(self, review: Review) -> None:
        if _file_state(self.file) != self._on_disk:
            raise ChangedFileError(f"{self.file}: expected the file that was read, got another; start the review again")
        write_review(self.file, review)
        self.review, self._on_disk = review, _file_state(self.file)

    def _complete(self, content: bytes) -> Json:
        """The decision with time and reviewer, its times since 1970 as the file has them."""
        try:
            values = json.loads(content)
        except (ValueError, RecursionError) as error:
            raise UsageError(f"decision: expected JSON, got {error}") from None
        if not isinstance(values, dict) or {"made_at", "reviewer", "drawn"} & values.keys():
            raise UsageError("decision: expected an object without made_at, reviewer and drawn")
        if isinstance(time_ns := values.get("timestamp_ns"), int):
            values["timestamp_ns"] = time_ns + self._start_ns
        if isinstance(span_ns := values.get("span_ns"), list):
            values["span_ns"] = [t + self._start_ns if isinstance(t, int) else t for t in span_ns]
        return values | {"made_at": datetime.now(UTC).isoformat(), "reviewer": self._reviewer}

    def _track(self, track: ReviewedTrack) -> Json:
        motion = track.motion
        rows = np.column_stack([motion.centres_m, motion.yaws_rad, motion.velocities_mps])
        return {
            "id": track.id,
            "source": track.source,
            "status": track.status,
            "class": track.object_class,
            "category": track.category,
            "unclear": track.unclear,
            "size": np.round(track.size_m, 3).tolist(),
            "doubt": round(track.doubt, 3),
            "doubts": [{"reason": one.reason, "value": one.value} for one in track.doubts],
            "points": track.points_median,
            "times": (motion.times_ns - self._start_ns).tolist(),
            "rows": np.round(rows, 3).tolist(),
            "keys": [time_ns - self._start_ns for time_ns in track.keys],
        }


def _in_words(decision: Decision) -> str:
    """A decision in words, for the page's undo."""
    names = getattr(decision, "tracks", None) or [getattr(decision, "track", "")]
    return " ".join([decision.action.replace("_", " "), *names[:3]]).strip()


def _numbers(matrix: Any) -> list[list[float]]:
    return [[float(value) for value in row] for row in matrix]


def _at(values: Any, index: int) -> Any:
    if not 0 <= index < len(values):  # Python would count from the end
        raise IndexError(index)
    return values[index]


def _file_state(file: Path) -> tuple[int, int, int] | None:
    try:
        found = file.stat()
    except FileNotFoundError:
        return None
    return found.st_ino, found.st_mtime_ns, found.st_size
