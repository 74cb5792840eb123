"""Beyond the paper: a cell moves when no rigid scene explains what two images show of it.

The steps, each in a module and each a setting that can be switched off:

- `scene`: where a static point was in the previous image, for any depth, lens and motion; flow that starts from there;
- `motion`: the recorded ego-motion, corrected by the images;
- `evidence`: how many standard deviations a flow vector lies from all rigid scenes, and what grey values say of it;
- `candidates`: hysteresis, growth, what stands on the road or would have to float above it; shadow and light that move
  with the ego vehicle are no objects;
- `outlines`: where objects end, by their own motion;
- `method`: all of it, on the last pair of images and on one further apart.

Symbols are those of `bench.methods.spherical`.
"""
