"""Camera models: rays of the camera frame to pixels and back.

Every model takes rays of any length and any direction, also beyond 90 degrees, and returns a `valid` mask of where
its mapping holds. The limit is the first angle at which the mapping stops being one-to-one, found from the
calibration when the camera is built, or the lens's own `max_angle_rad` where that is smaller.

Pixels are (u, v) with the centre of the first pixel at (0, 0); camera frame x right, y down, z forward.
"""
