"""What the Python interface has beside the commands; `import bench` offers it, and loads each part on first use.

`runs`: a stored run, and what is asked of a new one. `run_report`: the files beside a run's counts. `datasets`:
`open_dataset` gives recordings, and their images with the reference. `arrays`: `score` compares arrays and needs no
recording. `schemas`: JSON Schemas of files.
"""
