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
words. Intervals resample whole recordings, since frames of one are not independent.

The files, in the order of the data: `protocol` (the rules, a versioned file with a digest), `counts` with `sharing`
(one image), `chance`, `scorer` (the recipe over a sequence), `rows` (the two tables), `totals` with `object_figures`,
`frame_figures`, `ledger`, `bins`, `ratios` and `bootstrap` (the reduction), `summary` (what comes out), `maps`
(detection rate by place), `published` (the paper's numbers). The harness calls `SequenceScorer` and `summarise`;
reporting and the gate read `Summary`, the tables and `range_maps`.

Sources: Mariotti and Eising 2020, section IV; Chan et al. 2021 (SegmentMeIfYouCan) for the sharing of components.
"""

from bench.evaluation.counts import FrameCounts, ObjectCounts, count_frame
from bench.evaluation.maps import RangeMap, RangeMaps, range_maps
from bench.evaluation.protocol import Protocol, known_protocols, load_protocol
from bench.evaluation.rows import FRAMES_SCHEMA, OBJECTS_SCHEMA
from bench.evaluation.scorer import SequenceScorer
from bench.evaluation.summary import FalsePositiveFigures, Figure, ObjectFigures, Summary
from bench.evaluation.totals import summarise

__all__ = [
    "FRAMES_SCHEMA",
    "OBJECTS_SCHEMA",
    "FalsePositiveFigures",
    "Figure",
    "FrameCounts",
    "ObjectCounts",
    "ObjectFigures",
    "Protocol",
    "RangeMap",
    "RangeMaps",
    "SequenceScorer",
    "Summary",
    "count_frame",
    "known_protocols",
    "load_protocol",
    "range_maps",
    "summarise",
]
