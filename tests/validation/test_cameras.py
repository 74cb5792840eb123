"""A rendered turn: its clean camera passes, and each planted fault of the camera is named."""

import re
import shutil
from dataclasses import replace

import pytest

from bench.recordings.native import open_native
from bench.validation.findings import Finding, Severity, Undecided
from bench.validation.fits import cameras
from bench.validation.report import CHECKS
from benchmarks.mistakes import OF_CAMERAS

TOLD = {mistake.name: mistake for mistake in OF_CAMERAS}


def verdict(root):
    drive = open_native(root)
    return cameras.camera_verdict(drive, drive.cameras["front"])


def test_a_drive_is_checked_for_its_cameras():
    assert cameras.check_cameras in [check for check, _ in CHECKS]


@pytest.mark.slow
def test_a_clean_camera_passes(turning):
    assert verdict(turning) is None


@pytest.mark.parametrize(
    "name",
    [
        "images mirrored",
        *(
            pytest.param(name, marks=pytest.mark.slow)  # each fit of a camera takes 10 s and more
            for name in (
                "quaternion as x, y, z, w",
                "front camera turned -5 deg about the vehicle's z",
                "front camera turned 1 deg about the vehicle's z",
                "focal length times 0.95",
                "focal length times 2",
                "principal point 20 px off",
                "images +50 ms",
            )
        ),
    ],
)
def test_a_planted_fault_is_named(turning, tmp_path, name):
    root = shutil.copytree(turning, tmp_path / turning.name)
    TOLD[name].plant(root)
    finding = verdict(root)
    assert isinstance(finding, Finding)
    text = f"{finding.check} {finding.field} {finding.got} {finding.hint}"
    assert re.search(TOLD[name].lead.removeprefix("camera.*"), text), text


@pytest.mark.slow
def test_where_little_of_the_flow_fits_images_that_are_clearly_late_are_told_as_a_doubt(turning, tmp_path, monkeypatch):
    monkeypatch.setattr(cameras, "LIMITS", replace(cameras.LIMITS, sure=1.0))
    clean = verdict(turning)
    assert isinstance(clean, Undecided)
    assert "of the flow is that of a static world" in clean.why
    root = shutil.copytree(turning, tmp_path / turning.name)
    TOLD["images +50 ms"].plant(root)
    finding = verdict(root)
    assert (finding.check, finding.severity) == ("image-clock", Severity.WARNING)
    assert re.match(r"perhaps images \d+ ms late .*of the flow is that of a static world", finding.got)


@pytest.mark.slow
def test_flow_that_no_calibration_predicts_is_a_warning(turning, monkeypatch):
    monkeypatch.setattr(cameras, "LIMITS", replace(cameras.LIMITS, least=1.0))
    finding = verdict(turning)
    assert (finding.check, finding.severity) == ("camera-flow", Severity.WARNING)
    assert re.fullmatch(r"\d+ % of it; \d+ % by the calibration or clock that fits best", finding.got)


def test_a_drive_without_sweeps_says_why_it_cannot_tell(turning, tmp_path):
    root = shutil.copytree(turning, tmp_path / turning.name)
    for path in (root / "lidar").iterdir():
        path.unlink()
    told = verdict(root)
    assert isinstance(told, Undecided)
    assert told.why == "no lidar"
