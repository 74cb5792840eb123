"""Benchmark of moving-object segmentation in automotive fisheye images.

Moving objects are annotated in the lidar point cloud, projected into the fisheye image, and the bounding
polygon is the reference that a segmentation method is scored against (Mariotti and Eising 2020).

Start reading in `bench.evaluation`. Which package may import which: docs/architecture.md.
"""

__version__ = "0.1.0"
