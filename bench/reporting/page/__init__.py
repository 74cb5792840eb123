"""The page of a run: one `index.html` that opens from disk, with every picture and its own small script inside.

`build.write_page` is the entry point. It reads the stored results of a run, asks the other files here for the blocks of
the page (`tables`, `summary`, `worst`), and fills the template (escaped by default) with `page.css` and `page.js`. Only
`worst` goes back to the data set, for pictures; without the data the page is complete but for them.
"""
