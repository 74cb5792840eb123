"""The ego vehicle: how it drives, what its bus reports, and where its sensors are mounted.

`path` is the motion in the plane that the ego vehicle and the actors share. `motion` adds pitch, roll and heave of the
body, from its suspension and the roughness of the road. `bus` turns the path into wheel ticks and yaw rates. `ego` is
the body, the mounting of the sensors, and how far they are off their calibration.
"""
