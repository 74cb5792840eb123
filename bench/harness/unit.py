"""A unit of work: images of one camera, planned, and scored to rows of the two tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import pyarrow as pa

from bench.errors import BenchError, UsageError
from bench.evaluation import ImageMap, Protocol, SequenceScorer
from bench.harness.cache import StepCache
from bench.harness.frames import FramePipeline, UnscorableFrame
from bench.harness.masks import MASKS_SCHEMA, mask_row
from bench.harness.reference_files import RecordingReference
from bench.harness.stages import StageClock
from bench.methods import Scorable
from bench.recordings import ImageRef, Recording

CHUNK_IMAGES = 100  # bounds the rows that are held before they are written; many times the lag of the chance level


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """Images from `start` up to, not including, `stop` of a camera; the method may read images before `start`.

    Attributes:
        recording: name.
        camera: name.
        start: index of the first image to score.
        stop: index after the last.
    """

    recording: str
    camera: str
    start: int
    stop: int

    def __str__(self) -> str:
        return f"recording {self.recording!r}, camera {self.camera!r}, images {self.start} to {self.stop - 1}"

    @property
    def images(self) -> int:
        """Number of images to score."""
        return self.stop - self.start


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part of a run: every `count`-th unit, from the `number`-th on. A run in one piece is part 1 of 1.

    Attributes:
        number: from 1.
        count: of parts.

    Raises:
        UsageError: a number outside of 1 to `count`.
    """

    number: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise UsageError(f"--shard: expected I/N with I from 1 to N, got {self}")

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def of(self, units: Sequence[Unit], *, before: int = 0) -> list[Unit]:
        """Its own among units of a run.

        Args:
            units: in the order of the run.
            before: how many units of the run come before them.
        """
        return [unit for place, unit in enumerate(units, before) if place % self.count == self.number - 1]

    @classmethod
    def parse(cls, text: str) -> Part:
        """From "2/8".

        Raises:
            UsageError: anything else.
        """
        number, _, count = text.partition("/")
        if not (number.isascii() and number.isdecimal() and count.isascii() and count.isdecimal()):
            raise UsageError(f"--shard: expected I/N, for example 2/8, got {text!r}")
        return cls(number=int(number), count=int(count))


def first_scored(images: Sequence[ImageRef]) -> int:
    """Index of the first image of a camera that is to be scored; their number where none is."""
    return next((index for index, image in enumerate(images) if image.scored), len(images))


def plan_units(recording: Recording, method: Scorable, *, chunk_images: int = CHUNK_IMAGES) -> Iterator[Unit]:
    """Cut a recording into units; a camera's first images, without history or not to be scored, belong to none."""
    for camera in sorted(recording.cameras):
        images = len(recording.images[camera])
        first = first_scored(recording.images[camera])
        for start in range(max(method.history, first), images, chunk_images):
            yield Unit(recording=recording.name, camera=camera, start=start, stop=min(start + chunk_images, images))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnitTables:
    """Tables of what was counted in a unit.

    Attributes:
        objects: rows of `OBJECTS_SCHEMA`.
        frames: rows of `FRAMES_SCHEMA`, one per image of the unit.
        masks: rows of `MASKS_SCHEMA`, one per scored image.
        image_map: sums over its scored images; None without any.
        problems: one line per image that could not be used.
    """

    objects: pa.Table
    frames: pa.Table
    masks: pa.Table
    image_map: ImageMap | None
    problems: tuple[str, ...]


def run_unit(
    recording: Recording,
    unit: Unit,
    *,
    method: Scorable,
    protocols: Sequence[Protocol],
    clock: StageClock,
    steps: StepCache | None = None,
    exported: RecordingReference | None = None,
) -> list[UnitTables]:
    """Score the images of a unit. An image that cannot be used is reported; the others go on.

    Args:
        recording: of the unit.
        unit: which images.
        method: to be scored; asked once for each image.
        protocols: the rules, at least one.
        clock: adds up the time of each stage.
        steps: where steps of earlier runs are found; None to compute everything.
        exported: where references are read from; None to build them.

    Returns:
        What was counted by each of the protocols.
    """
    first, *further = protocols
    pipeline = FramePipeline(
        recording,
        unit.camera,
        method=method,
        protocol=first,
        further=further,
        clock=clock,
        steps=steps,
        exported=exported,
    )
    scorers = [SequenceScorer(protocol) for protocol in protocols]
    problems: list[str] = []
    masks: list[list[dict[str, object]]] = [[] for _ in protocols]

    def leave_out(index: int, status: Literal["failed", "skipped"], problem: str) -> None:
        for scorer in scorers:
            scorer.leave_out(
                recording=unit.recording,
                camera=unit.camera,
                timestamp_ns=pipeline.images[index].timestamp_ns,
                status=status,
                problem=problem,
            )

    for index in range(unit.start, unit.stop):
        try:
            frames = pipeline.process_for_protocols(index)
            exact = pipeline.exact_masks(index, [frame.reference for frame in frames])
        except UnscorableFrame as reason:
            leave_out(index, "skipped", str(reason))
        except BenchError as error:
            problem = str(error).replace(str(recording.root), recording.name)  # the same wherever the data lies
            problems.append(problem)
            leave_out(index, "failed", problem)
        else:
            for scorer, rows, frame, truth in zip(scorers, masks, frames, exact, strict=True):
                with clock.stage("counts"):
                    scorer.add(frame.reference, frame.segmentation, exact=truth)
                with clock.stage("store"):
                    rows.append(
                        mask_row(
                            frame.segmentation,
                            recording=unit.recording,
                            camera=unit.camera,
                            timestamp_ns=frame.image.timestamp_ns,
                        )
                    )
    return [_tables(scorer, rows, problems, clock) for scorer, rows in zip(scorers, masks, strict=True)]


def _tables(
    scorer: SequenceScorer, masks: list[dict[str, object]], problems: Sequence[str], clock: StageClock
) -> UnitTables:
    with clock.stage("counts"):
        objects, frames = scorer.finish()
    return UnitTables(
        objects=objects,
        frames=frames,
        masks=pa.Table.from_pylist(masks, schema=MASKS_SCHEMA),
        image_map=scorer.image_map(),
        problems=tuple(problems),
    )
