"""The Python interface, the same that the commands use; `import bench` offers it, and loads each part on first use.

`arrays`: `score` compares arrays and needs no recording. `datasets`: `open_dataset` gives recordings, and their images
with the reference. `runs`: `run` scores a method on a data set and stores the run; `load_run` reads a stored one.
`leaderboard`: which methods a leaderboard compares on a data set, and how each is scored. `sweep`: a run for
each value of a setting. `schemas`: JSON Schemas of files. `croissant`: a data set as catalogues describe it.
"""
