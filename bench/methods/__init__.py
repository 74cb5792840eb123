"""Segmentation methods: their contract, their registry, and the paper's own.

A method is given consecutive images, calibration and ego-motion, never annotations, and segments the **current**
(last) image into moving and static cells. Installed packages add methods through the entry point group
`fisheye_bench.methods`.
"""

from bench.methods.contract import (
    FlowMethod,
    Method,
    MethodInput,
    Scorable,
    UnansweredImage,
    ask_method,
)
from bench.methods.registry import METHODS, build_method, describe_method, known_methods
from bench.records.segmentation import Segmentation

__all__ = [
    "METHODS",
    "FlowMethod",
    "Method",
    "MethodInput",
    "Scorable",
    "Segmentation",
    "UnansweredImage",
    "ask_method",
    "build_method",
    "describe_method",
    "known_methods",
]
