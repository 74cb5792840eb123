"""From the name of a sweep and values to the trials that are run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench.harness.sweep.definition import Sweep, Value
from bench.harness.sweep.registry import sweep_named
from bench.harness.sweep.trial import Trial


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPlan:
    """A sweep that is ready to run.

    Attributes:
        what: name of the sweep.
        sweep: what it is.
        base: the trial of the operating value.
        operating: the value that method, protocol and input have of themselves.
        values: each once, numbers in their order, the operating value among them.
        trials: one per value.
    """

    what: str
    sweep: Sweep
    base: Trial
    operating: Value
    values: tuple[Value, ...]
    trials: tuple[Trial, ...]


def plan_sweep(what: str, *, base: Trial, values: Sequence[str] = ()) -> SweepPlan:
    """Plan a sweep.

    Args:
        what: name in the registry.
        base: the method and the rules as they are.
        values: as text; the sweep's own without. The operating value is added where it is missing.

    Raises:
        UnknownNameError: no such sweep or value.
        UsageError: a value that is not a number or that method or protocol refuse, or another method than the sweep's.
    """
    sweep = sweep_named(what)
    operating = sweep.operating(base)
    expected: list[Value] = [sweep.parse(text) for text in values] or list(sweep.values)
    chosen = list(dict.fromkeys(expected if operating in expected else [operating, *expected]))
    if sweep.scale != "names":
        chosen.sort()
    trials = tuple(base if value == operating else sweep.change(base, value) for value in chosen)
    return SweepPlan(what=what, sweep=sweep, base=base, operating=operating, values=tuple(chosen), trials=trials)
