"""The rules of the gate, as versioned files; a file of one's own takes over what it does not say itself."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from bench.errors import UnknownNameError
from bench.evaluation.definitions import find_metric
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.plain_yaml import known_rules, read_rules
from bench.recordings.validation import FileModel, validated

DEFAULT = "default-v1"


def _metric(name: str) -> str:
    try:
        return find_metric(name).name
    except UnknownNameError as error:
        raise ValueError(f"a metric: {error}") from error


MetricName = Annotated[str, AfterValidator(_metric)]


class Tolerance(FileModel):
    """Largest loss of a metric of a slice that is tolerated. What a file leaves out stays as it was.

    Attributes:
        absolute: in the metric's own unit, 0.01 for one percentage point of a ratio.
        relative: share of the baseline's value.
        decides: whether the gate fails by it; of others a loss is only reported.
    """

    absolute: Annotated[float, Field(ge=0)] | None = None
    relative: Annotated[float, Field(ge=0, lt=1)] | None = None
    decides: bool | None = None

    def allowed(self, baseline: float) -> float:
        """The largest change for the worse that is tolerated."""
        return max(self.absolute or 0.0, (self.relative or 0.0) * abs(baseline))


def _can_fail(tolerances: dict[str, Tolerance]) -> dict[str, Tolerance]:
    """Refuse a tolerance that nothing can exceed: a ratio is in [0, 1], so that 0.01 is a percentage point."""
    for name, own in tolerances.items():
        if find_metric(name).is_ratio and (own.absolute or 0.0) >= 1:
            raise ValueError(
                f"{name}: absolute: a share below 1, as 0.05 for five points; {own.absolute:g} never fails"
            )
    return tolerances


ByMetric = Annotated[dict[MetricName, Tolerance], AfterValidator(_can_fail)]


class Tolerances(FileModel):
    """All rules of the gate.

    Attributes:
        name: of the rules.
        version: of the rules.
        changed_data: whether other bytes of the data, with the same reference, fail or are only reported.
        suspect: whether a metric that decides fails, or is only reported, where it is worse than tolerated but not
            beyond chance.
        min_cases: slices with fewer object-frames (image-frames for metrics of images) are not judged.
        min_recordings: metrics with cases in fewer recordings are not judged.
        metrics: metric -> what differs from its definition in all slices.
        slices: slice or shell pattern -> metric -> what differs there.
    """

    name: Annotated[str, Field(min_length=1)]
    version: Annotated[int, Field(ge=1)]
    changed_data: Literal["fail", "report"]
    suspect: Literal["fail", "report"]
    min_cases: Annotated[int, Field(ge=1)]
    min_recordings: Annotated[int, Field(ge=FEWEST_RECORDINGS)]
    metrics: ByMetric = Field(default_factory=dict)
    slices: dict[str, ByMetric] = Field(default_factory=dict)

    @property
    def title(self) -> str:
        """Name and version."""
        return f"{self.name} version {self.version}"

    def tolerance(self, slice_name: str, metric: str) -> Tolerance | None:
        """The rule of a metric in a slice; None for a metric that neither its definition nor the file tolerates.

        Headlines decide, over everything and by kind of motion, unless the file says otherwise; breakdowns cut the same
        object-frames once more.
        """
        definition = find_metric(metric)
        fitting = [own for pattern, own in self.slices.items() if _fits(slice_name, pattern)]
        stated = [own[metric] for own in (self.metrics, *fitting) if metric in own]
        if definition.tolerated is None and not stated:
            return None
        absolute, relative = definition.tolerated or (0.0, 0.0)
        rule = Tolerance(absolute=absolute, relative=relative, decides=definition.headline and "=" not in slice_name)
        for own in stated:
            rule = rule.model_copy(update=own.model_dump(exclude_none=True))
        return rule


def void_rules(tolerances: Tolerances, rows: Iterable[tuple[str, str]]) -> list[str]:
    """Rules of a file that are of no row, as `iou of object_class=tram`.

    Args:
        tolerances: the rules.
        rows: slice and metric of each.
    """
    there = set(rows)
    rules = [("*", metric) for metric in tolerances.metrics]
    rules += [(pattern, metric) for pattern, own in tolerances.slices.items() for metric in own]
    return [
        metric if pattern == "*" else f"{metric} of {pattern}"
        for pattern, metric in rules
        if not any(metric == name and _fits(slice_name, pattern) for slice_name, name in there)
    ]


_SHIPPED = Path(__file__).parent / "tolerances"


def known_tolerances() -> tuple[str, ...]:
    """Names of the files in the package."""
    return known_rules(_SHIPPED)


def load_tolerances(name_or_path: str | Path = DEFAULT) -> Tolerances:
    """Read the tolerances of the package by name, or any others by the path of their YAML file.

    Raises:
        UnknownNameError: neither a name nor a file.
        DataError: not tolerances; says the field.
    """
    content, file = read_rules(name_or_path, shipped=_SHIPPED, kind="tolerances")
    return validated(Tolerances, content, file=file)


def _fits(slice_name: str, pattern: str) -> bool:
    # Bins are written "[0, 2)", which a shell pattern would read as a set of characters.
    return slice_name == pattern or fnmatchcase(slice_name, pattern.replace("[", "[[]"))
