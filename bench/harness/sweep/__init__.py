"""Sweeps: one thing changed through many values, everything else the same, on the same images.

What can be swept is a literal registry (`registry.SWEEPS`): parameters of the spherical method, rules of the reference,
and errors that are injected into what a method is told. Images are looped outside and values inside: flow is computed
once per pair of images and setting and kept on disk, the deviations once per setting that changes them, the reference
once per rules. Injected errors reach the **method only**; the reference keeps the true calibration and ego-motion.
"""

from bench.harness.sweep.definition import Sweep
from bench.harness.sweep.perturb import Injection
from bench.harness.sweep.plan import SweepPlan, plan_sweep
from bench.harness.sweep.registry import SWEEPS
from bench.harness.sweep.results import FILE, SweepResult, SweepRow, read_sweep
from bench.harness.sweep.run_sweep import run_sweep
from bench.harness.sweep.trial import Trial

__all__ = [
    "FILE",
    "SWEEPS",
    "Injection",
    "Sweep",
    "SweepPlan",
    "SweepResult",
    "SweepRow",
    "Trial",
    "plan_sweep",
    "read_sweep",
    "run_sweep",
]
