"""The gate: is a run as good as the baseline? It reads stored results and says so for people and machines.

Run and baseline are a table of sums and a manifest each. They are compared as `compare` compares runs
(`bench.evaluation.compare_sums`); the verdict by tolerances is a layer on that.

A metric fails when it is worse than tolerated, by more than max(absolute, relative * baseline), **and** that is more
than chance: the 95 % interval of the paired change (`bench.evaluation.comparison`) excludes no change, and the p-value
of a loss, corrected after Holm for the rows that decide, is at most 5 %. Those are the headlines over everything and by
kind of motion, unless the tolerances say otherwise. All else that is worse than tolerated is suspect: it is reported
and fails nothing, but for methods without noise, whose tolerances say so. A slice with too few cases or recordings is
reported, not judged. Before the metrics it is checked that both runs measured the same things: a score over fewer
objects is not a better score. docs/gate.md has false alarms and power.

Modules: `tolerances` (the rules, versioned files), `baseline` (sums and manifest of a run, stored), `judge` (the
checks, and the verdict on each metric), `verdict` (the result, and what of it is read first);
`bench.reporting.verdict` writes it for people and CI. Only commands call this package.
"""
