"""Ask a method for the segmentation of an image, and check the answer before anything is counted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bench.errors import BenchError, DataError
from bench.methods.contract import Method, MethodInput, Segmentation, UnansweredImage
from bench.plug_ins import told_of


class MethodError(BenchError):
    """A method raised, or its answer is no segmentation of the image; names method, recording and image."""


def ask_method(method: Method, frame: MethodInput) -> Segmentation:
    """The method's segmentation of the current image, checked.

    Args:
        method: which.
        frame: what it is given.

    Raises:
        MethodError: the method raised, tried to exit, or answered with anything but a segmentation of this image.
        UnansweredImage: the method has nothing to say on this image.
        DataError: a file that the method reads cannot be used.
    """
    try:
        answer = method.segment(frame)
    except (UnansweredImage, DataError, MemoryError, KeyboardInterrupt):
        raise
    except BenchError as error:
        raise MethodError(f"{_place(method, frame)}: {error}") from error
    except BaseException as error:  # also SystemExit, which must not end a run as a success
        raise MethodError(f"{_place(method, frame)}: {told_of(error)}") from error
    height, width = frame.valid.shape
    fault = segmentation_fault(answer, width=width, height=height)
    if fault is not None:
        raise MethodError(f"{_place(method, frame)}: {fault}")
    return answer


def segmentation_fault(answer: object, *, width: int, height: int) -> str | None:
    """What is wrong with a method's answer on an image of `width` x `height` px; None where nothing is."""
    return next(_faults(answer, width, height), None)


def _faults(answer: object, width: int, height: int) -> Iterator[str]:
    if not isinstance(answer, Segmentation):
        yield f"expected a bench.methods.Segmentation from segment(), got {type(answer).__name__}"
        return
    size = answer.cell_size_px
    if isinstance(size, bool) or not isinstance(size, int | np.integer) or size < 1:
        yield f"cell_size_px: expected a whole number of at least 1, got {size!r}"
        return
    shape = -(-height // int(size)), -(-width // int(size))
    yield from _array_faults("mask", answer.mask, shape, np.bool_)
    if answer.undefined is not None:
        yield from _array_faults("undefined", answer.undefined, shape, np.bool_)
    if answer.likelihood is not None:
        yield from _array_faults("likelihood", answer.likelihood, shape, np.floating)
        yield from _likelihood_faults(answer.likelihood, score=answer.likelihood_is_score)
    if not (isinstance(answer.causes, tuple) and all(isinstance(name, str) for name in answer.causes)):
        yield f"causes: expected a tuple of names, got {answer.causes!r}"
        return
    if answer.cause is not None:
        yield from _array_faults("cause", answer.cause, shape, np.uint8)
        if answer.cause.max(initial=0) >= max(len(answer.causes), 1):
            yield f"cause: expected indices into {len(answer.causes)} causes, got {answer.cause.max()}"
    for name, values in (answer.parts or {}).items():
        yield from _array_faults(f"parts[{name!r}]", values, shape, np.floating)


def _array_faults(name: str, values: object, shape: tuple[int, int], kind: type[np.generic]) -> Iterator[str]:
    expected = f"{name}: expected a {shape} array of {'float' if kind is np.floating else kind.__name__.rstrip('_')}"
    if not isinstance(values, np.ndarray):
        yield f"{expected}, got {type(values).__name__}"
    elif values.shape != shape or not np.issubdtype(values.dtype, kind):
        yield f"{expected}, got {values.shape} of {values.dtype}"


def _likelihood_faults(likelihood: NDArray[np.floating], *, score: bool) -> Iterator[str]:
    lowest, highest = float(likelihood.min()), float(likelihood.max())  # NaN passes through both
    if not (np.isfinite(lowest) and np.isfinite(highest)):
        bad = int((~np.isfinite(likelihood)).sum())
        yield f"likelihood: expected finite numbers, 0 where undefined, got {bad} that are NaN or infinite"
    elif lowest < 0 or (score and highest > 1):
        expected = "a score in [0, 1]" if score else "at least 0"
        yield f"likelihood: expected {expected}, got {lowest:g} to {highest + 0.0:g}"


def _place(method: Method, frame: MethodInput) -> str:
    where = f", recording {frame.recording!r}, camera {frame.camera_name!r}" if frame.recording else ""
    return f"method {method.name!r}{where}, image at {frame.timestamps_ns[-1]} ns"
