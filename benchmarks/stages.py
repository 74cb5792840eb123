"""Time of each stage of an image, and of the whole against its flow alone; of the reference by protocol; one thread."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from time import thread_time

from bench.evaluation.protocol import Protocol, load_protocol
from bench.evaluation.scorer import SequenceScorer
from bench.execution import single_threaded
from bench.flow.dense import DenseFlow
from bench.harness.frames import FramePipeline, UnscorableFrame
from bench.methods import Scorable
from bench.recordings import Recording
from bench.reference.build import ReferenceBuilder

STAGES = ("input", "reference", "method", "counts")  # files and ego-motion; regions; answer; pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class PerfReport:
    """Times of one run, in one process with one thread per library, by the processor's clock of that thread.

    The first image of all is not timed: what a process does once, such as the tables of a lens, is no image's cost.

    Attributes:
        images: timed images.
        stage_ms: mean time of each stage per image, ms.
        total_ms: mean time of an image from file to counts, ms.
        flow_ms: mean time of a call of the flow alone on the same pairs of images, taken in between, ms.
    """

    images: int
    stage_ms: dict[str, float]
    total_ms: float
    flow_ms: float

    @property
    def ratio(self) -> float:
        """Whole over flow alone."""
        return self.total_ms / self.flow_ms


def measure(
    recordings: Iterator[Recording],
    *,
    method: Scorable,
    protocol: Protocol,
    images: int,
    flow: DenseFlow,
) -> PerfReport:
    """Time up to `images` images of recordings, each followed by a call of the flow alone on the same pair.

    One more image is worked on before them; see `PerfReport`.

    Args:
        recordings: opened one after the other; of each the first camera counts.
        method: to be timed.
        protocol: the rules of the reference.
        images: at most so many.
        flow: to compare with.
    """
    spent_s, done, total_s, flow_s = dict.fromkeys(STAGES, 0.0), 0, 0.0, 0.0
    warm = False
    with single_threaded():
        for recording in recordings:
            camera = sorted(recording.cameras)[0]
            pipeline = FramePipeline(recording, camera, method=method, protocol=protocol)
            scorer = SequenceScorer(protocol)
            for index in range(method.history, len(pipeline.images)):
                if done >= images:
                    break
                times_s = [thread_time()]
                try:
                    given = pipeline.method_input(index)
                    times_s.append(thread_time())
                    reference = pipeline.reference(index)
                    times_s.append(thread_time())
                    answer = pipeline.ask(index, given, partial(pipeline.reference, index))
                except UnscorableFrame:
                    continue
                times_s.append(thread_time())
                scorer.add(reference, answer)
                times_s.append(thread_time())
                flow(given.images[-1], given.images[-2])
                end_s = thread_time()
                if not warm:
                    warm = True
                    continue
                for name, (begin, finish) in zip(STAGES, pairwise(times_s), strict=True):
                    spent_s[name] += finish - begin
                total_s, flow_s, done = total_s + times_s[-1] - times_s[0], flow_s + end_s - times_s[-1], done + 1
            scorer.finish()
    return PerfReport(
        images=done,
        stage_ms={name: 1e3 * seconds / done for name, seconds in spent_s.items()},
        total_ms=1e3 * total_s / done,
        flow_ms=1e3 * flow_s / done,
    )


def reference_ms(recordings: Iterable[Recording], protocols: Sequence[str]) -> dict[str, float]:
    """Mean time of the reference of an image of each recording's first camera, by protocol, image by image in turns.

    A sweep is read once by each protocol. The first image of each recording is not timed.
    """
    spent, images = dict.fromkeys(protocols, 0.0), 0
    settings = {name: load_protocol(name).reference for name in protocols}
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
