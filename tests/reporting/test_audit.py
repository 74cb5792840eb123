"""Tables of an audit."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.audit.causes import MissCause
from bench.audit.run import AuditSummary, run_audit
from bench.evaluation.protocol import load_protocol
from bench.methods import build_method
from bench.recordings import load_card
from bench.reporting.audit import audit_tables, write_tables
from tests.reporting.printed import printed, texts

METHOD = build_method("spherical", {"threshold": 0.01})  # so that something is missed


@pytest.fixture(scope="module")
def audited(tiny_card: Path, tmp_path_factory: pytest.TempPathFactory) -> AuditSummary:
    out = tmp_path_factory.mktemp("audit")
    found, _ = run_audit(load_card(tiny_card), method=METHOD, protocol=load_protocol("paper-v1"), out=out)
    return found


def test_every_table_is_in_markdown_in_full_and_fits_the_terminal(audited, tmp_path: Path):
    text = write_tables(tmp_path, audited).read_text()
    tables = audit_tables(audited)
    assert [line[3:] for line in text.splitlines() if line.startswith("## ")] == [t.title for t in tables]
    for table in tables:
        assert table.note in text
        assert all(f"| {' | '.join(row)} |" in text for row in texts(table))
    shown = printed(tables)
    assert "…" not in shown
    assert all(word in shown.split() for word in ("blind:", "horizon", "elsewhere"))


def test_shares_of_a_line_are_100_percent(audited):
    misses, false = audit_tables(audited)[-2:]
    first = misses.columns.index("by error %") + 1
    rows = [row for row in texts(misses) if row[first] != "n/a"]  # where something is missed
    assert rows
    for row in rows:
        assert sum(map(float, row[first : first + len(MissCause)])) == pytest.approx(100, abs=0.4)
    assert sum(map(float, texts(false)[0][3:-1])) == pytest.approx(100, abs=0.4)
