"""Lidar sweeps: the beams of a revolution, what they meet, which pulses come back, and the files."""
