"""Synthesis: a scenario file becomes a world, a world becomes rendered recordings in the native format.

Everything is drawn by rays against triangles: fisheye images through any camera model, lidar sweeps whose every column
of beams has its own time, instance masks, annotations and ego-motion, all from the same geometry, so that they agree to
float precision. The same scenario gives the same bytes in one process or in many, on every processor.

Time 0 of a scene is its first image, and the world is the vehicle frame of the ego vehicle at that time. Only the
command line and the harness call this package; it knows nothing of methods, references or scores.
"""

from bench.synthesis.production import read_scenario, synthesize
from bench.synthesis.scenario import Scenario

__all__ = ["Scenario", "read_scenario", "synthesize"]
