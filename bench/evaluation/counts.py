"""Integer pixel counts of one image: per object and for the frame. No ratio is taken here.

The regions are those of `bench.evaluation`: V valid, G_i of object i, I ignored, D detected within V.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.evaluation.regions import Regions, sum_over_cells, take_apart
from bench.evaluation.sharing import share_in_proportion
from bench.reference.records import ReferenceFrame, Status

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
        fp_by_cause: `fp_px` by the cause that the method names; empty for a method that names none.
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
    fp_by_cause: Mapping[str, int]


def count_frame(
    reference: ReferenceFrame,
    detected: NDArray[np.bool_],
    *,
    cause: NDArray[np.uint8] | None = None,
    causes: tuple[str, ...] = (),
    cell_size_px: int = 1,
    component_size_px: int,
    regions: Regions | None = None,
) -> tuple[FrameCounts, tuple[ObjectCounts, ...]]:
    """Count one image.

    Args:
        reference: of the image.
        detected: (H, W) bool, the method's mask; what lies outside V is left out.
        cause: (rows, columns) uint8 of each cell, index into `causes`; None for a method that names none.
        causes: what can flag a cell.
        cell_size_px: side of the cells of `cause`, px.
        component_size_px: false-positive components with more pixels than this are large.
        regions: of the image, where the caller has taken it apart already.

    Returns:
        frame: counts of the image.
        objects: one per `reference.objects`, in their order.

    Raises:
        ShapeError: `detected` is not of the image's size, or the cells of `cause` do not tile it.

    Source:
        Mariotti and Eising 2020, section IV (TP, FN and FP areas); component-wise sharing of false positives after
        Chan et al. 2021 (SegmentMeIfYouCan).
    """
    order = _canonical_order(reference)
    regions = regions or take_apart(reference, detected)
    region_px = _region_px(reference, regions)
    fp_of_component = _false_positives_by_component(regions)
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
        fp_by_cause=_false_positives_by_cause(regions, cause, causes, cell_size_px),
    )
    columns = zip(tp.tolist(), (region_px - tp).tolist(), fp.tolist(), strict=True)
    return frame, tuple(ObjectCounts(tp=t, fn=n, fp=f) for t, n, f in columns)


def _false_positives_by_component(regions: Regions) -> Counts:
    """(components,) pixels outside all G and I."""
    return np.bincount(regions.component[regions.false], minlength=regions.components)


def _overlap(reference: ReferenceFrame, regions: Regions) -> Counts:
    """(components, objects) pixels of each component of D in each G_i."""
    shape = (regions.components, len(reference.objects))
    true = regions.true[regions.window]
    component = regions.component[regions.window][true].astype(np.int64)
    label = reference.labels[regions.window][true]
    return np.bincount(component * shape[1] + label - 1, minlength=shape[0] * shape[1]).reshape(shape)


def _false_positives_by_cause(
    regions: Regions, cause: NDArray[np.uint8] | None, causes: tuple[str, ...], cell_size_px: int
) -> dict[str, int]:
    if cause is None:
        return {}
    found = sum_over_cells(regions.false, cause, cell_size_px=cell_size_px, bins=len(causes), name="cause")
    return dict(zip(causes, found.tolist(), strict=True))


def _region_px(reference: ReferenceFrame, regions: Regions) -> Counts:
    """|G_i|: (objects,)."""
    inside = reference.labels[regions.window][regions.moving[regions.window]]
    region_px = np.bincount(inside, minlength=len(reference.objects) + 1)[1:]
    evaluated = np.array([item.status is Status.EVALUATED for item in reference.objects], dtype=bool)
    assert np.array_equal(region_px > 0, evaluated), "exactly the evaluated objects have a region"
    return region_px


def _canonical_order(reference: ReferenceFrame) -> NDArray[np.int64]:
    """Objects by track id, so that ties are broken the same way whatever order they come in."""
    ids = [item.track_id for item in reference.objects]
    return np.array(sorted(range(len(ids)), key=ids.__getitem__), dtype=np.int64)
