"""Annotations from a raw drive: moving objects are proposed from sweeps, ego-motion and calibration.

`propose` needs no labels and learns nothing: what other sweeps saw through has moved. `evaluate_proposals` compares
with annotations where there are some. How well it works, and where it fails, is told in docs/annotate.md.
"""
