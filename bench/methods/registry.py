"""Methods by name."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from bench.errors import BenchError, UnknownNameError, UsageError
from bench.methods.contract import Method, Scorable, not_derived, refuse_unfit
from bench.methods.settings import refuse_settings
from bench.plug_ins import describe_error, imported, known_targets, undisturbed

Kind = TypeVar("Kind", bound=Scorable)
ENTRY_POINTS = "fisheye_bench.methods"

METHODS = {
    "spherical": "bench.methods.spherical.method:SphericalMethod",
    "spherical-guided": "bench.methods.spherical.method:GuidedSphericalMethod",
    "spherical-sparse": "bench.methods.spherical.tracks:SparseSphericalMethod",
    "spherical-visual-odometry": "bench.methods.spherical.tracks:VisualOdometryMethod",
    "epipolar-only": "bench.methods.spherical.method:EpipolarOnly",
    "positive-depth-only": "bench.methods.spherical.method:PositiveDepthOnly",
    "positive-height-only": "bench.methods.spherical.method:PositiveHeightOnly",
    "anti-parallel-only": "bench.methods.spherical.method:AntiParallelOnly",
    "three-view-only": "bench.methods.spherical.tracks:ThreeViewOnly",
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
    return next(iter(inspect.cleandoc(_class(target, target, Scorable).__doc__ or "").splitlines()), "")


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
        module = Path(name).stem
        own = f"; {module}.py is here: a method in it is {module}:ITS_CLASS" if Path(f"{module}.py").is_file() else ""
        raise UnknownNameError(
            "method", name, known, hint=f"one of your own is MODULE:CLASS, as my_method:MyMethod{own}"
        )
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
    given = dict(parameters or {})
    refuse_settings(name, kind, given)
    try:
        with undisturbed():
            built = kind(**given)
    except BenchError:
        raise
    except (Exception, SystemExit) as error:
        raise UsageError(f"method {name!r} cannot be built with {given}; {describe_error(error)}") from error
    refuse_unfit(built)
    return built


def _class(name: str, target: str, base: type[Kind]) -> type[Kind]:
    loaded = imported(target, expected=f"method {name!r}: expected a class")
    if not (isinstance(loaded, type) and issubclass(loaded, base)):
        raise UsageError(f"method {name!r}: {not_derived(target.rpartition(':')[2])}")
    return loaded
