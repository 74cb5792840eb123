"""Lidar sweeps: the record, the point-cloud files and the compensation of the sensor's own motion (de-skew).

A sweep is one revolution. Its points are given in the lidar frame as it was at each point's own time. Nothing here
knows of vehicles: the caller of `deskew` passes the poses (`bench.egomotion` has them).
"""
