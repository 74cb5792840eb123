"""All runs of a folder beside each other: tables, a chart of quality against cost, a page.

- `reading` (the runs in groups that compare, with their ceilings), `texts` (terminal, Markdown, CSV, JSON);
- `chart` (quality against cost), `pictures` (what every run makes of the same images), `page` (all of it on a page).
"""
