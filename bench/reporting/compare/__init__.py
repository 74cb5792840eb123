"""Runs against each other: what changed, what the data can say of it, and where to look.

Only runs of the same data set, split and protocol are compared, on the images that they scored in common, and only if
their references agree on these. The first run is the one compared against.

- `runs` (reading and refusing, common images, differing references), `changes` (paired changes by row and metric, Holm,
  verdicts, object-frames gained and lost), `pictures` (both methods on one frame), `writing` (Markdown, CSV, JSON,
  terminal, all files).

Equal input gives equal bytes.
"""
