"""Masks of an image by many methods at once: it is decoded once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.errors import UsageError
from bench.evaluation.protocol import Protocol
from bench.harness.frames import FramePipeline, InputOnly, UnscorableFrame
from bench.methods import Method, MethodInput, Scorable, UnansweredImage, ask_method, build_method
from bench.methods.settings import parse_settings
from bench.recordings import Recording
from bench.records.reference import ReferenceFrame
from bench.reference.build import ReferenceBuilder
from benchmarks.ranking.wrong_masks import WrongMasks

# What `--methods all` stands for: real methods, good and bad, then exact masks that are wrong in known ways.
REAL = (
    "spherical spherical:flow=dis spherical:first_guess=true rigid-scene epipolar-only positive-depth-only "
    "positive-height-only anti-parallel-only spherical-sparse spherical-visual-odometry frame-difference "
    "background-subtraction flow-magnitude everything nothing"
)
WRONG = (
    "cell_size_px=5 grow_px=-3 grow_px=4 grow_px=10 shape=hull shape=box shape=box:grow_px=4 shift_px=2 shift_px=5 "
    "lag_images=1 lag_images=2 lag_images=4 shape=upper_half shape=feet drop_share=0.1 drop_share=0.25 drop_share=0.5 "
    "ghost_widths=0.5 ghost_widths=1 ghost_widths=3 merge_px=20 merge_px=80 shadow=0.3 shadow=0.8"
)
ALL_PREDICTIONS = (*REAL.split(), "truth", *(f"truth:{how}" for how in WRONG.split()))
OUTLINES, OBJECTS = "outlines", "objects"  # kinds of errors of wrong masks


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """A method with its settings, or the exact masks in one of their variants.

    Attributes:
        name: as the command line says it, for example "spherical:flow=dis".
        method: what answers.
    """

    name: str
    method: Scorable

    @property
    def real(self) -> bool:
        """True for a method that can be run on real data; False for what is made of the exact masks."""
        return not isinstance(self.method, WrongMasks)

    @property
    def exact(self) -> bool:
        """True for the exact masks as they are."""
        return isinstance(self.method, WrongMasks) and self.method == WrongMasks()

    @property
    def error(self) -> str | None:
        """Kind of the error of a mask that is made of the exact ones: `OUTLINES` or `OBJECTS`; None for all others."""
        if not isinstance(self.method, WrongMasks) or self.exact:
            return None
        return OBJECTS if self.method.changes_objects else OUTLINES


class CameraPredictions:
    """The masks of all predictions on the images of one camera, image by image.

    Args:
        recording: simulated.
        camera: name of the camera.
        predictions: at least one.
        protocol: of the reference that decides which objects move.
    """

    def __init__(
        self,
        recording: Recording,
        camera: str,
        *,
        predictions: Sequence[Prediction],
        protocol: Protocol,
    ) -> None:
        self._recording, self._predictions = recording, predictions
        methods = [prediction.method for prediction in predictions]
        self.history = max(method.history for method in methods)
        longest = max(method.most_history for method in methods)
        self._pipelines = {}
        for colour in sorted({method.colour for method in methods}):
            together = InputOnly(history=self.history, longest_history=longest, colour=colour)
            self._pipelines[colour] = FramePipeline(recording, camera, method=together, protocol=protocol)
        self._pipeline = next(iter(self._pipelines.values()))
        self.images, self.camera = self._pipeline.images, self._pipeline.camera

    @property
    def references(self) -> ReferenceBuilder:
        """Builds the reference of the protocol."""
        return self._pipeline.references

    def masks(self, index: int, reference: ReferenceFrame, ids: NDArray[np.uint16]) -> list[NDArray[np.bool_]]:
        """Return the mask of every prediction, (H, W) bool each, in their order.

        Args:
            index: of the image, at least `history`.
            reference: of the image, by the protocol.
            ids: (H, W) uint16, the image's true instance ids.

        Raises:
            BenchError: something of the image cannot be used, or a method failed.
            UnscorableFrame: images before it are missing, or a method has no answer.
        """
        inputs = {colour: pipeline.method_input(index) for colour, pipeline in self._pipelines.items()}
        return [self._mask(prediction, inputs, reference, ids) for prediction in self._predictions]

    def _mask(
        self,
        prediction: Prediction,
        inputs: dict[bool, MethodInput],
        reference: ReferenceFrame,
        ids: NDArray[np.uint16],
    ) -> NDArray[np.bool_]:
        method = prediction.method
        if isinstance(method, WrongMasks):
            found = method.of_truth(ids, self._recording, reference)
        else:
            assert isinstance(method, Method), "no other can be scored"
            given = shortened_input(inputs[method.colour], method.most_history)
            try:
                found = ask_method(method, given)
            except UnansweredImage as reason:
                raise UnscorableFrame(f"{prediction.name}: {reason}") from reason
        height, width = reference.valid.shape
        return found.mask_at(width, height)


def shortened_input(given: MethodInput, history: int) -> MethodInput:
    """The input of a method that looks back less far.

    Args:
        given: with as many images as the one that looks back farthest is given.
        history: most earlier images.
    """
    first = max(len(given.images) - history - 1, 0)
    return replace(
        given,
        images=given.images[first:],
        timestamps_ns=given.timestamps_ns[first:],
        current_from_previous=given.current_from_previous[first:],
    )


def parse_predictions(text: str) -> tuple[Prediction, ...]:
    """Build the methods of a list with commas, settings behind colons: `spherical,spherical:flow=dis:cell_size_px=4`.

    Args:
        text: the list, or "all".

    Raises:
        UsageError: a method or a setting that does not exist.
    """
    written = ALL_PREDICTIONS if text == "all" else [part.strip() for part in text.split(",")]
    return tuple(Prediction(name=name, method=_built(name)) for name in written)


def _built(written: str) -> Scorable:
    words = written.split(":")
    settings = parse_settings([word for word in words if "=" in word])
    name = ":".join(word for word in words if "=" not in word)  # "module:Class" has a colon of its own
    if name != "truth":
        return build_method(name, settings)
    try:
        return WrongMasks(**settings)  # type: ignore[arg-type]
    except TypeError as error:
        raise UsageError(f"truth: {error}") from error
