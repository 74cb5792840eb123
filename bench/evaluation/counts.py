"""Integer pixel counts of one image: per object, for the frame, by likelihood and by chance; no ratio yet.

The regions are those of `bench.evaluation`: V valid, G_i of object i, I ignored, D detected within V.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import ShapeError
from bench.records.reference import ReferenceFrame, Status
from bench.records.segmentation import PAPER_THRESHOLD

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Regions:
    """Regions of an image where a detection is right, wrong, or missing.

    Attributes:
        moving: (H, W) bool, all G.
        outside: (H, W) bool, V minus (all G u I).
        detected_px: |D|.
        true: (H, W) bool, D in all G.
        false: (H, W) bool, D outside all G and I.
        component: (H, W) int32, 1 for the first 8-connected component of D, 0 outside D.
        components: number of labels of `component`, 0 included.
    """

    moving: Mask
    outside: Mask
    detected_px: int
    true: Mask
    false: Mask
    component: NDArray[np.int32]
    components: int


Counts = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectCounts:
    """Pixels of one object in one image; all 0 unless it is evaluated.

    Attributes:
        tp: |D n G_i|.
        fn: |G_i minus D|.
        fp: its share of the false positives in the components of D that touch G_i.
    """

    tp: int
    fn: int
    fp: int


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameCounts:
    """Pixels of one image.

    A false-positive component is what of one 8-connected component of D lies outside all G and I.

    Attributes:
        width: of the image, px.
        height: of the image, px.
        valid_px: |V|.
        reference_px: |all G|.
        ignored_px: |I| within V.
        detected_px: |D|.
        tp_px: |D n all G|.
        fn_px: |all G minus D|.
        fp_px: |D minus (all G u I)|.
        fp_unattached_px: those of `fp_px` in components that touch no object; the rest is shared among the objects.
        fp_components: false-positive components.
        fp_large_components: those larger than the protocol's size.
        fp_largest_px: size of the largest, 0 without any.
    """

    width: int
    height: int
    valid_px: int
    reference_px: int
    ignored_px: int
    detected_px: int
    tp_px: int
    fn_px: int
    fp_px: int
    fp_unattached_px: int
    fp_components: int
    fp_large_components: int
    fp_largest_px: int


def find_regions(reference: ReferenceFrame, detected: Mask) -> Regions:
    """The region masks of an image.

    Args:
        reference: of the image.
        detected: (H, W) bool, the method's mask; what lies outside V is left out.

    Raises:
        ShapeError: `detected` is not of the image's size.
    """
    if detected.shape != reference.valid.shape:
        where = f"{reference.recording}, {reference.camera}, {reference.timestamp_ns} ns"
        expected = f"a mask of {reference.valid.shape} (height, width)"
        raise ShapeError(f"{where}: expected {expected}, got {detected.shape}")
    mask = detected & reference.valid
    components, component = cv2.connectedComponents(mask.view(np.uint8), connectivity=8, ltype=cv2.CV_32S)
    moving = reference.labels > 0
    outside = reference.valid & ~(moving | reference.ignored)
    return Regions(
        moving=moving,
        outside=outside,
        detected_px=int(np.count_nonzero(mask)),
        true=mask & moving,
        false=mask & outside,
        component=component.astype(np.int32, copy=False),
        components=components,
    )


def count_by_cell(mask: Mask, cell_size_px: int) -> NDArray[np.int64]:
    """Pixels of a mask in each square cell; cells tile the image from its first pixel.

    Args:
        mask: (H, W) bool.
        cell_size_px: side of a cell, px.

    Returns:
        (ceil(H / cell), ceil(W / cell)) int64, exact; cells at the border hold what the image has.
    """
    sums = cv2.integral(mask.view(np.uint8))
    rows, columns = (np.append(np.arange(0, size, cell_size_px), size) for size in mask.shape)
    counts: NDArray[np.int64] = np.diff(np.diff(sums[rows[:, None], columns], axis=0), axis=1).astype(np.int64)
    return counts


def sum_by_kind(mask: Mask, kinds: NDArray[np.integer], *, cell_size_px: int, bins: int) -> NDArray[np.int64]:
    """Pixels of a mask by the kind of the cell that they lie in.

    Args:
        mask: (H, W) bool.
        kinds: (rows, columns) integers in [0, bins), of each cell.
        cell_size_px: side of a cell, px.
        bins: how many kinds there are.

    Returns:
        (bins,) int64.
    """
    weights = count_by_cell(mask, cell_size_px)
    assert weights.shape == kinds.shape, "the cells tile the image"
    # Sums of whole numbers below 2^53 are exact in float64.
    return np.bincount(kinds.ravel(), weights=weights.ravel(), minlength=bins).astype(np.int64)


def share_in_proportion(amounts: NDArray[np.int64], *, weights: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give each amount to the columns of its row in proportion to their weights, by largest remainder.

    Equal remainders are served from the first column on; rows without any weight give nothing.

    Args:
        amounts: (R,) int64, >= 0.
        weights: (R, K) int64, >= 0.

    Returns:
        shares: (K,) int64; they sum to the amounts of the rows with weight.

    Example:
        7 pixels over weights (1, 1, 1): 3, 2, 2.
    """
    rows = (amounts > 0) & weights.any(axis=1)
    amount, weight = amounts[rows, None], weights[rows]
    total = weight.sum(axis=1, keepdims=True)
    whole, remainder = np.divmod(amount * weight, np.maximum(total, 1))
    left = amount - whole.sum(axis=1, keepdims=True)
    # A stable sort leaves equal remainders in the order of the columns.
    rank = np.argsort(np.argsort(-remainder, axis=1, kind="stable"), axis=1, kind="stable")
    shares: NDArray[np.int64] = (whole + (rank < left)).sum(axis=0, dtype=np.int64)
    return shares


