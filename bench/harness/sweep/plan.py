"""What a sweep is, and the runs that it is made of: values, what each changes, how they are read."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast

from pydantic import ValidationError

from bench.errors import UnknownNameError, UsageError
from bench.evaluation import Protocol
from bench.flow import DENSE_FLOWS, DisFlow, FarnebackFlow, dense_flow
from bench.methods import Method
from bench.methods.spherical.likelihood import CONSTRAINTS, Weights
from bench.recordings import NO_INPUT_ERRORS, InputErrors
from bench.reference import REGION_KINDS

Value = float | int | str
Scale = Literal["linear", "log", "names"]
Part = Literal["method", "reference", "input"]
EVERYTHING = "all"
WITHOUT, ONLY = "without ", "only "
ABLATIONS = (EVERYTHING, *(WITHOUT + name for name in CONSTRAINTS), *(ONLY + name for name in CONSTRAINTS))
FLOWS = ("farneback", "dis:ultrafast", "dis:fast", "dis:medium")
THRESHOLDS = (1e-4, 2e-4, 3e-4, 4.5e-4, 6e-4, 1e-3, 1.5e-3, 2.5e-3, 5e-3, 1e-2)
BOTH_WAYS = (-5.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 5.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """What the run of one value scores.

    Attributes:
        method: with its settings.
        protocol: the rules.
        input_errors: of what the method is told.
    """

    method: Method
    protocol: Protocol
    input_errors: InputErrors = NO_INPUT_ERRORS

    def parameter(self, name: str) -> Any:
        """A parameter of the method.

        Raises:
            UsageError: the method is not a data class with such a field.
        """
        if not (is_dataclass(self.method) and name in {field.name for field in fields(self.method)}):
            raise UsageError(f"sweep: expected a method with the parameter {name!r}, got {self.method.name!r}")
        return getattr(self.method, name)

    def with_parameters(self, **changes: object) -> Setup:
        """The same with other values of parameters of the method.

        Raises:
            UsageError: the method has no such parameter, or refuses the value.
        """
        for name in changes:
            self.parameter(name)
        return replace(self, method=cast(Method, replace(cast(Any, self.method), **changes)))

    def with_rules(self, **changes: object) -> Setup:
        """The same with other rules of the reference.

        Raises:
            UsageError: a value that the protocol does not take.
        """
        content = self.protocol.model_dump(exclude_unset=True)
        content["reference"] |= changes
        try:
            return replace(self, protocol=Protocol.model_validate(content))  # not a copy: it carries an old digest
        except ValidationError as error:
            first = error.errors()[0]
            raise UsageError(f"protocol: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error

    def with_error(self, name: str, value: float) -> Setup:
        """The same with another error of what the method is told."""
        return replace(self, input_errors=replace(self.input_errors, **{name: value}))


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """A sweep by name.

    Attributes:
        title: what the values are, with their unit, as the axis of the chart says.
        about: one line for lists.
        part: what a value changes: the method, the reference, or the input that the method is told.
        scale: how the values lie on an axis; "names" for values that are no numbers.
        values: taken by default.
        change: the setup of a value.
        operating: the value that a setup has of itself.
        least: smallest number that makes sense; None without one.
        whole: whole numbers only.
        choices: the names there are; None for any that `change` takes.
    """

    title: str
    about: str
    part: Part
    scale: Scale
    values: tuple[Value, ...]
    change: Callable[[Setup, Value], Setup]
    operating: Callable[[Setup], Value]
    least: float | None = None
    whole: bool = False
    choices: tuple[str, ...] | None = None

    def parse(self, text: str) -> Value:
        """A value from the command line.

        Raises:
            UsageError: not a number where one is wanted, or out of its domain.
            UnknownNameError: not one of the choices.
        """
        text = text.strip()
        if self.scale == "names":
            if self.choices is not None and text not in self.choices:
                raise UnknownNameError("value", text, self.choices)
            return text
        return self._number(text)

    def _number(self, text: str) -> Value:
        kind = "a whole number" if self.whole else "a number"
        expected = kind if self.least is None else f"{kind} of at least {self.least:g}"
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or (self.whole and number != int(number)):
            raise UsageError(f"--values: expected {expected} ({self.title}), got {text!r}")
        if self.least is not None and number < self.least:
            raise UsageError(f"--values: expected {expected} ({self.title}), got {text!r}")
        return int(number) if self.whole else number


def sweep_named(name: str) -> Sweep:
    """A sweep of the registry.

    Raises:
        UnknownNameError: no such sweep.
    """
    if name not in SWEEPS:
        raise UnknownNameError("sweep", name, SWEEPS)
    return SWEEPS[name]


def _parameter(name: str, title: str, about: str, values: tuple[float, ...], **more: object) -> Sweep:
    """A number among the parameters of a method."""
    return Sweep(
        title=title,
        about=about,
        part="method",
        values=values,
        change=lambda setup, value: setup.with_parameters(**{name: value}),
        operating=lambda setup: setup.parameter(name),
        **({"scale": "log"} | more),  # type: ignore[arg-type]
    )


def _weight(name: str) -> Sweep:
    def change(setup: Setup, value: Value) -> Setup:
        return setup.with_parameters(weights=replace(_weights(setup), **{name: float(value)}))

    return Sweep(
        title=f"weight of {name.replace('_', ' ')}",
        about="the other weights stay; the divisor is their sum",
        part="method",
        scale="linear",
        values=(0.0, 0.1, 0.2, 0.5, 1.0, 2.0),
        change=change,
        operating=lambda setup: getattr(_weights(setup), name),
        least=0.0,
    )


def _farneback(name: str, title: str, values: tuple[int, ...]) -> Sweep:
    def change(setup: Setup, value: Value) -> Setup:
        return setup.with_parameters(flow_parameters={**setup.parameter("flow_parameters"), name: value})

    def operating(setup: Setup) -> Value:
        flow = _dense_flow(setup)
        if not isinstance(flow, FarnebackFlow):
            raise UsageError(f"sweep: expected a method with the flow 'farneback', got {setup.parameter('flow')!r}")
        found: int = getattr(flow, name)
        return found

    return Sweep(
        title=title,
        about="a parameter of the Farnebäck flow",
        part="method",
        scale="linear",
        values=values,
        change=change,
        operating=operating,
        least=1,
        whole=True,
    )


def _change_flow(setup: Setup, value: Value) -> Setup:
    if value == _flow_of(setup):
        return setup
    name, _, preset = str(value).partition(":")
    return setup.with_parameters(flow=name, flow_parameters={"preset": preset} if preset else {})


def _flow_of(setup: Setup) -> str:
    """For example "dis:medium"; a Farnebäck flow with other parameters than its own says so."""
    name, flow = setup.parameter("flow"), _dense_flow(setup)
    if isinstance(flow, FarnebackFlow):
        return name if flow == FarnebackFlow() else f"{name} as set"
    return f"{name}:{flow.preset}"


def _dense_flow(setup: Setup) -> FarnebackFlow | DisFlow:
    return dense_flow(setup.parameter("flow"), **setup.parameter("flow_parameters"))


def _weights(setup: Setup) -> Weights:
    weights = setup.parameter("weights")
    if not isinstance(weights, Weights):
        raise UsageError(f"sweep: expected a method with weights of constraints, got {setup.method.name!r}")
    return weights


def _ablate(setup: Setup, value: Value) -> Setup:
    """Weights of constraints set to 0; the divisor follows their sum, so the threshold weighs what is left."""
    name, weights = str(value), _weights(setup)
    if name == EVERYTHING:
        return setup
    if name.startswith(WITHOUT):
        left = replace(weights, **{name.removeprefix(WITHOUT): 0.0})
    else:
        kept = name.removeprefix(ONLY)
        if getattr(weights, kept) == 0:
            raise UsageError(f"ablation {name!r}: expected a constraint with a weight, got {kept}=0")
        left = Weights(**{f.name: 0.0 for f in fields(Weights)} | {kept: getattr(weights, kept)})
    return setup.with_parameters(weights=left)


def _polygon_kind(setup: Setup, value: Value) -> Setup:
    return setup.with_rules(polygon_kind=value)


def _concave_ratio(setup: Setup) -> Value:
    rules = setup.protocol.reference
    return rules.concave_ratio if rules.polygon_kind == "concave" else 1.0  # 1 is the convex hull


def _error(name: str, title: str, about: str, values: tuple[float, ...], *, least: float | None = None) -> Sweep:
    return Sweep(
        title=title,
        about=about,
        part="input",
        scale="linear",
        values=values,
        change=lambda setup, value: setup.with_error(name, float(value)),
        operating=lambda setup: getattr(setup.input_errors, name),
        least=least,
    )


SWEEPS: dict[str, Sweep] = {
    "threshold": _parameter("threshold", "threshold of the likelihood (≈ rad)", "for a vehicle that moves", THRESHOLDS),
    "static_threshold": _parameter(
        "static_threshold", "threshold of the deviation, stationary vehicle (≈ rad)", "for a stationary vehicle",
        THRESHOLDS,
    ),
    **{f"weights.{name}": _weight(name) for name in CONSTRAINTS},
    "ablation": Sweep(
        title="constraints",
        about="each constraint switched off, and each alone",
        part="method",
        scale="names",
        values=ABLATIONS,
        change=_ablate,
        operating=lambda _: EVERYTHING,
        choices=ABLATIONS,
    ),
    "cell_size_px": _parameter(
        "cell_size_px", "side of a cell (px)", "flow is averaged on cells", (1, 2, 3, 5, 8, 12),
        scale="linear", least=1, whole=True,
    ),
    "flow": Sweep(
        title="dense flow",
        about=f"one of {', '.join(DENSE_FLOWS)}, with a preset behind a colon",
        part="method",
        scale="names",
        values=FLOWS,
        change=_change_flow,
        operating=_flow_of,
        choices=FLOWS,
    ),
    "flow.window_px": _farneback("window_px", "averaging window of Farnebäck (px)", (7, 11, 15, 21, 31)),
    "flow.levels": _farneback("levels", "pyramid levels of Farnebäck", (1, 2, 3, 4, 5)),
    "polygon_kind": Sweep(
        title="polygon around the lidar points",
        about="convex is the paper's bounding polygon",
        part="reference",
        scale="names",
        values=tuple(REGION_KINDS),
        change=_polygon_kind,
        operating=lambda setup: setup.protocol.reference.polygon_kind,
        choices=tuple(REGION_KINDS),
    ),
    "concave_ratio": Sweep(
        title="ratio of the concave hull (1: convex)",
        about="tightness of the reference polygons",
        part="reference",
        scale="linear",
        values=(0.05, 0.15, 0.3, 0.6, 1.0),
        change=lambda setup, value: setup.with_rules(polygon_kind="concave", concave_ratio=value),
        operating=_concave_ratio,
        least=0.0,
    ),
    "min_points": Sweep(
        title="least lidar points of an object",
        about="objects with fewer are ignored",
        part="reference",
        scale="linear",
        values=(3, 5, 10, 20, 40, 80),
        change=lambda setup, value: setup.with_rules(min_points=value),
        operating=lambda setup: setup.protocol.reference.min_points,
        least=1,
        whole=True,
    ),
    "error.yaw_rate": _error(
        "yaw_rate_bias_degps", "bias of the yaw rate (deg/s)", "about the vehicle's origin, to the left", BOTH_WAYS
    ),
    "error.speed": _error(
        "speed_scale_percent", "error of the speed (%)", "of the path between images",
        (-20.0, -10.0, -5.0, -2.0, 0.0, 2.0, 5.0, 10.0, 20.0),
    ),
    "error.pitch": _error(
        "pitch_deg", "error of the mounting's pitch (deg)", "positive: believed to look further down", BOTH_WAYS
    ),
    "error.pitch_rate": _error(
        "pitch_rate_degps", "pitch rate that is not known (deg/s)", "of the camera about itself, between images",
        (-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0),
    ),
    "error.principal_point_u": _error(
        "principal_point_u_px", "shift of the principal point to the right (px)", "of the calibration",
        (-10.0, -5.0, -2.0, 0.0, 2.0, 5.0, 10.0),
    ),
    "error.principal_point_v": _error(
        "principal_point_v_px", "shift of the principal point down (px)", "of the calibration",
        (-10.0, -5.0, -2.0, 0.0, 2.0, 5.0, 10.0),
    ),
    "error.focal": _error(
        "focal_scale_percent", "error of the focal length (%)", "of the calibration",
        (-4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0),
    ),
    "error.time": _error(
        "time_offset_ms", "ego-motion read too late (ms)", "against the exposure; negative: too early",
        (-80.0, -40.0, -20.0, 0.0, 20.0, 40.0, 80.0),
    ),
    "error.image_noise": _error(
        "image_noise_grey", "noise of the images (grey levels)", "normal, seeded; each strength needs new flow",
        (0.0, 2.0, 4.0, 8.0, 16.0), least=0.0,
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPlan:
    """A sweep that is ready to run.

    Attributes:
        what: name of the sweep.
        sweep: what it is.
        base: the setup of the operating value.
        operating: the value that method, protocol and input have of themselves.
        values: each once, numbers in their order, the operating value among them.
        setups: one per value.
    """

    what: str
    sweep: Sweep
    base: Setup
    operating: Value
    values: tuple[Value, ...]
    setups: tuple[Setup, ...]

    def folder(self, value: Value, out: Path) -> Path:
        """Where the run of a value lies in the folder of the sweep."""
        name = value if isinstance(value, str) else f"{value:g}" if float(f"{value:g}") == value else repr(value)
        return out / re.sub(r"[^A-Za-z0-9_.+-]+", "_", name)


def plan_sweep(what: str, *, base: Setup, values: Sequence[str] = ()) -> SweepPlan:
    """Plan a sweep.

    Args:
        what: name in the registry.
        base: the method and the rules as they are.
        values: as text; the sweep's own without. The operating value is added where it is missing.

    Raises:
        UnknownNameError: no such sweep or value.
        UsageError: a value that is not a number or that method or protocol refuse, or a method without the
            parameter that the sweep changes.
    """
    sweep = sweep_named(what)
    operating = sweep.operating(base)
    expected: list[Value] = [sweep.parse(text) for text in values] or list(sweep.values)
    chosen = list(dict.fromkeys(expected if operating in expected else [operating, *expected]))
    if sweep.scale != "names":
        chosen.sort()
    setups = tuple(base if value == operating else sweep.change(base, value) for value in chosen)
    return SweepPlan(what=what, sweep=sweep, base=base, operating=operating, values=tuple(chosen), setups=setups)
