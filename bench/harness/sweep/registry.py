"""What can be swept: each name with the values it takes by default and what a value changes."""

from __future__ import annotations

from dataclasses import fields, replace

from bench.errors import UnknownNameError, UsageError
from bench.flow import DENSE_FLOWS, FarnebackFlow, dense_flow
from bench.harness.sweep.definition import Sweep, Value
from bench.harness.sweep.trial import Trial
from bench.methods.spherical.likelihood import CONSTRAINTS, Weights

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
    """A number among the fields of the spherical method."""
    return Sweep(
        title=title,
        about=about,
        part="method",
        values=values,
        change=lambda trial, value: trial.with_method(**{name: value}),
        operating=lambda trial: getattr(trial.spherical, name),
        **({"scale": "log"} | more),  # type: ignore[arg-type]
    )


def _weight(name: str) -> Sweep:
    def change(trial: Trial, value: Value) -> Trial:
        return trial.with_method(weights=replace(trial.spherical.weights, **{name: float(value)}))

    return Sweep(
        title=f"weight of {name.replace('_', ' ')}",
        about="the other weights stay; the divisor is their sum",
        part="method",
        scale="linear",
        values=(0.0, 0.1, 0.2, 0.5, 1.0, 2.0),
        change=change,
        operating=lambda trial: getattr(trial.spherical.weights, name),
        least=0.0,
    )


def _farneback(name: str, title: str, values: tuple[int, ...]) -> Sweep:
    def change(trial: Trial, value: Value) -> Trial:
        return trial.with_method(flow_parameters={**trial.spherical.flow_parameters, name: value})

    def operating(trial: Trial) -> Value:
        flow = dense_flow(trial.spherical.flow, **trial.spherical.flow_parameters)
        if not isinstance(flow, FarnebackFlow):
            raise UsageError(f"this sweep is of the flow 'farneback', got {trial.spherical.flow!r}")
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


def _change_flow(trial: Trial, value: Value) -> Trial:
    if value == _flow_of(trial):
        return trial
    name, _, preset = str(value).partition(":")
    return trial.with_method(flow=name, flow_parameters={"preset": preset} if preset else {})


def _flow_of(trial: Trial) -> str:
    """For example "dis:medium"; a Farnebäck flow with other parameters than its own says so."""
    method = trial.spherical
    flow = dense_flow(method.flow, **method.flow_parameters)
    if isinstance(flow, FarnebackFlow):
        return method.flow if flow == FarnebackFlow() else f"{method.flow} as set"
    return f"{method.flow}:{flow.preset}"


def _ablate(trial: Trial, value: Value) -> Trial:
    """Weights of constraints set to 0; the divisor follows their sum, so the threshold weighs what is left."""
    name, weights = str(value), trial.spherical.weights
    if name == EVERYTHING:
        return trial
    if name.startswith(WITHOUT):
        left = replace(weights, **{name.removeprefix(WITHOUT): 0.0})
    else:
        kept = name.removeprefix(ONLY)
        if getattr(weights, kept) == 0:
            raise UsageError(f"ablation {name!r}: expected a constraint with a weight, got {kept}=0")
        left = Weights(**{f.name: 0.0 for f in fields(Weights)} | {kept: getattr(weights, kept)})
    return trial.with_method(weights=left)


def _polygon_kind(trial: Trial, value: Value) -> Trial:
    return trial.with_rules(polygon_kind=value)


def _concave_ratio(trial: Trial) -> Value:
    rules = trial.protocol.reference
    return rules.concave_ratio if rules.polygon_kind == "concave" else 1.0  # 1 is the convex hull


def _injected(name: str, title: str, about: str, values: tuple[float, ...], *, least: float | None = None) -> Sweep:
    return Sweep(
        title=title,
        about=about,
        part="input",
        scale="linear",
        values=values,
        change=lambda trial, value: trial.with_error(**{name: float(value)}),
        operating=lambda trial: getattr(trial.injection, name),
        least=least,
    )


ABLATIONS = (EVERYTHING, *(WITHOUT + name for name in CONSTRAINTS), *(ONLY + name for name in CONSTRAINTS))
FLOWS = ("farneback", "dis:ultrafast", "dis:fast", "dis:medium")
THRESHOLDS = (1e-4, 2e-4, 3e-4, 4.5e-4, 6e-4, 1e-3, 1.5e-3, 2.5e-3, 5e-3, 1e-2)
BOTH_WAYS = (-5.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 5.0)

SWEEPS: dict[str, Sweep] = {
    "threshold": _parameter("threshold", "threshold of the likelihood (≈ rad)", "for a host that moves", THRESHOLDS),
    "static_threshold": _parameter(
        "static_threshold", "threshold of the deviation, standing host (≈ rad)", "for a host that stands", THRESHOLDS
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
        values=("convex", "concave", "footprint"),
        change=_polygon_kind,
        operating=lambda trial: trial.protocol.reference.polygon_kind,
        choices=("convex", "concave", "footprint"),
    ),
    "concave_ratio": Sweep(
        title="ratio of the concave hull (1: convex)",
        about="tightness of the reference polygons",
        part="reference",
        scale="linear",
        values=(0.05, 0.15, 0.3, 0.6, 1.0),
        change=lambda trial, value: trial.with_rules(polygon_kind="concave", concave_ratio=value),
        operating=_concave_ratio,
        least=0.0,
    ),
    "min_points": Sweep(
        title="least lidar points of an object",
        about="objects with fewer are ignored",
        part="reference",
        scale="linear",
        values=(3, 5, 10, 20, 40, 80),
        change=lambda trial, value: trial.with_rules(min_points=value),
        operating=lambda trial: trial.protocol.reference.min_points,
        least=1,
        whole=True,
    ),
    "error.yaw_rate": _injected(
        "yaw_rate_bias_degps", "bias of the yaw rate (deg/s)", "about the vehicle's origin, to the left", BOTH_WAYS
    ),
    "error.speed": _injected(
        "speed_scale_percent", "error of the speed (%)", "of the path between images",
        (-20.0, -10.0, -5.0, -2.0, 0.0, 2.0, 5.0, 10.0, 20.0),
    ),
    "error.pitch": _injected(
        "pitch_deg", "error of the mounting's pitch (deg)", "positive: believed to look further down", BOTH_WAYS
    ),
    "error.pitch_rate": _injected(
        "pitch_rate_degps", "pitch rate that is not known (deg/s)", "of the camera about itself, between images",
        (-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0),
    ),
    "error.principal_point_u": _injected(
        "principal_point_u_px", "shift of the principal point to the right (px)", "of the calibration",
        (-10.0, -5.0, -2.0, 0.0, 2.0, 5.0, 10.0),
    ),
    "error.principal_point_v": _injected(
        "principal_point_v_px", "shift of the principal point down (px)", "of the calibration",
        (-10.0, -5.0, -2.0, 0.0, 2.0, 5.0, 10.0),
    ),
    "error.focal": _injected(
        "focal_scale_percent", "error of the focal length (%)", "of the calibration",
        (-4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0),
    ),
    "error.time": _injected(
        "time_offset_ms", "ego-motion read too late (ms)", "against the exposure; negative: too early",
        (-80.0, -40.0, -20.0, 0.0, 20.0, 40.0, 80.0),
    ),
    "error.image_noise": _injected(
        "image_noise_grey", "noise of the images (grey levels)", "normal, seeded; each strength needs new flow",
        (0.0, 2.0, 4.0, 8.0, 16.0), least=0.0,
    ),
}  # fmt: skip
