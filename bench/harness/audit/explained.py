"""One image explained: which cells are found, missed and falsely flagged, and why; to look at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.errors import UsageError
from bench.evaluation import Protocol
from bench.harness.audit.causes import FalseCause, MissCause, false_causes, miss_causes
from bench.harness.audit.cells import run_three_times
from bench.harness.audit.sources import AuditSource
from bench.harness.audit.staged import StagedTruth, at_centres
from bench.harness.audit.true_regions import instance_ids
from bench.harness.frames import FramePipeline
from bench.methods import Method
from bench.methods.spherical.method import SphericalMethod
from bench.recordings import read_truth
from bench.reference import Status


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExplainedImage:
    """An image and its cells.

    Attributes:
        pixels: (H, W) grey uint8.
        cell_size_px: side of a cell.
        hit: (rows, columns) bool, cells of evaluated objects that are found.
        missed: by cause, (rows, columns) bool.
        flagged: by cause, (rows, columns) bool.
    """

    pixels: NDArray[np.uint8]
    cell_size_px: int
    hit: NDArray[np.bool_]
    missed: dict[MissCause, NDArray[np.bool_]]
    flagged: dict[FalseCause, NDArray[np.bool_]]


def explain_image(
    source: AuditSource, *, camera: str, timestamp_ns: int, method: Method, protocol: Protocol
) -> ExplainedImage:
    """Explain one image of a recording, as the audit did.

    Raises:
        DataError: something of the recording cannot be read.
        UsageError: the recording has no scene to stage, or the method takes no flow from outside.
    """
    if not isinstance(method, SphericalMethod):
        raise UsageError(f"explain: expected the method 'spherical', got {method.name!r}")
    if source.exact is None or source.scenario is None or source.spec is None:
        raise UsageError(f"recording {source.recorded.name!r}: expected a scene that can be staged, got none")
    recording, exact_recording = source.recorded.open(), source.exact.open()
    by_contract: Method = method
    pipeline = FramePipeline(recording, camera, method=by_contract, protocol=protocol)
    index = [image.timestamp_ns for image in pipeline.images].index(timestamp_ns)
    valid = pipeline.references.valid
    staged = StagedTruth(
        source.scenario,
        source.spec,
        camera=exact_recording.cameras[camera],
        valid=valid,
        cell_size_px=method.cell_size_px,
    )
    given = pipeline.method_input(index)
    exact = staged.look(given, read_truth(pipeline.images[index], pipeline.camera))
    instance_of = instance_ids({track.track_id: track.instance_id for track in recording.tracks})
    objects = pipeline.references.build(pipeline.images[index]).objects
    moving = np.array([instance_of[o.track_id] for o in objects if o.status is not Status.STATIC], dtype=np.int64)
    evaluated = [instance_of[o.track_id] for o in objects if o.status is Status.EVALUATED]
    runs = run_three_times(method, given, exact, moving_ids=moving)
    shown = at_centres(valid, staged.cells)
    own = shown & np.isin(exact.flow.instance_ids, evaluated)
    missed, false = own & ~runs.recorded.mask, shown & ~runs.evidence.moving & runs.recorded.mask
    why_missed, why_false = miss_causes(runs.evidence), false_causes(runs.evidence, cell_size_px=method.cell_size_px)
    return ExplainedImage(
        pixels=given.images[-1],
        cell_size_px=method.cell_size_px,
        hit=own & runs.recorded.mask,
        missed={cause: missed & (why_missed == number) for number, cause in enumerate(MissCause)},
        flagged={cause: false & (why_false == number) for number, cause in enumerate(FalseCause)},
    )
