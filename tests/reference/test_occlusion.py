"""Windows of polygons laid over each other, against the same done pixel by pixel."""

import numpy as np
import pytest

from bench.reference import IgnoreReason, ReferenceObject, Status
from bench.reference.regions import Region, compose
from tests.reference.drives import a_region, an_object

ROWS, COLUMNS = 30, 40


def some_objects(rng: np.random.Generator) -> list[tuple[ReferenceObject, Region | None]]:
    found = []
    for _ in range(rng.integers(1, 9)):
        (top, bottom), (left, right) = np.sort(rng.integers(0, (ROWS + 1, COLUMNS + 1), (2, 2)).T)
        covered = rng.random((bottom - top, right - left)) < rng.choice([0.1, 0.9])
        window = slice(int(top), int(bottom)), slice(int(left), int(right))
        region = a_region(window, covered)
        found.append((an_object(rng.choice(list(Status))), region if rng.random() < 0.9 else None))
    return found


@pytest.mark.parametrize("seed", range(40))
def test_every_pixel_goes_to_the_nearest_object_that_covers_it(seed):
    objects = some_objects(np.random.default_rng(seed))
    settled, labels, ignored, _ = compose(*zip(*objects, strict=True), np.ones((ROWS, COLUMNS), dtype=bool))

    cover = np.zeros((len(objects), ROWS, COLUMNS), dtype=bool)
    for image, (_, region) in zip(cover, objects, strict=True):
        if region is not None:
            image[region.window] = region.core
    nearest = np.where(cover.any(axis=0), cover.argmax(axis=0), -1)
    evaluated = [found.status is Status.EVALUATED for found, _ in objects]
    expected = np.where((nearest >= 0) & np.array(evaluated)[nearest], nearest + 1, 0)
    covering = [region is not None for _, region in objects]
    occluded = [evaluated[k] and covering[k] and not (nearest == k).any() for k in range(len(objects))]
    hidden = [found.status is Status.IGNORED or gone for (found, _), gone in zip(objects, occluded, strict=True)]

    assert labels.dtype == np.int32
    np.testing.assert_array_equal(labels, expected)
    np.testing.assert_array_equal(ignored, cover[hidden].any(axis=0) & (expected == 0))
    for k, result in enumerate(settled):
        assert result.region_px == (int((expected == k + 1).sum()) if evaluated[k] else 0)
        assert (result.reason is IgnoreReason.OCCLUDED) == (result.status is not objects[k][0].status) == occluded[k]
