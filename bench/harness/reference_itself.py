"""The reference, scored against itself: every metric must be perfect, or the evaluation is wrong.

It is no method: methods never see annotations. The harness alone knows it, answers in its place with the reference of
the image, and a run's stamp says so: `sees_the_reference`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from bench.errors import UsageError
from bench.methods import Method, MethodInput, Segmentation, build_method, known_methods
from bench.reference import ReferenceFrame


class ReferenceItself:
    """The reference in the place of a method: a check of the evaluation, which every metric must pass with 1 or 0."""

    name: ClassVar[str] = "reference"
    history: ClassVar[int] = 1
    reads_images: ClassVar[bool] = False

    def __init__(self, *, sees_the_reference: bool = True) -> None:
        if sees_the_reference is not True:
            raise UsageError(f"reference: it sees the reference and nothing else, got {sees_the_reference!r}")

    def settings(self) -> dict[str, object]:
        """No parameters, and the mark by which a table tells it from methods."""
        return {"sees_the_reference": True}

    def segment(self, frame: MethodInput) -> Segmentation:
        """Refuse: from what methods are given nobody can answer with the reference."""
        del frame
        raise UsageError("reference: it can be run and viewed, not swept or audited; it never looks at an image")


def repeat_reference(reference: ReferenceFrame) -> Segmentation:
    """The moving objects of the reference as a segmentation."""
    return Segmentation(cell_size_px=1, mask=reference.labels > 0)


HARNESS_METHODS = {"reference": "bench.harness.reference_itself:ReferenceItself"}


def scorable_methods() -> dict[str, str]:
    """Name -> "module:Class" of all that can be scored: the methods, and what only the harness knows."""
    return known_methods() | HARNESS_METHODS


def build_scorable(name: str, parameters: Mapping[str, object] | None = None) -> Method:
    """Build anything that can be scored; see `bench.methods.build_method`.

    Raises:
        UnknownNameError: no such method.
        UsageError: it cannot be imported, or refuses a parameter.
    """
    return build_method(HARNESS_METHODS.get(name, name), parameters)
