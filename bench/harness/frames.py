"""One image from disk to the two things that are scored against each other: segmentation and reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError, UsageError
from bench.evaluation.protocol import Protocol
from bench.geometry import RigidTransform
from bench.harness.exact import is_oracle
from bench.methods import Method, MethodInput, Scorable, Segmentation, UnansweredImage, ask_method
from bench.methods.contract import not_derived, own_copy
from bench.recordings import ImageRef, Recording, read_image
from bench.recordings.input_errors import perturbed_camera, perturbed_motion, perturbed_pixels, perturbed_time_ns
from bench.records.recording import frame_gaps
from bench.records.reference import ReferenceFrame
from bench.reference.build import ReferenceBuilder
from bench.reference.exposure import visible_region

Scalar = TypeVar("Scalar", bound=np.generic)


class UnscorableFrame(Exception):  # noqa: N818 - it is not an error
    """An image that has no history to compare with, or no answer of the method, without any error."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProcessedFrame:
    """All that is needed to score one image, and to look at it.

    Attributes:
        image: which.
        given: what the method saw.
        segmentation: the method's answer.
        reference: what it is scored against.
    """

    image: ImageRef
    given: MethodInput
    segmentation: Segmentation
    reference: ReferenceFrame

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """The current image, (H, W) uint8 grey or (H, W, 3) uint8 BGR."""
        return self.given.images[-1]


