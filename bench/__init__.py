"""Benchmark of moving-object segmentation in automotive fisheye images.

Moving objects are annotated in the lidar point cloud, projected into the fisheye image, and the bounding
polygon is the reference that a segmentation method is scored against (Mariotti and Eising 2020).

Start reading in `bench.evaluation`. The packages, from the top down, each importing only from those below:
`cli`, `reporting`, `harness`, `evaluation`, `methods` | `reference` | `synthesis`, `recordings`,
`cameras` | `lidar` | `egomotion`, `geometry` | `flow`, `execution`, `errors`.
"""

__version__ = "0.1.0"
