"""Tables and pictures of an audit."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pytest

from bench.audit import AuditSummary, MissCause, audit_sources, explain_image, run_audit
from bench.evaluation import load_protocol
from bench.methods import build_method
from bench.recordings import load_card
from bench.reporting.audit import audit_tables, worst_images, write_cause_pictures, write_tables
from tests.reporting.printed import printed, texts

METHOD = build_method("spherical", {"threshold": 0.01})  # so that something is missed


@pytest.fixture(scope="module")
def audited(tiny_card: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[AuditSummary, dict[str, pa.Table]]:
    out = tmp_path_factory.mktemp("audit")
    found, rows = run_audit(load_card(tiny_card), method=METHOD, protocol=load_protocol("paper-v1"), out=out)
    return found, rows.tables


def test_every_table_is_in_markdown_in_full_and_fits_the_terminal(audited, tmp_path: Path):
    audit, _ = audited
    text = write_tables(tmp_path, audit).read_text()
    tables = audit_tables(audit)
    assert [line[3:] for line in text.splitlines() if line.startswith("## ")] == [t.title for t in tables]
    for table in tables:
        assert table.note in text
        assert all(f"| {' | '.join(row)} |" in text for row in texts(table))
    shown = printed(tables)
    assert "…" not in shown
    assert all(word in shown.split() for word in ("blind:", "horizon", "elsewhere"))


def test_shares_of_a_line_are_100_percent(audited):
    misses, false = audit_tables(audited[0])[-2:]
    first = misses.columns.index("by error %") + 1
    rows = [row for row in texts(misses) if row[first] != "n/a"]  # where something is missed
    assert rows
    for row in rows:
        assert sum(map(float, row[first : first + len(MissCause)])) == pytest.approx(100, abs=0.4)
    assert sum(map(float, texts(false)[0][3:-1])) == pytest.approx(100, abs=0.4)


def test_causes_are_drawn_where_most_is_missed(audited, tiny_card: Path, tmp_path: Path):
    misses, rules = audited[1]["misses"], load_protocol("paper-v1")
    found = worst_images(misses)
    rows = misses.to_pandas()
    rows["missed"] = rows["cells"] - rows["hit"]
    assert set(found) == set(rows.loc[rows["missed"] > 0, "category"])
    sources = {
        source.recorded.name: source for source in audit_sources(load_card(tiny_card), split=None, recordings=None)
    }
    for category, (recording, camera, timestamp_ns) in found.items():
        row = rows[(rows["recording"] == recording) & (rows["timestamp_ns"] == timestamp_ns)]
        assert row["missed"].max() == rows.loc[rows["category"] == category, "missed"].max()
        explained = explain_image(
            sources[recording], camera=camera, timestamp_ns=timestamp_ns, method=METHOD, protocol=rules
        )
        assert explained.hit.sum() == row["hit"].sum()
        assert {cause.value: cells.sum() for cause, cells in explained.missed.items()} == {
            cause.value: row[cause.value].sum() for cause in MissCause
        }
    files = write_cause_pictures(tmp_path, misses, sources=sources, method=METHOD, protocol=rules)
    assert len(files) == 2 * len(found) > 0
