"""What a run stores of a method's answer."""

from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from bench.harness.masks import MASKS, MASKS_SCHEMA, StoredMasks, mask_row
from bench.methods import Segmentation
from tests.support.manifests import method_of_run

IMAGE = SimpleNamespace(recording="drive", camera_name="front", timestamps_ns=(0, 7))


def test_an_answer_is_read_back(tmp_path):
    mask = np.arange(20).reshape(4, 5) % 3 == 0
    answer = Segmentation(
        cell_size_px=2, mask=mask, likelihood=mask.astype(np.float32), threshold=0.25, causes=("epipolar",)
    )
    row = mask_row(answer, recording="drive", camera="front", timestamp_ns=7)
    table = pa.Table.from_pylist([row], schema=MASKS_SCHEMA)
    pq.write_table(table, tmp_path / MASKS)
    read = StoredMasks(tmp_path, method_of_run("own")).segment(IMAGE)
    assert (read.threshold, read.causes) == (0.25, ("epipolar",))
    assert (read.mask == mask).all()