def count_frame(
    reference: ReferenceFrame,
    detected: NDArray[np.bool_],
    *,
    component_size_px: int,
    regions: Regions | None = None,
) -> tuple[FrameCounts, tuple[ObjectCounts, ...]]:
    """Count one image.

    Args:
        reference: of the image.
        detected: (H, W) bool, the method's mask; what lies outside V is left out.
        component_size_px: false-positive components with more pixels than this are large.
        regions: of the image, where the caller has them already.

    Returns:
        frame: counts of the image.
        objects: one per `reference.objects`, in their order.

    Raises:
        ShapeError: `detected` is not of the image's size.

    Source:
        Mariotti and Eising 2020, section IV (TP, FN and FP areas); component-wise sharing of false positives after
        Chan et al. 2021 (SegmentMeIfYouCan).
    """
    # By track id, so that ties are broken the same way whatever order objects come in.
    order = np.argsort([item.track_id for item in reference.objects], kind="stable")
    regions = regions or find_regions(reference, detected)
    region_px = _region_px(reference, regions)
    fp_of_component = np.bincount(regions.component[regions.false], minlength=regions.components)
    overlap = _overlap(reference, regions)
    tp = overlap.sum(axis=0)
    fp = np.zeros_like(tp)
    fp[order] = share_in_proportion(fp_of_component, weights=overlap[:, order])

    frame = FrameCounts(
        width=reference.valid.shape[1],
        height=reference.valid.shape[0],
        valid_px=int(np.count_nonzero(reference.valid)),
        reference_px=int(region_px.sum()),
        ignored_px=int(np.count_nonzero(reference.ignored & reference.valid)),
        detected_px=regions.detected_px,
        tp_px=int(tp.sum()),
        fn_px=int((region_px - tp).sum()),
        fp_px=int(fp_of_component.sum()),
        fp_unattached_px=int(fp_of_component[~overlap.any(axis=1)].sum()),
        fp_components=int(np.count_nonzero(fp_of_component)),
        fp_large_components=int(np.count_nonzero(fp_of_component > component_size_px)),
        fp_largest_px=int(fp_of_component.max(initial=0)),
    )
    columns = zip(tp.tolist(), (region_px - tp).tolist(), fp.tolist(), strict=True)
    return frame, tuple(ObjectCounts(tp=t, fn=n, fp=f) for t, n, f in columns)


def _overlap(reference: ReferenceFrame, regions: Regions) -> Counts:
    """(components, objects) pixels of each component of D in each G_i."""
    shape = (regions.components, len(reference.objects))
    component, label = regions.component[regions.true].astype(np.int64), reference.labels[regions.true]
    return np.bincount(component * shape[1] + label - 1, minlength=shape[0] * shape[1]).reshape(shape)


def _region_px(reference: ReferenceFrame, regions: Regions) -> Counts:
    """|G_i|: (objects,)."""
    region_px = np.bincount(reference.labels[regions.moving], minlength=len(reference.objects) + 1)[1:]
    evaluated = np.array([item.status is Status.EVALUATED for item in reference.objects], dtype=bool)
    assert np.array_equal(region_px > 0, evaluated), "exactly the evaluated objects have a region"
    return region_px


# The paper's threshold is an edge, so that its operating point lies on the curve. 20 bins a decade, from a thousandth
# of it to beyond pi, which no weighted mean of angles exceeds.
PER_DECADE = 20
_LOWEST, _HIGHEST = -3 * PER_DECADE, 4 * PER_DECADE
EDGES: NDArray[np.float64] = np.concatenate(
    [[0.0], PAPER_THRESHOLD * 10 ** (np.arange(_LOWEST, _HIGHEST + 1) / PER_DECADE), [np.inf]]
)
EDGES.setflags(write=False)
BINS = len(EDGES) - 1

