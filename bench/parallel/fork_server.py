"""What the fork server imports first: it does nothing but import, so it looks for no garbage, and ends at once."""

import atexit
import gc

gc.disable()
atexit.register(gc.freeze)  # or the end takes a quarter of a second of looking through all libraries
