"""Methods by name."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import TypeVar

from bench.errors import BenchError, UnknownNameError, UsageError
from bench.methods.contract import Method, Scorable, not_derived, refuse_unfit
from bench.plug_ins import describe_error, imported, known_targets

Kind = TypeVar("Kind", bound=Scorable)
ENTRY_POINTS = "fisheye_bench.methods"

METHODS = {
    "spherical": "bench.methods.spherical.method:SphericalMethod",
    "spherical-sparse": "bench.methods.spherical.sparse:SparseSphericalMethod",
    "spherical-visual-odometry": "bench.methods.spherical.visual_odometry:VisualOdometryMethod",
    "epipolar-only": "bench.methods.spherical.method:EpipolarOnly",
    "positive-depth-only": "bench.methods.spherical.method:PositiveDepthOnly",
    "positive-height-only": "bench.methods.spherical.method:PositiveHeightOnly",
    "anti-parallel-only": "bench.methods.spherical.method:AntiParallelOnly",
    "three-view-only": "bench.methods.spherical.sparse:ThreeViewOnly",
    "rigid-scene": "bench.methods.rigid_scene.method:RigidSceneMethod",
    "learned": "bench.methods.learned.method:LearnedMethod",
    "flow-magnitude": "bench.methods.baselines:FlowMagnitude",
    "rotation-compensated-flow": "bench.methods.baselines:RotationCompensatedFlow",
    "frame-difference": "bench.methods.baselines:FrameDifference",
    "background-subtraction": "bench.methods.baselines:BackgroundSubtraction",
    "nothing": "bench.methods.baselines:Nothing",
    "everything": "bench.methods.baselines:Everything",
}


def known_methods() -> dict[str, str]:
    """Name -> "module:Class" of the package's methods and of those that installed packages add."""
    return known_targets(ENTRY_POINTS, METHODS)


def describe_method(target: str) -> str:
    """Describe a method in one line: the first of its class's docstring.

    Args:
        target: "module:Class".

    Raises:
        UsageError: nothing to import there.
    """
    return next(iter((inspect.getdoc(_class(target, target, Scorable)) or "").splitlines()), "")


def build_method(name: str, parameters: Mapping[str, object] | None = None) -> Method:
    """Build a method.

    Args:
        name: as the registry knows it, or "module:Class" of anything that can be imported.
        parameters: what its class takes; the defaults without.

    Raises:
        UnknownNameError: no such method.
        UsageError: nothing to import there, no class derived from `Method`, a parameter that it does not take, or a
            value that it refuses.
    """
    known = known_methods()
    if name not in known and ":" not in name:
        raise UnknownNameError("method", name, known)
    return build(name, known.get(name, name), Method, parameters)  # type: ignore[type-abstract]


def build(name: str, target: str, base: type[Kind], parameters: Mapping[str, object] | None = None) -> Kind:
    """Build what lies at "module:Class".

    Args:
        name: for messages.
        target: where.
        base: that its class derives from.
        parameters: what its class takes; the defaults without.

    Raises:
        UsageError: as `build_method`.
    """
    kind = _class(name, target, base)
    try:
        built = kind(**(parameters or {}))
    except TypeError as error:
        takes = ", ".join(inspect.signature(kind).parameters) or "no parameters"
        raise UsageError(f"method {name!r} takes {takes}; {error}") from error
    except BenchError:
        raise
    except (Exception, SystemExit) as error:
        raise UsageError(
            f"method {name!r} cannot be built with {dict(parameters or {})}; {describe_error(error)}"
        ) from error
    refuse_unfit(built)
    return built


def _class(name: str, target: str, base: type[Kind]) -> type[Kind]:
    found = imported(target, expected=f"method {name!r}: expected a class")
    if not (isinstance(found, type) and issubclass(found, base)):
        raise UsageError(f"method {name!r}: {not_derived(target.rpartition(':')[2])}")
    return found
