"""What a run stores of a method's answer."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from bench.harness.masks import MASKS, MASKS_SCHEMA, mask_row, read_mask
from bench.methods import Segmentation


def test_an_answer_is_read_back(tmp_path):
    mask = np.arange(20).reshape(4, 5) % 3 == 0
    answer = Segmentation(
        cell_size_px=2, mask=mask, likelihood=mask.astype(np.float32), threshold=0.25, causes=("epipolar",)
    )
    key = {"recording": "drive", "camera": "front", "timestamp_ns": 7}
    row = mask_row(answer, **key)
    table = pa.Table.from_pylist([row], schema=MASKS_SCHEMA)
    pq.write_table(table, tmp_path / MASKS)
    read = read_mask(tmp_path / MASKS, **key)
    assert (read.threshold, read.causes) == (0.25, ("epipolar",))
    assert (read.mask == mask).all()
