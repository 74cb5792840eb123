"""Masks and scores that some other program has made, read from disk and paired with images by name.

```
DIR/[recording/]camera/<name>.png     mask: 8 bits, 0 and 255 or 0 and 1; see below for 16 bits
DIR/[recording/]camera/<name>.npz     score: an array `score` of floats in [0, 1]
DIR/[recording/]camera.json           masks: a list of {"image": name, "segmentation": COCO run lengths or null}
DIR/recording.json                    the same, with "camera" in every entry
DIR/predictions.yaml                  `sixteen_bits: score` where PNG of 16 bits hold scores, 0 to 65535 for 0 to 1;
                                      `first_frame: 0` or `1` where names count images
```

The recording's folder may be left out where the data set has only one. `<name>` is the image's time in nanoseconds,
its frame number, or the name of its file without the suffix; which of them is found out for each camera, and ambiguous
names are refused. A frame number is the number that names the image's file, else its index among all images of its
camera in the data set, from `first_frame`, excluded ones included. That is 0 where nobody says so; names without a 0
that may count from 1 are refused.

`pairing` goes through the folder once and finds everything that is wrong before anything is scored; `method` then
returns what was found, as any other segmentation method. `images` lists what is to be predicted and which image a name
means; `files` reads each kind of file and brings maps of other sizes to the image.
"""

from bench.methods.predictions.files import Fault, FaultKind
from bench.methods.predictions.images import NAMINGS, Naming
from bench.methods.predictions.method import MISSING_POLICIES, MissingPolicy, PredictedMotion
from bench.methods.predictions.pairing import PredictionIndex, index_predictions

__all__ = [
    "MISSING_POLICIES",
    "NAMINGS",
    "Fault",
    "FaultKind",
    "MissingPolicy",
    "Naming",
    "PredictedMotion",
    "PredictionIndex",
    "index_predictions",
]
