"""Benchmark of moving-object segmentation in automotive fisheye images.

Moving objects are annotated in the lidar point cloud, projected into the fisheye image, and the bounding
polygon is the reference that a segmentation method is scored against (Mariotti and Eising 2020).

From Python, as docs/python.md shows: `bench.score` compares arrays; `bench.open_dataset`, `bench.run` and
`bench.load_run` give data sets and runs; most commands are a function of their name, such as `bench.compare` and
`bench.validate`. Each is imported when it is used first. Start reading in `bench.evaluation`. Which package may import
which: docs/architecture.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bench.annotation.formats import LabelOptions
    from bench.api.annotate import (
        ConvertedLabels,
        ProposalScores,
        evaluate_proposals,
        export_labels,
        import_labels,
        propose,
    )
    from bench.api.arrays import Score, interval, score
    from bench.api.audit import Audit, audit_reference
    from bench.api.compare import Comparison, compare
    from bench.api.datasets import Dataset, Frame, open_dataset
    from bench.api.evaluate import Evaluation, evaluate
    from bench.api.gate import BaselineUpdate, judge, refused_verdict, update_baseline
    from bench.api.leaderboard import Competitor, LeaderboardReport, competitors, leaderboard, score_competitor
    from bench.api.references import export_reference
    from bench.api.report import RunPage, report
    from bench.api.runs import Run, load_run, run
    from bench.api.sweep import Sweep, sweep
    from bench.api.validate import validate
    from bench.api.verify import verify
    from bench.api.view import View, view, view_calibration
    from bench.gate import MissingBaselineError, Verdict
    from bench.harness.verify import Verification
    from bench.recordings import RecordingWriter
    from bench.reporting.verdict import write_verdict
    from bench.synthesis import synthesize
    from bench.validation import ValidationReport

__version__ = "0.1.0"
__all__ = [
    "Audit",
    "BaselineUpdate",
    "Comparison",
    "Competitor",
    "ConvertedLabels",
    "Dataset",
    "Evaluation",
    "Frame",
    "LabelOptions",
    "LeaderboardReport",
    "MissingBaselineError",
    "ProposalScores",
    "RecordingWriter",
    "Run",
    "RunPage",
    "Score",
    "Sweep",
    "ValidationReport",
    "Verdict",
    "Verification",
    "View",
    "audit_reference",
    "compare",
    "competitors",
    "evaluate",
    "evaluate_proposals",
    "export_labels",
    "export_reference",
    "import_labels",
    "interval",
    "judge",
    "leaderboard",
    "load_run",
    "open_dataset",
    "propose",
    "refused_verdict",
    "report",
    "run",
    "score",
    "score_competitor",
    "sweep",
    "synthesize",
    "update_baseline",
    "validate",
    "verify",
    "view",
    "view_calibration",
    "write_verdict",
]

_MODULES = {
    "bench.annotation.formats": ("LabelOptions",),
    "bench.api.annotate": (
        "ConvertedLabels",
        "ProposalScores",
        "evaluate_proposals",
        "export_labels",
        "import_labels",
        "propose",
    ),
    "bench.api.arrays": ("Score", "interval", "score"),
    "bench.api.audit": ("Audit", "audit_reference"),
    "bench.api.compare": ("Comparison", "compare"),
    "bench.api.datasets": ("Dataset", "Frame", "open_dataset"),
    "bench.api.evaluate": ("Evaluation", "evaluate"),
    "bench.api.gate": ("BaselineUpdate", "judge", "refused_verdict", "update_baseline"),
    "bench.api.leaderboard": ("Competitor", "LeaderboardReport", "competitors", "leaderboard", "score_competitor"),
    "bench.api.references": ("export_reference",),
    "bench.api.report": ("RunPage", "report"),
    "bench.api.runs": ("Run", "load_run", "run"),
    "bench.api.sweep": ("Sweep", "sweep"),
    "bench.api.validate": ("validate",),
    "bench.api.verify": ("verify",),
    "bench.api.view": ("View", "view", "view_calibration"),
    "bench.gate": ("MissingBaselineError", "Verdict"),
    "bench.harness.verify": ("Verification",),
    "bench.recordings": ("RecordingWriter",),
    "bench.reporting.verdict": ("write_verdict",),
    "bench.synthesis": ("synthesize",),
    "bench.validation": ("ValidationReport",),
}
_PLACES = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'bench' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
