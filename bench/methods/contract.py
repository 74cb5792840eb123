"""Contract of a segmentation method: what it is given, what it gives back, how it is called and its answer checked."""

from __future__ import annotations

import inspect
import json
from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path, PurePath
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, StringConstraints, TypeAdapter, ValidationError

from bench.cameras.model import CameraModel, RollingShutter
from bench.errors import BenchError, DataError, UsageError
from bench.geometry import RigidTransform, RoadPlane
from bench.plug_ins import describe_error, undisturbed
from bench.records.segmentation import Segmentation, segmentation_fault


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
        valid: (H, W) bool; inside the lens's field and outside the ego vehicle's own body.
        rolling_shutter: the camera's readout; the times above are those of the middle row, and the camera's motion is
            that between them. None where all rows are exposed at once.
        recording: name of the recording; empty where it is not known.
        camera_name: name of the camera; empty where it is not known.
    """

    images: Sequence[NDArray[np.uint8]]
    timestamps_ns: tuple[int, ...]
    camera: CameraModel
    road: RoadPlane
    current_from_previous: tuple[RigidTransform, ...]
    valid: NDArray[np.bool_]
    rolling_shutter: RollingShutter | None = None
    recording: str = ""
    camera_name: str = ""


class UnansweredImage(Exception):  # noqa: N818 - it is not an error
    """A method has no answer for an image, and that is no error; the image stays unscored."""


class Scorable:
    """A method, or an oracle of the harness that stands in its place: what a run has to know of either.

    Attributes:
        name: as results call it.
        history: earlier images that it needs, at least 1 for anything that moves.
        longest_history: earlier images that it can use, where that is more. It is given up to so many, fewer at the
            start of a drive, after a gap and after an image that cannot be read. So it is scored on the same images as
            a method that needs `history`, wherever a drive is cut into pieces.
        colour: it wants BGR images instead of grey ones.
        reads_images: False for one that does without images: they are then read only if it, or a picture that is
            drawn, needs them.
        files: paths of the files and folders that it reads, for example weights. Results that were stored are found
            again only as long as settings, code and the content of these files are the same.
    """

    name: str = ""
    history: int = 1
    longest_history: int = 1
    colour: bool = False
    reads_images: bool = True
    files: Sequence[str | Path] = ()

    @property
    def most_history(self) -> int:
        """Earlier images that it is given where there are as many."""
        return max(self.history, self.longest_history)

    def settings(self) -> dict[str, object]:
        """Every parameter that decides the result; by default those of the constructor, as attributes of the same name.

        Raises:
            UsageError: an attribute is missing.
        """
        settings: dict[str, object] = {}
        for name in inspect.signature(type(self)).parameters:
            if not hasattr(self, name):
                raise UsageError(
                    f"method {self.name!r}: expected the attribute {name!r} to hold the constructor's parameter "
                    f"{name!r}, got none; set self.{name}, or write settings()"
                )
            value = getattr(self, name)
            settings[name] = asdict(value) if is_dataclass(value) and not isinstance(value, type) else value
        return settings


class Method(Scorable, ABC):
    """A segmentation method: a subclass gives a `name` and `segment`, and overrides what else differs.

    Each task, up to a hundred consecutive images of a camera, is answered by a copy of the object of its own: what a
    method notes on itself reaches no other task, and one that needs the past says so (`longest_history`). What is
    expensive to load belongs in a function of its module with `functools.lru_cache`, by the digest of the file.

    Nothing else may be noted in a module or a class. A process computes several tasks, so that answers would depend on
    how many processes there are. A run finds most of this out: at its end it asks again for its first image, and fails
    that image where more than a thousandth of the mask is another. Random numbers come from a generator that `segment`
    seeds.

    What is changed of the process, as the working folder, is undone after each answer. An answer is copied when it is
    returned; what becomes of its arrays is no matter.
    """

    @abstractmethod
    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the current image into moving and static cells."""


_ATTRIBUTES = {
    "name": Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)],
    "history": Annotated[int, Field(ge=0)],
    "longest_history": Annotated[int, Field(ge=0)],
    "colour": bool,
    "reads_images": bool,
    "files": Sequence[str | Path],
    "settings()": dict[str, Any],
}


def unlike(kind: Any, value: object, *, strict: bool = False) -> str | None:
    """What was expected of a value of a type, as pydantic understands types; None where the value is of it."""
    try:
        TypeAdapter(kind).validate_python(value, strict=strict)
    except ValidationError as error:
        return (
            error.errors()[0]["msg"]
            .removeprefix("Input should be ")
            .replace("String should", "text to")
            .partition(",")[0]
        )
    return None


