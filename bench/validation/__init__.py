"""Validation: everything that is wrong with a data set, found and reported in one pass.

Each check is a function from a recording to findings and knows nothing of the others. Recordings are opened one by one,
images and sweeps are read file by file; one that cannot be used is a finding and stops none of the others. Quick checks
look at files, values and labels (`quick`), fits try one sensor against another (`fits`). Limits are
those of physics and of everyday bodies, in `findings`; what a sensor measured is tried against another (the path
against lidar sweeps, boxes against the points in them, stated velocities against positions).
"""
