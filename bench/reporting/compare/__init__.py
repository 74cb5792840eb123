"""Runs against each other: what changed, by how much the data can tell, and where to look.

Only runs of the same data set, split and protocol stand in one table, on the images that they scored in common, and
only if their references agree on these. The first run is the one compared against.

- `stored_runs` (reading and refusing), `like_for_like` (common images, differing references), `changes` (paired changes
  by row and metric, Holm), `verdicts` (words for them), `detections` (object-frames gained and lost), `pictures` (both
  methods on one frame);
- `comparison_text`, `comparison_files`, `comparison_table` (Markdown; CSV and JSON; terminal), `write` (all files);
- `leaderboard` (runs of a folder in groups), `leaderboard_files` (terminal, Markdown, CSV, JSON).

Equal input gives equal bytes.
"""
