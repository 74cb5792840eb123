"""The audit of a rendered data set: how good the lidar reference is, and why a method misses.

Three questions, each on the same object-frames:

1. How well do the reference polygons, of every kind and with more or less motion compensation, cover the exact masks?
2. What does that do to the score: the same detections against polygons and against masks.
3. Why are cells missed or falsely flagged: by the flow, by the ego-motion, or by the constraints themselves, which is
   decided by the exact flow of the simulated scene (`causes`).

Whether the reference ranks methods as the exact masks do, and how many beams it needs for that, are studies of
`benchmarks.ranking`.

Source: the aims are the project's; the split into causes follows section III of Mariotti and Eising 2020, where each
constraint says what it cannot see.
"""
