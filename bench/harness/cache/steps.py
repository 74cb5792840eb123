"""The cached steps of one unit's images: of a method, and the reference."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from bench.harness.cache.folder import Arrays, CacheFolder
from bench.harness.cache.reference_arrays import reference_arrays, reference_from_arrays
from bench.harness.digests import MethodCode, RecordingInputs, code_digest, digest_of
from bench.harness.digests.content import METHOD_PACKAGES, REFERENCE_CODE
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
        reach_ns = builder.settings.max_sweep_gap_ns
        digest = digest_of(
            code_digest(REFERENCE_CODE),
            builder.settings,
            self.inputs.camera(image.camera),
            self.inputs.ego_motion,
            self.inputs.lidar_mounting,
            self.inputs.annotations,
            self.inputs.sweeps(image.timestamp_ns, image.timestamp_ns, reach_ns=reach_ns),
            image.timestamp_ns,
            None if image.moving_path is None else self.inputs.image(image),
        )
        found = self.folder.get("reference", digest)
        if found is None:
            built = builder.build(image)
            self.folder.put("reference", digest, reference_arrays(built))
            return built
        return reference_from_arrays(
            found,
            recording=self.recording.name,
            camera=image.camera,
            timestamp_ns=image.timestamp_ns,
            valid=builder.valid,
            annotated=self.recording.annotated.covers(image.timestamp_ns),
        )
