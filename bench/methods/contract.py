"""What a segmentation method is given and what it gives back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from bench.cameras import CameraModel
from bench.geometry import RigidTransform, RoadPlane

Scalar = TypeVar("Scalar", bound=np.generic)
StepOf = Literal["images", "input"]
Arrays = dict[str, NDArray[Any]]


class CachedStep(Protocol):
    """Caches what a method computes on an image for the next run, in which other parameters may have changed."""

    def __call__(self, step: str, settings: object, compute: Callable[[], Arrays], *, of: StepOf) -> Arrays:
        """A step's arrays: from an earlier run where everything that they depend on is the same, else computed.

        Args:
            step: name of the step, for example "flow".
            settings: every parameter of the method that decides the arrays.
            compute: computes them.
            of: what they depend on beside the settings: "images" for pixels alone, "input" for all that the method is
                given. The method's code and the files that it lists in `files` count by themselves.
        """
        ...


def compute_anew(step: str, settings: object, compute: Callable[[], Arrays], *, of: StepOf) -> Arrays:  # noqa: ARG001
    """Where there is no cache."""
    return compute()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MethodInput:
    """Consecutive images with calibration and ego-motion; never annotations.

    The arrays are read-only: what a method wants to change, it copies.

    Attributes:
        images: `history + 1` images, oldest first, the current one last, and more for methods that can use more; (H, W)
            uint8 grey, or (H, W, 3) uint8 BGR for methods that ask for colour.
        timestamps_ns: one per image.
        camera: the lens, at the images' size.
        road: the road below the camera.
        current_from_previous: camera motion of each consecutive pair, oldest pair first; one fewer than images.
        valid: (H, W) bool; inside the lens's field and off the host's own body.
        recording: name of the recording; empty where nobody says.
        camera_name: name of the camera; empty where nobody says.
        cached_step: finds what the method computed in an earlier run; methods with an expensive step
            call it.
    """

    images: Sequence[NDArray[np.uint8]]
    timestamps_ns: tuple[int, ...]
    camera: CameraModel
    road: RoadPlane
    current_from_previous: tuple[RigidTransform, ...]
    valid: NDArray[np.bool_]
    recording: str = ""
    camera_name: str = ""
    cached_step: CachedStep = compute_anew


class UnansweredImage(Exception):  # noqa: N818 - it is not an error
    """A method has nothing to say on an image, for a reason that is nobody's fault; the image stays unscored."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segmentation:
    """A method's word on the current image, on square cells that tile it from the first pixel.

    Attributes:
        cell_size_px: side of a cell; 1 for every pixel.
        mask: (rows, columns) bool; moving. It belongs to the current, that is the last, image.
        likelihood: (rows, columns) float32; motion likelihood, 0 where undefined; None for a method without one.
        undefined: (rows, columns) bool; where the method could not say and so says static; None for nowhere.
        causes: names of what can flag a cell, for example the constraints; empty for a method without any.
        cause: (rows, columns) uint8, index into `causes` of the largest contribution; None without causes.
        likelihood_is_score: the likelihood is a score in [0, 1], for example a network's, not the paper's mean of
            angles; it decides the bins of histograms and the scale of pictures.
        parts: named (rows, columns) float arrays to look at, for example the single deviations and the flow; they may
            be missing where a step was found in the cache.
    """

    cell_size_px: int
    mask: NDArray[np.bool_]
    likelihood: NDArray[np.float32] | None = None
    undefined: NDArray[np.bool_] | None = None
    causes: tuple[str, ...] = ()
    cause: NDArray[np.uint8] | None = None
    parts: dict[str, NDArray[np.float32]] | None = None
    likelihood_is_score: bool = False

    def mask_at(self, width: int, height: int) -> NDArray[np.bool_]:
        """The mask at every pixel of the image: (height, width) bool."""
        return self._spread(self.mask, width, height)

    def undefined_at(self, width: int, height: int) -> NDArray[np.bool_]:
        """Pixels of cells where the method could not say: (height, width) bool."""
        if self.undefined is None:
            return np.zeros((height, width), dtype=bool)
        return self._spread(self.undefined, width, height)

    def _spread(self, cells: NDArray[Scalar], width: int, height: int) -> NDArray[Scalar]:
        if self.cell_size_px == 1:
            return cells
        rows = np.repeat(cells, self.cell_size_px, axis=1)  # within rows first: they are few yet
        return np.repeat(rows, self.cell_size_px, axis=0)[:height, :width]


class Method(Protocol):
    """A segmentation method: it is built once per run and called once per frame.

    Attributes:
        name: as the registry knows it.
        history: earlier images that it needs, at least 1 for anything that moves.

    What else it may have as an attribute, and what holds where it has none, is in `Needs`.
    """

    name: str
    history: int

    def settings(self) -> dict[str, object]:
        """Every parameter that decides the result, for provenance and caching."""
        ...

    def segment(self, frame: MethodInput) -> Segmentation:
        """Say which cells of the current image move."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Needs:
    """What a method asks of those who call it; all but `history` are attributes that it may leave out.

    Attributes:
        history: earlier images that it needs.
        longest_history: earlier images that it can use; `history` without it. It is given up to so many, fewer at the
            start of a drive, after a gap and after an image that cannot be read. So it is scored on the same images as
            a method that needs `history`, wherever a drive is cut into pieces.
        colour: it wants BGR images; grey ones without it.
        reads_images: False for a method that does without images: they are then read only if it, or somebody who draws
            a picture, looks at them. True without it.
        files: paths of the files and folders that it reads, for example weights; none without it. Results that were
            stored are found again only as long as settings, code and the content of these files are the same.
    """

    history: int
    longest_history: int
    colour: bool
    reads_images: bool
    files: Any

    @classmethod
    def of(cls, method: Method) -> Needs:
        """What a method asks for."""
        return cls(
            history=method.history,
            longest_history=max(getattr(method, "longest_history", method.history), method.history),
            colour=getattr(method, "colour", False),
            reads_images=getattr(method, "reads_images", True),
            files=getattr(method, "files", ()),
        )
