"""Methods by name."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import entry_points

from bench.errors import UnknownNameError, UsageError
from bench.methods.contract import Method

ENTRY_POINTS = "fisheye_bench.methods"

METHODS = {
    "spherical": "bench.methods.spherical.method:SphericalMethod",
    "nothing": "bench.methods.baselines:Nothing",
    "everything": "bench.methods.baselines:Everything",
}


def known_methods() -> dict[str, str]:
    """Name -> "module:Class" of the package's methods and of those that installed packages add."""
    added = {point.name: point.value for point in entry_points(group=ENTRY_POINTS)}
    return added | METHODS


def build_method(name: str, parameters: Mapping[str, object] | None = None) -> Method:
    """Build a method.

    Args:
        name: as the registry knows it, or "module:Class" of anything that can be imported.
        parameters: what its class takes; the defaults without.

    Raises:
        UnknownNameError: no such method.
        UsageError: nothing to import there, a parameter that the method does not take, or a value that it refuses.
    """
    known = known_methods()
    if name not in known and ":" not in name:
        raise UnknownNameError("method", name, known)
    module, _, attribute = known.get(name, name).partition(":")
    try:
        factory = getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise UsageError(f"method {name!r}: wanted a class that can be imported; {error}") from error
    try:
        method: Method = factory(**(parameters or {}))
    except TypeError as error:
        takes = ", ".join(inspect.signature(factory).parameters) or "no parameters"
        raise UsageError(f"method {name!r} takes {takes}; {error}") from error
    return method
