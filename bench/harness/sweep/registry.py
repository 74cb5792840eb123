"""What can be swept: each name with the values it takes by default and what a value changes."""

from __future__ import annotations

from dataclasses import fields, replace

from bench.errors import UnknownNameError, UsageError
from bench.flow import DENSE_FLOWS, DisFlow, FarnebackFlow, dense_flow
from bench.harness.sweep.definition import Setup, Sweep, Value
from bench.methods.spherical.likelihood import CONSTRAINTS, Weights
from bench.reference import POLYGON_KINDS

EVERYTHING = "all"
WITHOUT, ONLY = "without ", "only "


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


ABLATIONS = (EVERYTHING, *(WITHOUT + name for name in CONSTRAINTS), *(ONLY + name for name in CONSTRAINTS))
FLOWS = ("farneback", "dis:ultrafast", "dis:fast", "dis:medium")
THRESHOLDS = (1e-4, 2e-4, 3e-4, 4.5e-4, 6e-4, 1e-3, 1.5e-3, 2.5e-3, 5e-3, 1e-2)
BOTH_WAYS = (-5.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 5.0)

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
        values=POLYGON_KINDS,
        change=_polygon_kind,
        operating=lambda setup: setup.protocol.reference.polygon_kind,
        choices=(*POLYGON_KINDS, "footprint"),  # its name in earlier versions
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
