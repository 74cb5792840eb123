"""Dense optical flow, its average on cells, and sparse tracks.

Flow is asked for **from the current image to the previous one**: the pixel x of the current image was at
`x + flow[x]` in the previous image. So whatever is computed from it belongs to the current image. Tracks likewise
start at corners of the current image and go back in time.
"""
