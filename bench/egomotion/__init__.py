"""Ego-motion: from the vehicle's bus or a pose file to `world_from_vehicle` at any time; or from images, without scale.

A `Trajectory` is a sequence of poses. Between them the vehicle moves with constant twist; across gaps and beyond the
ends no pose is valid.
"""
