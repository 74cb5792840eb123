"""Tables and pictures of stored results; it prints nothing and scores nothing.

Tables and range maps read only what a run has stored. The pictures of single frames take records that the harness
fills. A report is told once, as a `Report` of `document`: blocks for people (terminal, Markdown, HTML, LaTeX; text from
outside is escaped there), and numbers for programs (CSV, JSON). A figure is one of matplotlib on its own Agg canvas.
The functions `write_*` store files; equal input gives equal bytes.

- `document` (blocks, reports and their writers), `formats` (how values and intervals are written everywhere), `canvas`
  (colours, figures), `overlay` (masks, polygons and the areas that a frame is scored by, over images);
- `tables`, `table_files` (ours beside the paper's), `verdict` (of the gate), `totals` (of a run), `findings` (what is
  wrong with data or predictions), `citation` (BibTeX);
- `range_maps`, `panels` (the paper's figures), `side_by_side` (of one or several methods on one image),
  `frame_pictures` (all pictures of one frame), `video`, `rerun_log`;
- `sweep` (one setting through many values), `audit_tables`,
  `audit_pictures`;
- `proposal_scores` (proposals against annotations);
- `page` (the page of a run), `compare` (runs against each other), `leaderboard` (all runs of a folder).

Images are (H, W) grey or (H, W, 3) BGR uint8, pixels (u, v) with the centre of the first pixel at (0, 0). Pictures of
the ground are in the vehicle frame, x forward up and y left to the left.
"""
