"""`bench.score` on arrays small enough to count by hand."""

import subprocess
import sys

import numpy as np
import pytest

import bench
from bench.errors import ShapeError, UsageError

# An object of 4 x 4 pixels; the mask finds its upper half and 2 pixels beside it.
LABELS = np.zeros((10, 20), dtype=np.int32)
LABELS[2:6, 2:6] = 7
MASK = np.zeros((10, 20), dtype=bool)
MASK[2:4, 2:7] = True
HIDING = np.ma.masked_array(MASK, mask=MASK)


@pytest.mark.parametrize("reference", [LABELS, LABELS.astype(np.uint8), LABELS > 0], ids=["labels", "uint8", "mask"])
def test_every_form_of_a_reference_counts_the_same(reference):
    score = bench.score(reference, MASK)
    (row,) = score.objects[["tp", "fn", "fp"]].to_dict("records")
    assert row == {"tp": 8, "fn": 8, "fp": 2}
    assert score.metrics["detection_rate"] == 1.0
    assert score.tpr == score.metrics["tpr_all"] == 0.5
    assert score.iou == score.metrics["iou_detected"] == 8 / 18
    assert score.false_positives == 2 / 200
    assert score.metrics["precision"] == 0.8
    assert score.metrics["detection_rate_50"] == 1.0


def test_what_is_ignored_is_neither_right_nor_wrong_and_only_valid_pixels_count():
    beside = np.zeros_like(MASK)
    beside[:, 6] = True
    assert bench.score(LABELS, MASK, ignored=beside).false_positives == 0.0
    left = np.zeros_like(MASK)
    left[:, :4] = True
    score = bench.score(LABELS, MASK, valid=left)
    assert score.objects[["tp", "fn", "fp"]].values.tolist() == [[4, 4, 0]]
    assert score.images["valid_px"].tolist() == [40]
    left[:, 5] = True  # V cuts the object in two: one of a label image, two components of a mask
    cut = [bench.score(reference, MASK, valid=left) for reference in (LABELS, LABELS > 0)]
    assert [score.objects["tp"].tolist() for score in cut] == [[6], [4, 2]]


def test_scores_of_images_add_up_before_ratios_are_taken():
    nothing = np.zeros_like(MASK)
    both = bench.Score.of([bench.score(LABELS, MASK), bench.score(LABELS, nothing), bench.score(nothing, nothing)])
    assert both.iou == 8 / 18 / 2
    assert both.metrics["iou_detected"] == 8 / 18
    assert both.false_positives == pytest.approx(2 / 200 / 3)
    assert "iou=0.222" in repr(both)
    assert np.isnan(bench.score(nothing, MASK).iou)
    with pytest.raises(UsageError, match="at least one score"):
        bench.Score.of([])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: bench.score(LABELS, MASK.astype(float)), "for scores, pass scores > 0.5"),
        (lambda: bench.score(LABELS[:5], MASK), r"reference: expected .*size \(10, 20\) .*, got \(5, 20\)"),
        (lambda: bench.score(LABELS.astype(float), MASK), "label image"),
        (lambda: bench.score(LABELS, MASK, ignored=LABELS), "ignored: expected an array of .* of bool"),
        (lambda: bench.score(MASK[:0], MASK[:0]), r"mask: expected .*, got \(0, 20\)"),
        (lambda: bench.score(LABELS, HIDING), "mask: expected .* got a masked"),
        (lambda: bench.score(np.ma.masked_array(LABELS), MASK), "reference: .* got a masked"),
    ],
)
def test_what_does_not_fit_is_refused(call, message):
    with pytest.raises((ShapeError, UsageError), match=message):
        call()


IMPORTS = {  # what is imported, and what stays unloaded then
    "import bench": {"numpy", "pandas", "cv2", "bench.commands"},
    "import bench; bench.score": {f"bench.{name}" for name in ("recordings", "methods", "reference", "harness")},
    "import bench.recordings": {"open3d", "pandas", "laspy", "matplotlib"},
    "import bench.commands.app": {"cv2", "open3d", "pandas", "scipy", "matplotlib", "numpy", "pydantic"},
}


@pytest.mark.parametrize("statement", IMPORTS)
def test_nothing_is_imported_that_is_not_used(statement):
    program = f"{statement}; import sys; print(*({IMPORTS[statement]} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "\n"


def test_a_name_that_the_package_does_not_have_is_refused():
    with pytest.raises(AttributeError, match="'scores'"):
        _ = bench.scores
