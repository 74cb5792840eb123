"""The Python interface, the same that the commands use; `import bench` offers it, and loads each part on first use.

Most commands are a function in the module of their name: `annotate`, `audit`, `bundle`, `compare`, `evaluate`, `gate`,
`history`, `leaderboard`, `report`, `sweep`, `validate`, `verify`, `view`. It takes what the command's options say, as
objects, computes, writes what is asked for, and returns a record of what was found; nothing is printed. `runs`: `run`
scores a method on a data set and stores the run; `load_run` reads a stored one. `run_report`: the files beside a run's
counts. `datasets`: `open_dataset` gives recordings, and their images with the reference. `references`: the reference as
files. `arrays`: `score` compares arrays and needs no recording. `schemas`: JSON Schemas of files.
"""
