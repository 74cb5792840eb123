"""Tables and pictures of stored results; it prints nothing and scores nothing.

Tables and range maps read only what a run has stored. The pictures of single frames take records that the harness
fills. Everything comes back as text, as a `rich` table or as a matplotlib figure on its own Agg canvas, and `write`
stores it; equal input gives equal bytes.

Callers import the file they need, since this room's drawing files load matplotlib and its table files do not:

- `tables` (rows: ours beside the paper's), `table_files` (Markdown, LaTeX, CSV, JSON), `terminal_table` (`rich`);
- `range_maps`, `panels`, `count_view`, `cluster_view` (the paper's figures), `overlay` (fast, OpenCV only);
- `write` (the files of a report), `frame_pictures` (all pictures of one frame);
- `sweep_report`, `sweep_chart`, `sweep_files` (one thing through many values);
- `page` (the page of a run), `compare` (runs against each other, leaderboard).

Images are (H, W) grey or (H, W, 3) BGR uint8, pixels (u, v) with the centre of the first pixel at (0, 0). Pictures of
the ground are in the vehicle frame, x forward up and y left to the left.
"""
