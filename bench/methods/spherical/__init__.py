"""The paper's method: deviations from what a static world allows, measured on the unit sphere.

Symbols, all in the current camera frame (with the corrections of the print that each function names):

- `R`, `t`: `current_from_previous`; `e' = t/|t|` is the previous camera centre seen from the current camera, the focus
  of contraction.
- `p`: unit ray in the previous camera frame; `q = R p`: the same ray rotated into the current frame. `q` stands
  wherever the printed equations say `p`.
- `p'`: unit ray of the same point in the current camera frame.
- `h`: unit vector down to the road; `eta_C`: camera height above it.

Every deviation is >= 0 and built from unit vectors, so it is close to an angle in radians.

Source:
    Mariotti and Eising, "Spherical formulation of geometric motion segmentation constraints in fisheye cameras".
"""
