"""A small network for moving-object segmentation, trained on rendered drives (`bench.training`).

- `inputs`: images and what geometry knows of them, as channels of bytes;
- `method`: the network on ONNX Runtime (extra `learned`), from channels to scores of cells.
"""
