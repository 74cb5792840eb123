"""The cached steps of one unit's images: of a method, and the reference."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.harness.cache.folder import Arrays, CacheFolder
from bench.harness.digests import MethodCode, RecordingInputs, code_digest, digest_of
from bench.harness.digests.content import METHOD_PACKAGES, REFERENCE_CODE
from bench.harness.reference_files import ImageEntry, label_image
from bench.methods import MethodInput
from bench.methods.contract import CachedStep, StepOf
from bench.recordings import ImageRef, Recording
from bench.reference import ReferenceBuilder, ReferenceFrame


@dataclass(frozen=True, kw_only=True, eq=False)
class StepCache:
    """Finds the steps of images of a recording in a cache, and stores those that it does not find.

    Attributes:
        folder: the cache.
        recording: the drive.
        inputs: digests of it.
        method_code: of the method whose steps they are.
        unreported: settings that were asked for and that the method does not report, by name. A method that forgets
            them there forgets them in the settings of its steps, too.
    """

    folder: CacheFolder
    recording: Recording
    inputs: RecordingInputs
    method_code: MethodCode
    unreported: Mapping[str, object]

    @cached_property
    def of_all_images(self) -> str:
        """Digest of the code, the files and the unreported settings that a method's steps depend on."""
        return digest_of(code_digest(METHOD_PACKAGES), self.method_code.steps_digest, self.unreported)

    def of_image(self, given: MethodInput, images: Sequence[ImageRef], *, colour: bool) -> CachedStep:
        """The cached steps of a method on an image.

        Args:
            given: what the method sees.
            images: the images that it sees, in the same order.
            colour: it sees them in colour.
        """

        def cached_step(step: str, settings: object, compute: Callable[[], Arrays], *, of: StepOf) -> Arrays:
            seen = self._seen(given, images, of=of)
            digest = digest_of(self.of_all_images, step, settings, seen, colour)
            found = self.folder.get(step, digest)
            if found is None:
                found = compute()
                self.method_code.refuse_change()
                self.folder.put(step, digest, found)
            return found

        return cached_step

    def _seen(self, given: MethodInput, images: Sequence[ImageRef], *, of: StepOf) -> str:
        """Digest of what a step depends on beside the method: pixels, or all that the method is given."""
        model, errors = given.camera, self.inputs.input_errors
        seeds = (given.recording, given.camera_name, given.timestamps_ns)  # of noise; without any, flow is the same
        noise = (errors.image_noise_grey, *seeds) if errors.image_noise_grey else None
        pixels = (model.width, model.height, [self.inputs.image(ref) for ref in images], noise)
        if of == "images":
            return digest_of(pixels)
        camera = self.inputs.camera(given.camera_name)
        return digest_of(pixels, given.timestamps_ns, camera, errors, given.current_from_previous, given.recording)

    def reference(self, builder: ReferenceBuilder, image: ImageRef) -> ReferenceFrame:
        """The reference of an image; see `ReferenceBuilder.build`."""
        time_ns, reach_ns = image.timestamp_ns, builder.settings.max_sweep_gap_ns
        digest = digest_of(
            code_digest(REFERENCE_CODE),
            builder.settings,
            self.inputs.of_reference(image.camera, time_ns, time_ns, reach_ns=reach_ns),
            time_ns,
            None if image.moving_path is None else self.inputs.image(image),
        )
        found = self.folder.get("reference", digest)
        if found is None:
            built = builder.build(image)
            self.folder.put("reference", digest, _reference_arrays(built))
            return built
        return _reference(found, self.recording.name)


def _reference_arrays(frame: ReferenceFrame) -> Arrays:
    """A reference as arrays: its entry of an export, the polygons, and the runs of pixels of one label and object."""
    outlines = [None if item.polygon is None else item.polygon.wkb_hex for item in frame.objects]
    labels, instances = label_image(frame).ravel(), frame.labels.ravel()
    change = (labels[1:] != labels[:-1]) | (instances[1:] != instances[:-1])
    starts = np.concatenate([[0], np.flatnonzero(change) + 1])
    return {
        "entry": _bytes(ImageEntry.of(frame).model_dump_json()),
        "outlines": _bytes(json.dumps(outlines)),
        "starts": starts.astype(np.int32),
        "labels": labels[starts],
        "instances": instances[starts],
    }


def _reference(arrays: Arrays, recording: str) -> ReferenceFrame:
    """The reference again, equal in every value."""
    image = ImageEntry.model_validate_json(arrays["entry"].tobytes())
    shape, lengths = (image.height, image.width), np.diff(arrays["starts"], append=image.height * image.width)
    labels = np.repeat(arrays["labels"].astype(np.uint8, copy=False), lengths).reshape(shape)
    instances = np.repeat(arrays["instances"].astype(np.int32, copy=False), lengths).reshape(shape)
    frame = image.frame(recording, instances, labels)
    outlines = json.loads(arrays["outlines"].tobytes())
    polygons = [None if outline is None else shapely.from_wkb(outline) for outline in outlines]
    drawn = [replace(item, polygon=polygon) for item, polygon in zip(frame.objects, polygons, strict=True)]
    return replace(frame, objects=tuple(drawn))


def _bytes(text: str) -> NDArray[np.uint8]:
    return np.frombuffer(text.encode(), dtype=np.uint8)
