"""Overlap of all detected components with all objects of an image, beside `pycocotools` on the same masks."""

import cv2
import numpy as np
from pycocotools import mask as coco

from bench.evaluation.counts import count_frame, find_regions
from bench.records.reference import ReferenceFrame, Status
from benchmarks.turns import best_seconds


def iou_of_all(reference: ReferenceFrame, detected: np.ndarray) -> np.ndarray:
    """(components, objects) float64: as matching needs it, from the label images."""
    regions = find_regions(reference, detected)
    objects = len(reference.objects)
    labels = reference.labels.ravel().astype(np.int64)
    component = regions.component.ravel().astype(np.int64)
    both = np.bincount(component * (objects + 1) + labels, minlength=regions.components * (objects + 1))
    table = both.reshape(regions.components, objects + 1)
    overlap = table[1:, 1:]
    union = table[1:].sum(axis=1, keepdims=True) + table[:, 1:].sum(axis=0, keepdims=True) - overlap
    return overlap / np.maximum(union, 1)


def iou_by_pycocotools(reference: ReferenceFrame, detected: np.ndarray) -> np.ndarray:
    """The same by run lengths, masks encoded on the way as they come."""
    count, component = cv2.connectedComponents((detected & reference.valid).view(np.uint8), connectivity=8)
    if count == 1 or not reference.objects:
        return np.zeros((count - 1, len(reference.objects)))
    found = np.asfortranarray((component[..., None] == np.arange(1, count)).view(np.uint8))
    expected = np.asfortranarray(
        (reference.labels[..., None] == np.arange(1, len(reference.objects) + 1)).view(np.uint8)
    )
    encoded = coco.encode(expected)
    return np.asarray(coco.iou(coco.encode(found), encoded, [0] * len(encoded))).reshape(count - 1, len(encoded))


def milliseconds(scored: list[tuple[ReferenceFrame, np.ndarray]], *, rounds: int = 5) -> dict[str, float]:
    """Per image: our counts with sharing, overlaps alone, and `pycocotools`; after seeing that both agree."""
    for reference, detected in scored:
        evaluated = [item.status is Status.EVALUATED for item in reference.objects]
        ours, theirs = iou_of_all(reference, detected), iou_by_pycocotools(reference, detected)
        if not np.allclose(ours[:, evaluated], theirs[:, evaluated], atol=1e-12):
            raise AssertionError("expected the same overlaps from both")
    seconds = best_seconds(
        {
            "counts of the image and of every object": lambda: [
                count_frame(reference, detected, component_size_px=100) for reference, detected in scored
            ],
            "overlap of every component with every object": lambda: [iou_of_all(*one) for one in scored],
            "the same by pycocotools": lambda: [iou_by_pycocotools(*one) for one in scored],
        },
        rounds=rounds,
    )
    return {name: 1e3 * spent / len(scored) for name, spent in seconds.items()}
