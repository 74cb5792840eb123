"""Training data for networks, and the training of the method `learned`.

- `pairs`: pairs of images with lens, motion, exact mask and valid region as NumPy arrays; inputs of the network,
  computed once and stored on disk;
- `appearance`: images as worse cameras would have taken them;
- `network`, `train`: the network and its training on PyTorch (extra `train`).
"""

from bench.training.pairs import training_pairs

__all__ = ["training_pairs"]
