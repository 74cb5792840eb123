"""Records that the packages above hand each other: `recording`, `reference`, `segmentation`."""
