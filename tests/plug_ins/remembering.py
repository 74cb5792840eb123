"""A method that remembers what it saw, so that the order in which images come decides its answers."""

import numpy as np

from bench.methods import Method, Segmentation


class Remembering(Method):
    """Calls moving what differs from the mean of the images that it has seen."""

    name = "remembering"

    def __init__(self):
        self._background = None

    def segment(self, frame):
        image = frame.images[-1].astype(np.float32)
        before = image if self._background is None else self._background
        self._background = 0.7 * before + 0.3 * image
        return Segmentation(cell_size_px=1, mask=np.abs(image - self._background) > 4)
