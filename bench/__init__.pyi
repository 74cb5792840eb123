"""The public names of `bench`, each once; `bench/__init__.py` reads this list and imports a name on first use."""

from bench.commands.annotate import ConvertedLabels as ConvertedLabels
from bench.commands.annotate import Proposals as Proposals
from bench.commands.annotate import ProposalScores as ProposalScores
from bench.commands.annotate import evaluate_proposals as evaluate_proposals
from bench.commands.annotate import export_labels as export_labels
from bench.commands.annotate import import_labels as import_labels
from bench.commands.annotate import propose as propose
from bench.commands.audit import Audit as Audit
from bench.commands.audit import audit_reference as audit_reference
from bench.commands.compare import Comparison as Comparison
from bench.commands.compare import compare as compare
from bench.commands.evaluate import evaluate as evaluate
from bench.commands.gate import judge as judge
from bench.commands.leaderboard import LeaderboardReport as LeaderboardReport
from bench.commands.leaderboard import leaderboard as leaderboard
from bench.commands.reference import export_reference as export_reference
from bench.commands.report import RunPage as RunPage
from bench.commands.report import report as report
from bench.commands.run import Run as Run
from bench.commands.run import load_run as load_run
from bench.commands.run import run as run
from bench.commands.sweep import Sweep as Sweep
from bench.commands.sweep import sweep as sweep
from bench.commands.validate import validate as validate
from bench.commands.verify import verify as verify
from bench.commands.view import View as View
from bench.commands.view import view as view
from bench.evaluation.arrays import Score as Score
from bench.evaluation.arrays import score as score
from bench.gate.verdict import Verdict as Verdict
from bench.harness.datasets import Dataset as Dataset
from bench.harness.datasets import Frame as Frame
from bench.harness.datasets import open_dataset as open_dataset
from bench.harness.verify import Verification as Verification
from bench.recordings import RecordingWriter as RecordingWriter
from bench.reporting.verdict import write_verdict as write_verdict
from bench.synthesis import synthesize as synthesize
from bench.validation.report import ValidationReport as ValidationReport

__version__: str
