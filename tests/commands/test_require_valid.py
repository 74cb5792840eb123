"""`run --require-valid`: data with errors are refused before they are scored, and the page carries the rest."""

import shutil

import pytest
import yaml

from bench.validation import read_report
from tests.support.commands import call, called_here
from tests.validation import drive

RUN = ("--method", "nothing", "--no-pictures")


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    return drive.write_drive(tmp_path_factory.mktemp("clean") / "drive", drive.MARGIN_M)


@pytest.fixture
def card(clean, tmp_path):
    shutil.copytree(clean, tmp_path / "data" / "drive")
    content = {"name": "drives", "title": "t", "adapter": "native", "root": "data", "licence": "none"}
    (tmp_path / "drives.yaml").write_text(yaml.safe_dump(content))
    return tmp_path / "drives.yaml"


@pytest.mark.usefixtures("without_charts")
def test_clean_data_are_scored_and_the_run_says_so(card, tmp_path, monkeypatch):
    plain = called_here("run", card, "--out", tmp_path / "plain", *RUN)
    assert f"a run does not validate its data; check them with: fisheye-bench validate {card}" in plain.stdout
    assert not (tmp_path / "plain" / "paper-v1" / "validation.json").exists()
    ended = called_here("run", card, "--out", tmp_path / "run", "--require-valid", *RUN)
    assert ended.returncode == 0
    assert "0 errors and 0 warnings in 1 recording" in ended.stdout
    assert "does not validate" not in ended.stdout
    for run, told in ((tmp_path / "plain", "were not validated"), (tmp_path / "run", "0 errors and 0 warnings")):
        assert call(monkeypatch, "report", run, "--no-pictures") == 0
        assert told in (run / "paper-v1" / "index.html").read_text()


@pytest.mark.slow
@pytest.mark.usefixtures("without_charts")
def test_warnings_are_on_the_page(card, tmp_path, monkeypatch):
    sorted((tmp_path / "data" / "drive" / "lidar").iterdir())[8].unlink()
    ended = called_here("run", card, "--out", tmp_path / "run", "--require-valid", *RUN)
    assert ended.returncode == 0
    report = read_report(tmp_path / "run" / "paper-v1" / "validation.json")
    assert {finding.check for finding in report.findings} >= {"sweep-gaps"}
    assert call(monkeypatch, "validate", card, "--json", tmp_path / "told.json") == 1
    assert read_report(tmp_path / "told.json") == report
    assert call(monkeypatch, "report", tmp_path / "run", "--no-pictures") == 0
    page = (tmp_path / "run" / "paper-v1" / "index.html").read_text()
    assert "Findings in the data" in page
    assert "sweep-gaps: " in page


def test_errors_are_refused_before_anything_is_written(card, tmp_path):
    file = tmp_path / "data" / "drive" / "recording.json"
    file.write_text(file.read_text().replace(f'"frame_interval_ns": {drive.IMAGE_NS}', '"frame_interval_ns": 66'))
    ended = called_here("run", card, "--out", tmp_path / "run", "--require-valid", *RUN)
    assert ended.returncode == 2
    assert "image-times" in ended.stdout
    assert "drives.yaml: expected data that validate finds no errors in, got 1 error;" in ended.stderr
    assert not (tmp_path / "run").exists()


def test_one_recording_is_validated_by_its_name(card, tmp_path):
    shutil.copytree(tmp_path / "data" / "drive", tmp_path / "data" / "other")
    ended = called_here("validate", card, "--recording", "other")
    assert "in 1 recording;" in ended.stdout
    assert "same-drive" not in ended.stdout
    refused = called_here("validate", card, "--recording", "othr")
    assert (refused.returncode, "did you mean 'other'?" in refused.stderr) == (2, True)