class FramePipeline:
    """Processes the images of one camera of a recording; holds as many images as the method looks back.

    Whatever a method is given is a copy: nothing that it does to it reaches the reference or later images. The method
    is a copy, too: what it notes on itself ends with the pipeline.

    Args:
        recording: the drive.
        camera: name of the camera.
        method: asked for segmentations; anything with the history and colour of one where only its input is wanted.
        protocol: the rules of the reference; None where none is wanted.
    """

    def __init__(
        self, recording: Recording, camera: str, *, method: Scorable, protocol: Protocol | None = None
    ) -> None:
        self.recording, self.camera = recording, recording.cameras[camera]
        self.images = recording.images[camera]
        self._protocol = protocol
        self._method = own_copy(method)
        self._valid = _read_only_copy(visible_region(self.camera))
        self._gaps = frame_gaps(recording, camera)
        self._held: dict[int, NDArray[np.uint8] | DataError] = {}
        self._pose_times_ns = [perturbed_time_ns(image.timestamp_ns, recording.input_errors) for image in self.images]
        self._poses = recording.trajectory.at(np.array(self._pose_times_ns, dtype=np.int64))
        told = perturbed_camera(self.camera, recording.input_errors)
        self._perturbed_mounting = told.vehicle_from_camera
        self._camera_given, self._road_given = deepcopy((told.model, told.road))

    @cached_property
    def references(self) -> ReferenceBuilder:
        """Builds the reference of the images."""
        assert self._protocol is not None, "the reference is by a protocol"
        return ReferenceBuilder(self.recording, self.camera.name, self._protocol.reference)

    def process(self, index: int) -> ProcessedFrame:
        """Process the image of an index, at least `method.history` from the start.

        Raises:
            DataError: an image, a sweep or the ego-motion of the frame cannot be used.
            UnscorableFrame: the images before it are missing, or the method has no answer.
        """
        given, reference = self.method_input(index), self.reference(index)
        answer = self.ask(index, given, lambda: reference)
        return ProcessedFrame(image=self.images[index], given=given, segmentation=answer, reference=reference)

    def reference(self, index: int) -> ReferenceFrame:
        """The reference of an image.

        Raises:
            DataError: a sweep or the ego-motion of the image cannot be used.
        """
        return self.references.build(self.images[index])

    def ask(self, index: int, given: MethodInput, reference: Callable[[], ReferenceFrame]) -> Segmentation:
        """The method's answer, or an oracle's.

        Args:
            index: of the image.
            given: what the method may see of it.
            reference: called for oracles alone.

        Raises:
            MethodError: the method raised, or its answer is none.
            UnscorableFrame: it has no answer for this image.
        """
        if is_oracle(self._method):
            return self._method.answer(self.recording, self.images[index], reference())
        if not isinstance(self._method, Method):
            raise UsageError(f"{self._method.name}: {not_derived(type(self._method).__name__)}")
        try:
            return ask_method(self._method, given)
        except UnansweredImage as reason:
            raise UnscorableFrame(str(reason)) from reason

    def method_input(self, index: int) -> MethodInput:
        """Return what a method may see of the images up to `index`."""
        first = index - self._method.history
        for later in range(first + 1, index + 1):
            if later in self._gaps:
                raise UnscorableFrame(
                    f"{self.images[later].path}: {self._gaps[later] / 1e6:.1f} ms after the image "
                    f"before it, where {self.recording.frame_interval_ns / 1e6:.1f} ms are due"
                )
        first = self._oldest(first)
        images: Sequence[NDArray[np.uint8]] = _ImagesOnDemand(range(first, index + 1), self._copied)
        if self._method.reads_images:
            images = tuple(images)  # a damaged image is an error even if it is not used
        self._held = {i: held for i, held in self._held.items() if i >= index - self._method.most_history}
        return MethodInput(
            images=images,
            timestamps_ns=tuple(image.timestamp_ns for image in self.images[first : index + 1]),
            camera=self._camera_given,
            road=self._road_given,
            current_from_previous=self._motions(first, index),
            valid=_read_only_copy(self._valid),
            rolling_shutter=self.camera.rolling_shutter,
            recording=self.recording.name,
            camera_name=self.camera.name,
        )

    def _motions(self, first: int, last: int) -> tuple[RigidTransform, ...]:
        """Motion of the camera between consecutive images of a range, as the method is told of it."""
        poses = [self._world_from_vehicle(i) for i in range(first, last + 1)]
        seconds = (np.diff([image.timestamp_ns for image in self.images[first : last + 1]]) / 1e9).tolist()
        mounting, errors = self._perturbed_mounting, self.recording.input_errors
        return tuple(
            perturbed_motion(previous, current, seconds=step, vehicle_from_camera=mounting, errors=errors)
            for (previous, current), step in zip(pairwise(poses), seconds, strict=True)
        )

    def _world_from_vehicle(self, index: int) -> RigidTransform:
        """The pose at an image, as the method is told of it; DataError where there is none."""
        rotations, positions_m, valid = self._poses
        if not valid[index]:  # this raises, with what is missing
            return self.recording.trajectory.world_from_vehicle(self._pose_times_ns[index])
        return RigidTransform(rotations[index], positions_m[index])

    def _oldest(self, first: int) -> int:
        """The oldest image for a method that can use more than it needs: without a gap, readable, with ego-motion."""
        spare = self._method.most_history - self._method.history
        for earlier in range(first - 1, max(first - spare, 0) - 1, -1):
            try:
                if earlier + 1 in self._gaps:
                    return earlier + 1
                self._pixels(earlier)
                self._world_from_vehicle(earlier)
            except DataError:
                return earlier + 1
        return max(first - spare, 0)

    def _pixels(self, index: int) -> NDArray[np.uint8]:
        """An image as the method is told of it; its file is read once, also where it cannot be used."""
        if index not in self._held:
            image, errors = self.images[index], self.recording.input_errors
            try:
                pixels = read_image(image, self.camera, colour=self._method.colour)
                self._held[index] = perturbed_pixels(pixels, image, recording=self.recording.name, errors=errors)
            except DataError as error:
                self._held[index] = error
        held = self._held[index]
        if isinstance(held, DataError):
            raise held
        return held

    def _copied(self, index: int) -> NDArray[np.uint8]:
        return _read_only_copy(self._pixels(index))


def _read_only_copy(array: NDArray[Scalar]) -> NDArray[Scalar]:
    copy = array.copy()
    copy.flags.writeable = False
    return copy


@dataclass(frozen=True, kw_only=True)
class InputOnly(Scorable):
    """Stands for methods where only their input is wanted: it is never asked.

    Attributes:
        history: earlier images that have to be there.
        longest_history: earlier images where there are as many.
        colour: BGR instead of grey.
    """

    name = "input-only"

    history: int = 1
    longest_history: int = 1
    colour: bool = False


class _ImagesOnDemand(Sequence[NDArray[np.uint8]]):
    """Images that are read on access."""

    def __init__(self, indices: range, read: Callable[[int], NDArray[np.uint8]]) -> None:
        self._indices, self._read = indices, read

    def __len__(self) -> int:
        return len(self._indices)

    def __getitem__(self, key: Any) -> Any:
        return (
            _ImagesOnDemand(self._indices[key], self._read)
            if isinstance(key, slice)
            else self._read(self._indices[key])
        )
