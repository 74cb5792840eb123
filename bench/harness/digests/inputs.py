"""Digests of what a unit of work reads of its recording."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import replace

from bench.harness.digests.content import FileDigests, columns_of, digest_of
from bench.recordings import Recording
from bench.records.recording import ImageRef, PointIndices, SweepRef

NEARBY_NS = 2_000_000_000  # annotations further from an image than this have no part in its reference


class RecordingInputs:
    """Digests over the parts of one opened recording, by content.

    Args:
        recording: the drive; its calibration, ego-motion and annotations count as they were read.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording, self._digests = recording, FileDigests()
        trajectory = recording.trajectory
        self.ego_motion = digest_of(
            trajectory.timestamps_ns,
            trajectory.rotations,
            trajectory.positions_m,
            trajectory.max_gap_ns,
            trajectory.max_extrapolation_ns,
        )
        self.annotations = digest_of(
            recording.annotated,
            [(columns_of([replace(track, states=())]), columns_of(track.states)) for track in recording.tracks],
        )
        self.lidar_mounting = digest_of(recording.vehicle_from_lidar, recording.lidar_from_sensor)
        self.input_errors = recording.input_errors
        self._cameras = {name: digest_of(camera) for name, camera in recording.cameras.items()}
        self._named_sweeps = [
            (state.timestamp_ns, state.shape.sweep_timestamp_ns)
            for track in recording.tracks
            for state in track.states
            if isinstance(state.shape, PointIndices)
        ]

    def reread(self) -> RecordingInputs:
        """The same, with every image and sweep read once more."""
        other = copy.copy(self)
        other._digests = FileDigests()
        return other

    def camera(self, name: str) -> str:
        """Digest of a camera's model, mounting, road and body mask."""
        return self._cameras[name]

    def image(self, image: ImageRef) -> str:
        """Digest of an image's pixels, as they are stored, and of the mask of what moves beside it."""
        moving = None if image.moving_path is None else self._digests.of(image.moving_path)
        return digest_of(self._digests.of(image.path, image.stored), moving)

    def images(self, images: Sequence[ImageRef]) -> str:
        """Digest of images and of their times."""
        return digest_of([(image.timestamp_ns, image.scored, self.image(image)) for image in images])

    def truths(self, images: Sequence[ImageRef]) -> str:
        """Digest of the exact masks of images."""
        return digest_of([None if image.truth_path is None else self._digests.of(image.truth_path) for image in images])

    def of_reference(self, camera: str, first_ns: int, last_ns: int, *, reach_ns: int) -> dict[str, str]:
        """Digests of all that references of images of a camera are made of, by name; arguments as of `sweeps`."""
        return {
            "camera": self.camera(camera),
            "ego-motion": self.ego_motion,
            "lidar mounting": self.lidar_mounting,
            "annotations": self.annotations,
            "sweeps": self.sweeps(first_ns, last_ns, reach_ns=reach_ns),
        }

    def sweeps(self, first_ns: int, last_ns: int, *, reach_ns: int) -> str:
        """Digest of the sweeps that references of images of a span of time may read.

        Args:
            first_ns: first exposure.
            last_ns: last exposure.
            reach_ns: how far a sweep may be from an exposure.
        """
        found = self._reached(first_ns, last_ns, reach_ns)
        return digest_of(
            [
                (ref.timestamp_ns, None if ref.stored else ref.reader, self._digests.of(ref.path, ref.stored))
                for ref in found
            ]
        )

    def _reached(self, first_ns: int, last_ns: int, reach_ns: int) -> Iterator[SweepRef]:
        """In time; those that point indices count in among them."""
        named = {
            sweep_ns for state_ns, sweep_ns in self._named_sweeps
            if first_ns - NEARBY_NS <= state_ns <= last_ns + NEARBY_NS
        }  # fmt: skip
        for ref in self._recording.sweeps:
            if first_ns - reach_ns <= ref.timestamp_ns <= last_ns + reach_ns or ref.timestamp_ns in named:
                yield ref
