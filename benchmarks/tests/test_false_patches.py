"""Where a false patch lies, by hand."""

import numpy as np

from benchmarks.false_patches import told


def test_a_patch_beside_an_object_that_hid_half_of_it():
    patch, hid, pixels = np.zeros((8, 8), bool), np.zeros((8, 8), bool), np.full((8, 8), 90, np.uint8)
    patch[2:4, 2:6] = True
    hid[:, :4] = True
    pixels[2, 2:4] = 5
    columns_away = np.broadcast_to(np.arange(8, dtype=np.float32), (8, 8))
    assert told(patch, hid, columns_away, pixels) == {"px": 8.0, "beside": 1.0, "hidden": 0.5, "dark": 0.25}
    assert told(patch, hid, columns_away + 2, pixels)["beside"] == 0.0
