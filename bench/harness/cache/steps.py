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
from bench.methods.contract import StepOf
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

    def of_image(self, given: MethodInput, images: Sequence[ImageRef], *, colour: bool) -> ImageSteps:
        """The cached steps of a method on an image.

        Args:
            given: what the method sees.
            images: the images that it sees, in the same order.
            colour: it sees them in colour.
        """
        return ImageSteps(cache=self, given=given, images=images, colour=colour)

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
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageSteps:
    """See `bench.methods.contract.CachedStep`.

    Attributes:
        cache: where to look.
        given: what the method sees.
        images: the images that it sees.
        colour: it sees them in colour.
    """

    cache: StepCache
    given: MethodInput
    images: Sequence[ImageRef]
    colour: bool

    def __call__(self, step: str, settings: object, compute: Callable[[], Arrays], *, of: StepOf) -> Arrays:
        """The step's arrays, from the cache or computed and then stored."""
        digest = digest_of(self.cache.of_all_images, step, settings, self._seen(of))
        found = self.cache.folder.get(step, digest)
        if found is None:
            found = compute()
            self.cache.method_code.refuse_change()
            self.cache.folder.put(step, digest, found)
        return found

    def _seen(self, of: StepOf) -> str:
        inputs, model = self.cache.inputs, self.given.camera
        pixels = (
            (model.width, model.height, self.colour),
            [inputs.image(ref) for ref in self.images],
            self._noise,
        )
        if of == "images":
            return digest_of(pixels)
        return digest_of(
            pixels,
            self.given.timestamps_ns,
            inputs.camera(self.given.camera_name),
            inputs.input_errors,
            self.given.current_from_previous,
            self.given.recording,
        )

    @property
    def _noise(self) -> object:
        """Values that the noise of the images depends on; None without noise, so that all other errors share flow."""
        strength_grey = self.cache.inputs.input_errors.image_noise_grey
        seeds = self.given.recording, self.given.camera_name, self.given.timestamps_ns
        return (strength_grey, *seeds) if strength_grey else None
