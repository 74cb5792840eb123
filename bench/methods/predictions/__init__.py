"""Masks and scores that some other program has made, read from disk and paired with images by name.

```
DIR/[recording/]camera/<name>.png     grey: a mask of 8 bits, 0 and 255 or 0 and 1; or a score of 16 bits
DIR/predictions.yaml                  `sixteen_bits: score` where the files hold scores, 0 to 65535 for 0 to 1
```

`<name>` is the name of the image's file without the suffix, or the image's time in nanoseconds. The recording's folder
may be left out where the data set has only one.

`pairing` goes through the folder once and finds everything that is wrong before anything is scored; `method` then
returns what was found, as any other segmentation method. `maps` reads a file and brings it to the image's size.
"""

from bench.methods.predictions.method import PredictedMotion
from bench.methods.predictions.pairing import FaultKind, PredictionIndex

__all__ = ["FaultKind", "PredictedMotion", "PredictionIndex"]
