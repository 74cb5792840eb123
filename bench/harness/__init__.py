"""The harness: three stages that meet in files.

The **answers** of a method (`answers`), the **references** of the data (`references`) and the **counts** of answers
against references by a protocol (`counts`) are files, one for each task: a recording's camera, in chunks of images. A
file that is there is done, whoever wrote it. `run` plans the tasks, has an executor take the images of each through the
stages and reduces the counts to a summary; `stored` reads it again. What a run is of is its `manifest`. A task or
image that fails is reported and the rest goes on. The harness hands a method images, calibration and ego-motion, never
annotations (`frames`).
"""
