"""Tables and pictures of stored results; it prints nothing and scores nothing.

Tables and range maps read only what a run has stored. The pictures of single frames take records that the harness
fills. A report is told once, as a `Report` of `document`: blocks for people (terminal, Markdown, HTML, LaTeX; text from
outside is escaped there), and numbers for programs (CSV, JSON). A figure is one of matplotlib on its own Agg canvas.
The functions `write_*` store files; equal input gives equal bytes.

- `document` (blocks, reports and their writers), `formats` (how values and intervals are written everywhere), `canvas`
  (colours, figures, what is drawn on axes);
- `tables`, `table_files` (ours beside the paper's), `verdict` (of the gate), `totals` (of a run), `findings` (what is
  wrong with data or predictions), `citation` (BibTeX);
- `range_maps`; `frame` (the one drawing of an image, as one or several methods were scored on it), `frame_pictures`
  (what a method saw, lidar clusters, the frames that show a run), `film` (video, log), `calibration`;
- `sweep` (one setting through many values), `audit_tables`,
  `audit_pictures`;
- `proposal_scores` (proposals against annotations);
- `page` (the page of a run), `compare` (runs against each other), `leaderboard` (all runs of a folder).

Images are (H, W) grey or (H, W, 3) BGR uint8, pixels (u, v) with the centre of the first pixel at (0, 0). Pictures of
the ground are in the vehicle frame, x forward up and y left to the left.
"""
