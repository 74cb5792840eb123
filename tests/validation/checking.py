"""What the checks say of a small drive."""

from contextlib import ExitStack
from types import SimpleNamespace
from unittest.mock import patch

from bench.recordings.native import native_recordings
from bench.validation import report
from bench.validation.fits import box_fit
from bench.validation.fits.cameras import check_cameras
from bench.validation.fits.static_world import check_static_world
from bench.validation.report import validate_recording

STATIC_WORLD = (check_static_world, check_cameras)


def found(root, *, deep=False, static_world=False, returns=False):
    """Findings in the drive; by the static world and by returns in boxes, which take most of the time, where asked."""
    checks = [check for check in report.CHECKS if static_world or check[0] not in STATIC_WORLD]
    blind = SimpleNamespace(add=lambda _: None, findings=lambda: ())
    (handle,) = native_recordings(root, options={}, card=root / "card.yaml", annotations=None)
    with (
        patch.object(report, "CHECKS", checks),
        patch.object(box_fit, "MOST_TRIED", 2),  # in every reading, of the four objects in a sweep
        ExitStack() as without,
    ):
        if not returns:
            without.enter_context(patch.multiple(report, BoxFit=lambda _: blind, check_unboxed=lambda _: ()))
        return list(validate_recording(handle, deep=deep).findings)
