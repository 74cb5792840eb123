"""Beyond the paper: a cell moves when no rigid scene explains what two images show of it.

The steps, each in a module and each a setting that can be switched off:

- `scene`: where a static point was in the previous image, for any depth, lens and motion;
- `first_guess`: dense flow that starts from the motion of road and horizon;
- `motion`: the recorded ego-motion, corrected by the images;
- `deviation`: how many standard deviations a flow vector lies from all rigid scenes;
- `evidence`: the same asked of grey values, for every static depth;
- `standing`: what stands on the road, and what would have to float above it;
- `own_effects`: shadow and light that move with the ego vehicle are no objects;
- `objects`: hysteresis, growth, outlines;
- `method`: all of it, on the last pair of images and on one further apart.

Symbols are those of `bench.methods.spherical`.
"""
