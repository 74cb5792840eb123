"""A method that does not report its setting."""

import numpy as np

from bench.methods import Method, Segmentation, UnansweredImage


class Forgetful(Method):
    """Calls moving what is brighter than a level; has no answer below level 0."""

    name = "forgetful"

    def __init__(self, *, level=100):
        self._level = level

    def settings(self):
        return {}

    def segment(self, frame):
        if self._level < 0:
            raise UnansweredImage("it is too dark")
        found = {"mask": frame.images[-1] > self._level}
        return Segmentation(cell_size_px=1, mask=np.asarray(found["mask"]))
