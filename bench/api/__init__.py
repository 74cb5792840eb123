"""The Python interface beside the commands; `import bench` gives its names, and loads each module on first use.

`runs`: a stored run, and what is asked of a new one. `run_report`: the files beside a run's counts. `datasets`:
`open_dataset` gives recordings, and their images with the reference. `arrays`: `score` compares arrays and needs no
recording. `schemas`: JSON Schemas of files.
"""
