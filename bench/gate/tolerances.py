"""How much worse a metric may become, as a versioned file; released files are never edited, only superseded."""

from __future__ import annotations

from fnmatch import fnmatchcase
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from bench.errors import DataError, UnknownNameError
from bench.plain_yaml import parse_yaml
from bench.recordings.validation import FileModel, validated

DEFAULT = "default-v1"

NotNegative = Annotated[float, Field(ge=0)]


class Tolerance(FileModel):
    """What a metric may lose.

    Attributes:
        better: direction of the metric.
        absolute: in the metric's own unit, 0.01 for one percentage point of a ratio.
        relative: share of the baseline's value.
        judged: whether the metric can fail.
    """

    better: Literal["higher", "lower"]
    absolute: NotNegative
    relative: NotNegative
    judged: bool = True

    def allowed(self, baseline: float) -> float:
        """The largest change for the worse that is tolerated."""
        return max(self.absolute, self.relative * abs(baseline))

    def worsening(self, difference: float) -> float:
        """How much worse a difference (after minus before) makes the metric; negative for better, NaN stays."""
        return -difference if self.better == "higher" else difference


class Override(FileModel):
    """What differs in a slice; None leaves the metric's own."""

    absolute: NotNegative | None = None
    relative: NotNegative | None = None
    judged: bool | None = None


class BootstrapSettings(FileModel):
    """Draws of the bootstrap that intervals were taken by; stated by released files, of no effect any more."""

    draws: Annotated[int, Field(ge=1000)]
    seed: Annotated[int, Field(ge=0)]


class Tolerances(FileModel):
    """All rules of the gate.

    Attributes:
        name: of the rules.
        version: of the rules.
        changed_data: whether other bytes of the data, with the same reference, fail or are only reported.
        min_cases: slices with fewer object-frames (image-frames for metrics of images) are not judged.
        min_recordings: metrics with cases in fewer recordings are not judged, nor are those under six, which have no
            interval.
        bootstrap: of no effect any more; intervals make no draws.
        metrics: by name; a metric that is not here is reported, not judged.
        slices: slice or shell pattern -> metric -> what differs.
    """

    name: Annotated[str, Field(min_length=1)]
    version: Annotated[int, Field(ge=1)]
    changed_data: Literal["fail", "report"]
    min_cases: Annotated[int, Field(ge=1)]
    min_recordings: Annotated[int, Field(ge=2)]
    bootstrap: BootstrapSettings | None = None
    metrics: Annotated[dict[str, Tolerance], Field(min_length=1)]
    slices: dict[str, dict[str, Override]] = Field(default_factory=dict)

    def tolerance(self, slice_name: str, metric: str) -> Tolerance | None:
        """The rule of a metric in a slice; None for a metric that the file does not name."""
        found = self.metrics.get(metric)
        if found is None:
            return None
        for pattern, overrides in self.slices.items():
            if metric in overrides and _fits(slice_name, pattern):
                found = found.model_copy(update=overrides[metric].model_dump(exclude_none=True))
        return found


def known_tolerances() -> tuple[str, ...]:
    """Names of the files in the package."""
    folder = resources.files("bench.gate") / "tolerances"
    return tuple(sorted(f.name.removesuffix(".yaml") for f in folder.iterdir() if f.name.endswith(".yaml")))


def load_tolerances(name_or_path: str | Path = DEFAULT) -> Tolerances:
    """Read the tolerances of the package by name, or any others by the path of their YAML file.

    A file with `based_on: NAME` takes over what it does not say itself, metric by metric and pattern by pattern.

    Raises:
        UnknownNameError: neither a name nor a file.
        DataError: not tolerances, or an override of a metric that `metrics` does not name; says the field.
    """
    file = str(name_or_path)
    tolerances = validated(Tolerances, _complete(*_read(file)), file=Path(file))
    for pattern, overrides in tolerances.slices.items():
        for metric in overrides:
            if metric not in tolerances.metrics:
                field = f"slices.{pattern}.{metric}"
                raise DataError(file, field=field, expected="a metric that `metrics` names", got=repr(metric))
    return tolerances


def _fits(slice_name: str, pattern: str) -> bool:
    # Bins are written "[0, 2)", which a shell pattern would read as a set of characters.
    return slice_name == pattern or fnmatchcase(slice_name, pattern.replace("[", "[[]"))


def _read(name_or_path: str) -> tuple[dict[str, Any], str]:
    if name_or_path in known_tolerances():
        packaged = resources.files("bench.gate") / "tolerances" / f"{name_or_path}.yaml"
        return _parse(packaged.read_text("utf-8"), str(packaged)), str(packaged)
    path = Path(name_or_path)
    if not path.is_file():
        raise UnknownNameError("tolerances", name_or_path, known_tolerances())
    try:
        return _parse(path.read_text("utf-8"), str(path)), str(path)
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(path, expected="a readable file", got=str(error)) from error


def _parse(text: str, file: str) -> dict[str, Any]:
    content = parse_yaml(text, file=file)
    if not isinstance(content, dict):
        raise DataError(file, expected="keys and values", got=type(content).__name__)
    return content


def _complete(content: dict[str, Any], file: str) -> dict[str, Any]:
    own = dict(content)
    base_name = own.pop("based_on", None)
    if base_name is None:
        return own
    if base_name not in known_tolerances():
        known = ", ".join(known_tolerances())
        raise DataError(file, field="based_on", expected=f"one of {known}", got=repr(base_name))
    base = _complete(*_read(str(base_name)))
    for group in ("metrics", "slices"):
        if isinstance(own.get(group), dict):
            own[group] = base.get(group, {}) | own[group]
    return base | own
