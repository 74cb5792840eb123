"""Notes each process that imports it, in the folder that the environment names."""

import os
from pathlib import Path

FOLDER = "LOADED"

if FOLDER in os.environ:
    with (Path(os.environ[FOLDER]) / "loaded").open("a") as file:
        file.write(f"{os.getpid()}\n")
