"""Sweeps: one thing changed through many values, everything else the same, on the same images.

What can be swept is a table (`plan.SWEEPS`): parameters of a method, rules of the reference, and errors
of what a method is told. Every value is a run in a folder of its own; the runs share a cache, so that a step that a
value does not change (flow, likelihood, reference) is computed once. Errors reach the **method only**; the reference
keeps the true calibration and ego-motion.
"""

from bench.harness.sweep.plan import SWEEPS, Setup, Sweep, SweepPlan, plan_sweep
from bench.harness.sweep.results import FILE, MARK, SweepResult, SweepRow, read_sweep
from bench.harness.sweep.run_sweep import run_sweep

__all__ = [
    "FILE",
    "MARK",
    "SWEEPS",
    "Setup",
    "Sweep",
    "SweepPlan",
    "SweepResult",
    "SweepRow",
    "plan_sweep",
    "read_sweep",
    "run_sweep",
]
