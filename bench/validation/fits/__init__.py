"""Fits: what lidar, cameras, odometry and boxes say of one world, as stated and as people confuse it."""
