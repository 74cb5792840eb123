"""The command `report`."""

import pytest

from tests.support.commands import call, error_line


def test_report_writes_the_page_and_names_the_files(monkeypatch, capsys, tiny_card, tmp_path):
    run = tmp_path / "run"
    assert call(monkeypatch, "run", tiny_card, "--out", run, "--no-pictures", "--split", "moving") == 0
    assert call(monkeypatch, "report", run, "--no-pictures") == 0
    assert call(monkeypatch, "report", run, "--category", "crossing") == 0
    shown = capsys.readouterr().out
    for name in ("index.html", "index-crossing.html", "figures/range_map.pdf"):
        assert (run / "paper-v1" / name).stat().st_size > 1000
        assert str(run / "paper-v1" / name) in shown
    assert b"data:image/jpeg" in (run / "paper-v1" / "index-crossing.html").read_bytes()
    assert b"<img" not in (run / "paper-v1" / "index.html").read_bytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("report", "RUN"), "expected the folder of a finished run"),
        (("report", "RUN", "--category", "preceeding"), "did you mean 'preceding'"),
    ],
)
def test_mistakes_are_one_clear_line_and_status_2(monkeypatch, capsys, tmp_path, words, message):
    assert message in error_line(monkeypatch, capsys, *(tmp_path if word == "RUN" else word for word in words))
