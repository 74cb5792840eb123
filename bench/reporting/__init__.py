"""Tables, pages and pictures of stored results; it prints nothing and scores nothing.

Tables and charts read only what a run has stored. The pictures of single frames take records that the harness fills. A
report is told once, in the blocks of `document`, for terminal, Markdown and pages (text from outside is escaped there),
and its numbers are a CSV. A figure is one of matplotlib on its own Agg canvas. The functions `write_*` store files;
equal input gives equal bytes.

- `document` (blocks, reports and their writers; `page.html.j2`, `page.css` and `page.js` make the one page of all),
  `formats` (how values and intervals are written everywhere), `figures` (colours, figures, the charts);
- `run_tables` (a run in tables and lines, and a sweep), `run_page` (its page, with the worst cases);
- `compare` (runs against each other), `leaderboard` (all runs of a folder), `verdict` (of the gate);
- `findings` (what is wrong with data, predictions and proposals), `audit` (its tables);
- `frame` (the one drawing of an image, as one or several methods were scored on it; panels, clusters),
  `frame_pictures` (what is drawn of drives and runs: pictures, video, log, calibration).

Images are (H, W) grey or (H, W, 3) BGR uint8, pixels (u, v) with the centre of the first pixel at (0, 0). Pictures of
the ground are in the vehicle frame, x forward up and y left to the left.
"""
