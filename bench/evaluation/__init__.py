"""From reference and prediction to the metrics of the paper's table. Read this first.

The question is how well a method finds what moves in a fisheye image, when the only truth is a region around an
object's lidar points. Everything is counted in whole pixels, per object and per image; ratios are taken last.

**Regions of one image.** V: pixels that count, inside the lens's field and off the ego vehicle's own body. G_i: pixels
of object i's reference region in V, minus those of nearer objects. I: polygons of moving objects that are not evaluated
(too far, too few points, unclear ...), minus every G; a detection there is neither right nor wrong. D: detected
pixels in V. Every annotated object is evaluated, ignored for a reason, or static, and the ledger counts them. For a
protocol with unknown bands G_i is the part of the region that is certain, and I holds the bands.

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
threshold follows.

**Between two runs** over the same data only sums per recording are compared, of the images that both scored: the same
recording is left out of both at a time, so that what makes it hard cancels out.

**A run may be larger than the memory.** Whole recordings are reduced to sums where their rows are, and the tables of
sums are added: the same values to within rounding, whatever the order of the rows and the size of the parts. What
picks single objects or images, as pages and comparisons do, takes some hundred bytes of memory for each.

The modules, in the order of the data: `protocol` (the rules, a versioned file with a digest), `counts` (region masks,
counts, histograms and chance level of one image), `rows` (the two tables), `scorer` (a sequence of images to its
tables). These decide a task; a change of the others, which reduce, computes no image again: `definitions` (every metric
once), `sums` (one long table by slice, recording and metric), `intervals`, `summary` (all metrics of a run), `maps` (by
place around the vehicle), `thresholds` (metrics over all thresholds), `comparison` (two tables of sums), `published`
(the paper's numbers). The harness calls `SequenceScorer`, `sum_run` and `summary_of`; reporting and the gate read
`Summary`, the table of sums, the rows and the maps.

Sources: Mariotti and Eising 2020, section IV; Chan et al. 2021 (SegmentMeIfYouCan) for the sharing of components;
those of the intervals in their module; Holm 1979.
"""
