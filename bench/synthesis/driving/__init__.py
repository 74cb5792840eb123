"""The host: how it drives and sways, what its bus reports, and where its sensors sit.

`path` is the way in the plane that the host and the actors share. `motion` puts the body's sway on top of it, from
`suspension` and the road's `roughness`. `bus` is what wheel ticks and a yaw-rate sensor make of the way. `host` is the
body and the mounting of its sensors, `rig` how far they sit from where the recording says.
"""
