"""Cost of the reference by each protocol, image by image in turns."""

from collections.abc import Iterable, Sequence
from time import thread_time

from bench.evaluation import load_protocol
from bench.recordings import Recording
from bench.reference import ReferenceBuilder
from bench.threads import single_threaded


def milliseconds(recordings: Iterable[Recording], protocols: Sequence[str]) -> dict[str, float]:
    """Mean time of an image of each recording's first camera; a sweep is read once by each protocol.

    The first image of each recording is not timed.
    """
    spent, images = dict.fromkeys(protocols, 0.0), 0
    settings = {name: load_protocol(name).reference_settings() for name in protocols}
    with single_threaded():
        for recording in recordings:
            camera = sorted(recording.cameras)[0]
            builders = {name: ReferenceBuilder(recording, camera, settings[name]) for name in protocols}
            for number, image in enumerate(recording.images[camera]):
                for name in (protocols, protocols[::-1])[number % 2]:
                    start = thread_time()
                    builders[name].build(image)
                    spent[name] += (thread_time() - start) * bool(number)
                images += bool(number)
    return {name: 1e3 * seconds / images for name, seconds in spent.items()}