def refuse_unfit(method: Scorable) -> None:
    """Refuse a method whose attributes or settings are not what the contract asks for.

    Raises:
        UsageError: names the class and the attribute.
    """
    values = {}
    for name, kind in _ATTRIBUTES.items():
        try:
            values[name] = method.settings() if name == "settings()" else getattr(method, name)
        except BenchError:
            raise
        except Exception as error:  # whatever a property of the method raises
            raise UsageError(f"method of class {type(method).__name__}: {name}: {describe_error(error)}") from error
        if expected := unlike(kind, values[name], strict=True):
            raise UsageError(f"method {_called(method)}: {name}: expected {expected}, got {values[name]!r}")
    settings = values["settings()"]
    try:
        json.dumps(settings, allow_nan=False, default=_text_of_path)
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"method {_called(method)}: settings(): expected finite numbers, text, None, and lists and dictionaries of "
            f"them, got {settings!r}: {error}; convert it, for example by float()"
        ) from error


def _text_of_path(value: object) -> str:
    if isinstance(value, PurePath):
        return str(value)
    raise TypeError(f"{type(value)} is none of these")


def _called(method: Scorable) -> str:
    return f"{method.name!r} of class {type(method).__name__}"


Copied = TypeVar("Copied", bound=Scorable)


def own_copy(method: Copied) -> Copied:
    """A copy of a method as it was built, so that no unit of work finds what another one left.

    Raises:
        UsageError: it holds what cannot be copied.
    """
    try:
        with undisturbed():
            return deepcopy(method)
    except Exception as error:  # whatever its attributes raise
        raise UsageError(
            f"method {method.name!r}: expected an object of {type(method).__name__} that can be copied, since each "
            f"unit has its own, got {describe_error(error)}; load what cannot be copied, such as a session, when "
            f"it is used first, or in a function of the module with functools.lru_cache"
        ) from error


class FlowMethod(Method):
    """A method that also says what it would answer with another flow, by which `audit` explains its misses.

    Attributes:
        blind_at_epipole: what it leaves undefined although both images see it lies near an epipole; without, at the
            border of what both images see.
    """

    blind_at_epipole: bool = False

    @abstractmethod
    def flow_cell_px(self, width: int) -> int:
        """Side of the cells on which it takes flow, px, for images of this width."""

    @abstractmethod
    def mean_flow(self, frame: MethodInput) -> NDArray[np.float32]:
        """Its own flow from the current to the previous image, (rows, columns, 2), px of the given images."""

    @abstractmethod
    def segment_flow(self, frame: MethodInput, flow: NDArray[np.float32]) -> Segmentation:
        """Segment the current image with the flow of others in place of its own.

        Args:
            frame: as of `segment`.
            flow: as from `mean_flow`; NaN where it is not known.
        """


def not_derived(name: str) -> str:
    """The message about a class, or an object of one, that does not derive from `Method`."""
    return (
        f"expected a class derived from bench.methods.Method, got {name}, which is not; write class {name}(Method), "
        f"with `from bench.methods import Method`"
    )


class MethodError(BenchError):
    """A method raised, or its answer is no segmentation of the image; names method, recording and image."""


def ask_method(method: Method, frame: MethodInput) -> Segmentation:
    """The method's segmentation of the current image, checked.

    Args:
        method: which.
        frame: what it is given.

    Raises:
        MethodError: the method raised, tried to exit, or answered with anything but a segmentation of this image.
        UnansweredImage: the method has no answer for this image.
        DataError: a file that the method reads cannot be used.
    """
    try:
        with undisturbed():
            answer = method.segment(frame)
    except (UnansweredImage, DataError, MemoryError, KeyboardInterrupt):
        raise
    except BaseException as error:  # also SystemExit, which must not end a run as a success
        told = str(error) if isinstance(error, BenchError) else describe_error(error)
        raise MethodError(f"{_image_of(method, frame)}: {told}") from error
    height, width = frame.valid.shape
    fault = segmentation_fault(answer, width=width, height=height)
    if fault is not None:
        raise MethodError(f"{_image_of(method, frame)}: {fault}")
    return answer


def _image_of(method: Method, frame: MethodInput) -> str:
    where = f", recording {frame.recording!r}, camera {frame.camera_name!r}" if frame.recording else ""
    return f"method {method.name!r}{where}, image at {frame.timestamps_ns[-1]} ns"
