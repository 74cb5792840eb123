"""From the name of a sweep and values to the runs that it is made of."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.harness.sweep.definition import Setup, Sweep, Value
from bench.harness.sweep.registry import sweep_named


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
