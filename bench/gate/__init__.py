"""The gate: is a run as good as the baseline? It reads stored results and says so for people and machines.

Run and baseline are a table of sums and a manifest each. They are compared as `compare` compares runs
(`bench.evaluation.compare_sums`); the verdict by tolerances is a layer on that.

A metric fails when it is worse than tolerated, by more than max(absolute, relative * baseline), **and** the 95 %
interval of the paired change, by recording (`bench.evaluation.comparison`), excludes no change. Worse than
tolerated with an interval that includes no change is suspect: it is reported and fails nothing. A slice with too few
cases or recordings is reported, not judged. Before the metrics it is checked that both runs measured the same things: a
score over fewer objects is not a better score.

A change that touches few of a slice's recordings cannot exclude no change: where k of n equal recordings change by the
same, the difference is sqrt(k (n - 1) / (n - k)) standard errors, beyond Student's limit only from k = 4 on. So a data
set needs at least six recordings of whatever the gate shall guard, and four that show a fault.

Modules: `tolerances` (the rules, versioned files), `baseline` (sums and manifest of a run, stored), `changes` (what
differs beside the scores), `judge` (the checks, and the verdict on each metric), `verdict` (the result, and how its
numbers are written), `brief` (what of it is read first); `bench.reporting.verdict` writes it for people and CI.
Only the command line calls this package.
"""

from bench.gate.baseline import (
    MissingBaselineError,
    RunSums,
    find_baseline,
    own_baseline,
    read_baseline,
    read_run_sums,
    write_baseline,
)
from bench.gate.judge import incomparable_reason, judge, judgeable, refuse
from bench.gate.tolerances import Tolerances, known_tolerances, load_tolerances
from bench.gate.verdict import Check, Outcome, Row, Verdict

__all__ = [
    "Check",
    "MissingBaselineError",
    "Outcome",
    "Row",
    "RunSums",
    "Tolerances",
    "Verdict",
    "find_baseline",
    "incomparable_reason",
    "judge",
    "judgeable",
    "known_tolerances",
    "load_tolerances",
    "own_baseline",
    "read_baseline",
    "read_run_sums",
    "refuse",
    "write_baseline",
]
