"""Notes each process that imports it, and its threads, in the folder that the environment names."""

import os
from pathlib import Path

FOLDER = "LOADED"

if FOLDER in os.environ:
    with (Path(os.environ[FOLDER]) / "loaded").open("a") as file:
        file.write(f"{os.getpid()}\n")
    with (Path(os.environ[FOLDER]) / "threads").open("a") as file:
        file.writelines(sorted((thread / "comm").read_text() for thread in Path("/proc/self/task").glob("*")))