# A score in [0, 1] is binned by its odds s / (1 - s), since networks crowd at both ends: 20 bins a decade, evenly to
# both sides of 0.5, which is an edge. They reach from odds of 1 : 3162 to 3162 : 1; scores beyond share the end bins.
_MIDDLE = (len(EDGES) - 1) // 2
_ODDS = 10.0 ** ((np.arange(1, BINS) - _MIDDLE) / PER_DECADE)
SCORE_EDGES: NDArray[np.float64] = np.concatenate([[0.0], _ODDS / (1.0 + _ODDS), [np.inf]])
SCORE_EDGES.setflags(write=False)

REFERENCE_COLUMN, OUTSIDE_COLUMN = "likelihood_reference_px", "likelihood_outside_px"


def count_likelihood(
    likelihood: NDArray[np.float32], regions: Regions, *, cell_size_px: int, is_score: bool = False
) -> dict[str, NDArray[np.int64]]:
    """Count an image into both histograms; bin k is the interval (EDGES[k], EDGES[k + 1]], and bin 0 holds 0 too.

    Args:
        likelihood: (rows, columns), of each cell; NaN counts as 0, as it is above no threshold.
        regions: of the image.
        cell_size_px: side of a cell, px.
        is_score: whether the likelihood is a score in [0, 1], whose bins have the edges `SCORE_EDGES`.

    Returns:
        (BINS,) int64 each, pixels of all G by `REFERENCE_COLUMN`, of V outside all G and I by `OUTSIDE_COLUMN`.
    """
    bins = find_bins(likelihood, SCORE_EDGES if is_score else EDGES)
    return {
        column: sum_by_kind(region, bins, cell_size_px=cell_size_px, bins=BINS)
        for column, region in ((REFERENCE_COLUMN, regions.moving), (OUTSIDE_COLUMN, regions.outside))
    }


def find_bins(likelihood: NDArray[np.float32], edges: NDArray[np.float64] = EDGES) -> NDArray[np.int64]:
    """The bin of each likelihood or score, in its shape; k where edges[k] < value <= edges[k + 1], 0 for NaN."""
    return np.searchsorted(edges[1:-1], np.nan_to_num(likelihood, nan=0.0).astype(np.float64), side="left")


class ChanceScorer:
    """Scores the frames of one camera's sequence, fed in time order, against the mask of a frame `lag_ns` away.

    A frame is scored against the latest mask at least `lag_ns` earlier. The first frames, which have none, are scored
    against the first mask at least `lag_ns` later. In a sequence that is too short for either there is no chance level.
    Masks are held at one bit a pixel, of objects the pixels of their regions.

    Args:
        lag_ns: how far away the other frame is.
    """

    def __init__(self, *, lag_ns: int) -> None:
        self._lag_ns = lag_ns
        self._times_ns: list[int] = []
        self._masks: list[NDArray[np.uint8]] = []
        self._objects: list[tuple[dict[str, int], NDArray[np.int32], NDArray[np.int32]]] = []

    def add(self, reference: ReferenceFrame, detected: Mask) -> None:
        """Take the next frame.

        Args:
            reference: of the frame.
            detected: (H, W) bool, the method's mask of the frame.
        """
        assert not self._times_ns or reference.timestamp_ns > self._times_ns[-1], "frames come in time order"
        flat = reference.labels.reshape(-1)
        pixels = np.flatnonzero(flat > 0).astype(np.int32)
        labels = {o.track_id: k for k, o in enumerate(reference.objects, start=1) if o.status is Status.EVALUATED}
        self._times_ns.append(reference.timestamp_ns)
        self._masks.append(np.packbits(detected))
        self._objects.append((labels, pixels, flat[pixels]))

    def finish(self) -> dict[int, dict[str, int]]:
        """End the sequence.

        Returns:
            By timestamp, then by track id: pixels of the object in the other frame's mask. Frames without another
            one are missing, and so are objects that are not evaluated.
        """
        times_ns = np.array(self._times_ns, dtype=np.int64)
        earlier = np.searchsorted(times_ns, times_ns - self._lag_ns, side="right") - 1
        later = np.searchsorted(times_ns, times_ns + self._lag_ns, side="left")
        others = np.where(earlier >= 0, earlier, later).tolist()
        chance = {}
        for time_ns, other, (labels, pixels, label_of) in zip(self._times_ns, others, self._objects, strict=True):
            if other < len(self._masks):
                bits = self._masks[other][pixels >> 3] >> (7 - (pixels & 7)).astype(np.uint8) & 1
                px = np.bincount(label_of[bits == 1], minlength=max(labels.values(), default=0) + 1)
                chance[time_ns] = {name: int(px[label]) for name, label in labels.items()}
        return chance
