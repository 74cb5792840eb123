import math
import os

import pytest

from bench.errors import OutputError
from bench.evaluation import load_protocol, sum_run, summary_of, write_sums
from bench.evaluation.rows import frames_table, objects_table
from bench.harness.stored import SUMS, read_run, write_run
from bench.reporting.run_tables import write_report_files
from tests.support.counts import write_counts
from tests.support.manifests import manifest, provenance
from tests.support.result_rows import frame_row, object_row

NAMES = ["table.md", "table.csv", "table.tex"]


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A run of nine images with one crossing vehicle each, half of it found."""
    run = tmp_path_factory.mktemp("run")
    objects = objects_table([object_row(n) for n in range(9)])
    frames = frames_table([frame_row(n) for n in range(9)])
    write_counts(run, objects, frames)
    sums = sum_run(objects, frames, protocol=load_protocol("paper-v1"))
    write_sums(sums, run / SUMS)
    metrics = summary_of(sums, protocol=load_protocol("paper-v1"))
    write_run(
        run, metrics, protocol=load_protocol("paper-v1"), manifest=manifest(method="empty"), provenance=provenance(),
        caveats="Staged, not the paper's.",
        vehicle_outline_m=((-1.0, -0.9), (3.8, -0.9), (3.8, 0.9), (-1.0, 0.9)),
    )  # fmt: skip
    return run


def test_all_files_are_written_from_the_stored_results(stored):
    rows, files = write_report_files(read_run(stored))
    assert [file.name for file in files] == NAMES
    assert all(file.parent == stored and file.stat().st_size > 0 for file in files)
    assert (stored / "table.md").read_text().rstrip().endswith("The data: Staged, not the paper's.")
    crossing, last = rows[0].metrics, rows[-1].metrics
    assert crossing["tpr"].value == 0.5
    assert crossing["iou"].value == pytest.approx(50 / 110)
    assert last["coverage"].value == 0.01
    assert math.isnan(rows[1].metrics["tpr"].value)


def test_a_file_that_cannot_be_replaced_stays_whole(stored, monkeypatch):
    write_report_files(read_run(stored))
    before = (stored / "table.md").read_bytes()

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OutputError, match="disk full"):
        write_report_files(read_run(stored))
    assert (stored / "table.md").read_bytes() == before
    assert sorted(file.name for file in stored.iterdir()) == sorted(
        [*NAMES, "counts", "sums.csv", "manifest.json", "summary.json", "protocol.json"]
    )
