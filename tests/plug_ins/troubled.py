"""A method that gets into trouble on a recording, when a file in a folder says so.

The folder is named by the environment, so that a result does not depend on it: `<folder>/<recording>.<trouble>`.
"""

import os
import signal
import time
from pathlib import Path

import numpy as np

from bench.methods import Method, Segmentation

FOLDER = "TROUBLE"


class Troubled(Method):
    """Calls moving what has become brighter."""

    name = "troubled"

    def segment(self, frame):
        folder = Path(os.environ[FOLDER])
        for name, trouble in TROUBLES.items():
            if (file := folder / f"{frame.recording}.{name}").exists():
                trouble(file)
        return Segmentation(cell_size_px=1, mask=frame.images[-1] > frame.images[-2])


def note(file):
    with file.with_name(f"{file.name}-noted").open("a") as noted:
        noted.write(f"{os.getpid()}\n")


def wait(file):
    """Stay in the middle of a unit until the file is gone."""
    note(file)
    while file.exists():
        time.sleep(0.02)


def kill_once(file):
    file.unlink()
    note(file)
    os.kill(os.getpid(), signal.SIGKILL)


def abort(file):
    note(file)
    os.abort()


def want_memory(_):
    np.ones(1 << 55)


TROUBLES = {"wait": wait, "kill_once": kill_once, "abort": abort, "want_memory": want_memory}
