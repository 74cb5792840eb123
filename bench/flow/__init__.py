"""Dense optical flow and its average on cells.

Flow is asked for **from the current image to the previous one**: the pixel x of the current image was at
`x + flow[x]` in the previous image. So whatever is computed from it belongs to the current image.
"""

from bench.flow.cells import cell_mean
from bench.flow.dense import DENSE_FLOWS, DenseFlow, DisFlow, FarnebackFlow, dense_flow

__all__ = ["DENSE_FLOWS", "DenseFlow", "DisFlow", "FarnebackFlow", "cell_mean", "dense_flow"]
