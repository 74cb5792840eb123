"""From reference and prediction to the figures of the paper's table. Read this first.

The question is how well a method finds what moves in a fisheye image, when the only truth is a polygon around an
object's lidar points. Everything is counted in whole pixels, per object and per image; ratios are taken last.

**Regions of one image.** V: pixels that count, inside the lens's field and off the host's own body. G_i: pixels of
object i's reference polygon in V, minus those of nearer objects. I: polygons of moving objects that are not evaluated
(too far, too few points, unclear ...), minus every G; a detection there is neither right nor wrong. D: detected
pixels in V. Every annotated object is evaluated, ignored for a reason, or static, and the ledger counts them.

**Per object-frame** (one object in one image): TP_i = |D n G_i|, FN_i = |G_i minus D|. It is detected when TP_i > 0;
beside that stand detection at a coverage of 10 % and of 50 %, and what chance would give: the same object scored
against the mask of another frame of its sequence. Coverage is TP_i / (TP_i + FN_i). FP_i is the object's share of the
false positives in the components of D that touch it, so IoU_i = TP_i / (TP_i + FP_i + FN_i).

**Per image-frame**: FP = |D minus (all G u I)|, as a share of the image (false-positive coverage) and of V; components
of false positives; the summed counts of the moving class; which constraint flagged the false pixels.

**Per category**: detection rates and chance are shares of object-frames; TPR is the mean coverage of the detected
object-frames (the paper's wording), `tpr_all` that of all; IoU is the mean over all object-frames, an undetected one
having 0, and `iou_detected` the mean over the detected ones. The latter compares with the paper: its crossing row
(72 % detected, 64 % TPR, 55 % IoU) is impossible for a mean over all. 0/0 is NaN, null in JSON, "n/a (0 cases)" in
words. Intervals take recordings as independent, not frames; fewer than six recordings with cases have none.

Beside its counts an image leaves two histograms of pixels over the motion likelihood, from which the score at any
threshold follows, and adds to its camera's map of misses and false positives.

**Between two runs** over the same data nothing is compared but sums by recording (the score sheet), of the images that
both scored: the same recording is left out of both at a time, so that what makes it hard cancels out.

**A run may be larger than the memory.** Its tables are read some recordings at a time and reduced to sums by recording
and slice; neither the order of the rows nor the size of the parts changes a bit of them.

The files, in the order of the data: `protocol` (the rules, a versioned file with a digest), `regions` (one image taken
apart), `counts` with `sharing`, `likelihood` and `image_maps` (what is counted in it), `chance`, `scorer` (the recipe
over a sequence), `rows` (the two tables), `row_source` and `columns` (reading them in parts), `run_sums` with `terms`,
`slices`, `bins`, `slice_sums` and `ledger` (the reduction), `totals` with `object_figures`, `frame_figures`, `ratios`
and `intervals` (figures from the sums), `summary` (what comes out), `maps` (detection rate by place),
`coverage_curves`, `score_sheet` with `metric_sums`, `paired`, `common_images` and `changes` (two runs), `published`
(the paper's numbers), `threshold_free` (what a likelihood is worth at all thresholds together). The harness calls
`SequenceScorer` and `summarise`; reporting and the gate read `Summary`, `ScoreSheet`, the tables, `range_maps`,
`ImageMap` and `threshold_sweep`.

Sources: Mariotti and Eising 2020, section IV; Chan et al. 2021 (SegmentMeIfYouCan) for the sharing of components;
those of the intervals in their module; Holm 1979.
"""

from bench.evaluation.counts import FrameCounts, ObjectCounts, count_frame
from bench.evaluation.image_maps import ImageMap, add_image_maps
from bench.evaluation.likelihood import ThresholdFreeFigures, ThresholdSweep, threshold_free_figures, threshold_sweep
from bench.evaluation.maps import CoverageCurve, RangeMap, RangeMaps, coverage_curves, range_maps
from bench.evaluation.protocol import Protocol, known_protocols, load_protocol
from bench.evaluation.row_source import Rows, RowSource
from bench.evaluation.rows import FRAMES_SCHEMA, OBJECTS_SCHEMA
from bench.evaluation.score_sheet import (
    MetricSums,
    PairedChange,
    ScoreSheet,
    changes_in_parts,
    holm,
    object_changes,
    paired_change,
    score_sheet,
)
from bench.evaluation.scorer import SequenceScorer
from bench.evaluation.summary import FalsePositiveFigures, Figure, ObjectFigures, Summary
from bench.evaluation.totals import summarise

__all__ = [
    "FRAMES_SCHEMA",
    "OBJECTS_SCHEMA",
    "CoverageCurve",
    "FalsePositiveFigures",
    "Figure",
    "FrameCounts",
    "ImageMap",
    "MetricSums",
    "ObjectCounts",
    "ObjectFigures",
    "PairedChange",
    "Protocol",
    "RangeMap",
    "RangeMaps",
    "RowSource",
    "Rows",
    "ScoreSheet",
    "SequenceScorer",
    "Summary",
    "ThresholdFreeFigures",
    "ThresholdSweep",
    "add_image_maps",
    "changes_in_parts",
    "count_frame",
    "coverage_curves",
    "holm",
    "known_protocols",
    "load_protocol",
    "object_changes",
    "paired_change",
    "range_maps",
    "score_sheet",
    "summarise",
    "threshold_free_figures",
    "threshold_sweep",
]
