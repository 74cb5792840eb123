"""Tables and pictures of stored results; it prints nothing and scores nothing.

Tables and range maps read only what a run has stored. The pictures of single frames take records that the harness
fills. Everything comes back as text, as a `rich` table or as a matplotlib figure on its own Agg canvas, and the
functions `write_*` store it; equal input gives equal bytes.

- `formats` (how values, intervals and tables are written everywhere), `canvas` (colours, figures), `overlay` (masks and
  polygons over images), `stored_run` (a run as it is read);
- `tables`, `table_files` (ours beside the paper's: terminal, Markdown, LaTeX, CSV, JSON), `prediction_table`;
- `range_maps`, `panels`, `count_view` (the paper's figures), `side_by_side` (several methods on one image),
  `frame_pictures` (all pictures of one frame), `video`,
  `rerun_log`;
- `sweep` (one parameter through many values), `audit_tables`, `audit_pictures`;
- `page` (the page of a run), `compare` (runs against each other), `leaderboard` (all runs of a folder).

Images are (H, W) grey or (H, W, 3) BGR uint8, pixels (u, v) with the centre of the first pixel at (0, 0). Pictures of
the ground are in the vehicle frame, x forward up and y left to the left.
"""
