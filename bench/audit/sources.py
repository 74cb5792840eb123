"""Recordings to audit, with their exact masks and, where a scenario rendered them, exact flow; the same work for each.

Every audit opens each recording once, does its own work on it, and stores what it found beside the same provenance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from time import perf_counter
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from bench.cameras import RayGrid, ray_grid
from bench.errors import DataError, UsageError
from bench.execution import FailedTask, TaskExecutor
from bench.harness import provenance as origin
from bench.harness.digests import digest_of, digest_recording
from bench.harness.manifest import CodeOfRun
from bench.harness.provenance import Provenance
from bench.harness.stages import Progress, StageClock, add_up
from bench.methods import FlowMethod, MethodInput
from bench.recordings import DatasetCard, MountedCamera, Recording, RecordingHandle, open_dataset
from bench.reference import IgnoreReason, ReferenceFrame, ReferenceObject, Status
from bench.synthesis import Scenario, read_scenario
from bench.synthesis.exact_flow import ExactFlow, ExactFlowCaster
from bench.synthesis.scenario import RecordingSpec
from bench.synthesis.scene import build_scene

Found = TypeVar("Found")
EXACT = {"calibration": "exact"}
NO_SCENARIO = "the data set's card names no scenario, so there is no exact flow"


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditSource:
    """One recording; it travels to other processes.

    Attributes:
        recorded: as the benchmark reads it.
        exact: the same with the true calibration; None without a scene.
        scenario: that the recording was rendered from; None where the card names none.
        spec: the recording in the scenario; None where it is not there.
    """

    recorded: RecordingHandle
    exact: RecordingHandle | None = None
    scenario: Scenario | None = None
    spec: RecordingSpec | None = None


def audit_sources(card: DatasetCard, *, split: str | None, recordings: int | None) -> tuple[AuditSource, ...]:
    """The recordings of an audit.

    Args:
        card: the data set.
        split: of it; None for all.
        recordings: how many, spread evenly over the split so that a few still show every kind of drive; None for all.

    Raises:
        DataError: the data set or its scenario cannot be read.
        UsageError: fewer than one recording asked for.
    """
    handles = _spread(open_dataset(card, split), recordings)
    if card.scenario is None:
        return tuple(AuditSource(recorded=handle) for handle in handles)
    scenario = read_scenario(card.scenario)
    specs = {spec.name: spec for spec in scenario.recordings}
    options = {**card.content.options, **EXACT}
    exact_card = replace(card, content=card.content.model_copy(update={"options": options}))
    exact = {handle.name: handle for handle in open_dataset(exact_card, split)}
    return tuple(
        AuditSource(recorded=handle, exact=exact[handle.name], scenario=scenario, spec=specs.get(handle.name))
        for handle in handles
    )


def _spread(handles: tuple[RecordingHandle, ...], expected: int | None) -> tuple[RecordingHandle, ...]:
    if expected is None or expected >= len(handles):
        return handles
    if expected < 1:
        raise UsageError(f"--recordings: expected at least 1, got {expected}")
    return tuple(handles[k * len(handles) // expected] for k in range(expected))


@dataclass(slots=True, kw_only=True, eq=False)
class OpenedSource:
    """A recording that is audited.

    Attributes:
        source: where it is from.
        recording: as the benchmark reads it.
        instance_of: instance id by track, -1 (which no pixel has) for a track that truth images do not know.
        images: that were used; counted by the work.
        problems: one line per image that could not be used; added by the work.
        clock: adds up the time of each stage.
    """

    source: AuditSource
    recording: Recording
    instance_of: Mapping[str, int]
    images: int = 0
    problems: list[str] = field(default_factory=list)
    clock: StageClock


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Done(Generic[Found]):
    """The result of the work on a recording, and what every audit says of it; see `OpenedSource`."""

    found: Found
    digest: str
    images: int
    problems: list[str]
    clock: StageClock


class Part(BaseModel):
    """A part of what an audit stores."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class StoredAudit(Part):
    """The part that every audit stores.

    Attributes:
        schema_version: of the file.
        dataset: name of the data set.
        card: its file, as it was named.
        split: of it; None for all.
        recordings: that were used.
        images: that were used.
        failures: one line per recording or image that could not be used.
        data: digest of the recordings' data.
        code: of this package, and its libraries.
        provenance: how the audit came about.
    """

    schema_version: int = 1
    dataset: str
    card: str
    split: str | None
    recordings: int
    images: int
    failures: tuple[str, ...]
    data: str
    code: CodeOfRun
    provenance: Provenance


def audit_each(
    work: Callable[[OpenedSource], Found],
    *,
    card: DatasetCard,
    split: str | None,
    recordings: int | None,
    executor: TaskExecutor,
    progress: Progress | None,
) -> tuple[list[Found], StoredAudit]:
    """Do the same with every recording.

    Args:
        work: a function of a module, or a partial of one; its `DataError` is the failure of the recording.
        card: the data set, rendered.
        split: of it; None for all.
        recordings: how many of them; None for all.
        executor: does the work; the result does not depend on it.
        progress: called with the recordings done and their number.

    Returns:
        found: of the recordings that could be used, in the order of the data set.
        stored: what every audit stores.

    Raises:
        DataError: none could be used; the first one's own error, which says what to do, where there is one.
    """
    start_s = perf_counter()
    sources = audit_sources(card, split=split, recordings=recordings)
    outcomes: dict[str, _Done[Found] | DataError | FailedTask] = {}
    with executor, closing(executor.compute(partial(_done, work=work), sources)) as results:
        for source, outcome in results:
            outcomes[source.recorded.name] = outcome
            if progress is not None:
                progress(len(outcomes), len(sources))
    ordered = {source.recorded.name: outcomes[source.recorded.name] for source in sources}
    done = [outcome for outcome in ordered.values() if isinstance(outcome, _Done)]
    failures = [
        f"recording {name!r}: {outcome.reason if isinstance(outcome, FailedTask) else outcome}"
        for name, outcome in ordered.items()
        if isinstance(outcome, FailedTask | DataError)
    ]
    if not done:
        lost = DataError(card.file, expected="a recording that can be audited", got="; ".join(failures) or "none")
        raise next((outcome for outcome in ordered.values() if isinstance(outcome, DataError)), lost)
    images, seconds = sum(one.images for one in done), add_up(one.clock.seconds for one in done)
    return [one.found for one in done], StoredAudit(
        dataset=card.name,
        card=str(card.file),
        split=split,
        recordings=len(done),
        images=images,
        failures=(*failures, *(problem for one in done for problem in one.problems)),
        data=digest_of(sorted(one.digest for one in done)),
        code=CodeOfRun.here(),
        provenance=origin.provenance_since(start_s, stage_seconds=seconds, images=images),
    )


def _done(source: AuditSource, *, work: Callable[[OpenedSource], Found]) -> _Done[Found] | DataError:
    """Return the result of the work, or the user's mistake that prevents it; a bug is raised."""
    clock = StageClock()
    try:
        with clock.stage("open"):
            recording = source.recorded.open()
            refuse_without_masks(recording)
            digest = digest_recording(recording).whole
        tracks = {track.track_id: track.instance_id for track in recording.tracks}
        opened = OpenedSource(source=source, recording=recording, instance_of=instance_ids(tracks), clock=clock)
        return _Done(found=work(opened), digest=digest, images=opened.images, problems=opened.problems, clock=clock)
    except DataError as error:
        return error


def refuse_without_masks(recording: Recording) -> None:
    """Refuse what was recorded, not rendered.

    Raises:
        DataError: no image has an exact mask.
    """
    if not any(image.truth_path for images in recording.images.values() for image in images):
        raise DataError(
            recording.root,
            expected="rendered masks (truth/<camera>/<timestamp_ns>.png), against which an audit compares",
            got="a recording without",
            hint="audit a rendered data set, for example demo",
        )


LARGEST_DISAGREEMENT = 0.02  # of the cells that show an object, over a recording


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExactPair:
    """Exact flow, motion and road of a pair of images.

    Attributes:
        given: the method's input with the true lens, ego-motion and road.
        cells: on which the method takes flow.
        flow: on these cells.
        below_horizon: (rows, columns) bool; the rays to both places of the point go below the horizon.
    """

    given: MethodInput
    cells: RayGrid
    flow: ExactFlow
    below_horizon: NDArray[np.bool_]


class SimulatedTruth:
    """The exact flow and motion of one camera's images.

    Args:
        source: of a recording that is in the scenario.
        camera: with its true calibration.
        valid: (H, W) bool, the region V.
        method: on whose cells, of the grid `cells`, flow is taken.
    """

    def __init__(
        self, source: AuditSource, camera: MountedCamera, *, valid: NDArray[np.bool_], method: FlowMethod
    ) -> None:
        scenario, spec = source.scenario, source.spec
        assert scenario is not None, "the recording can be simulated"
        assert spec is not None, "the recording can be simulated"
        self._camera, self._name = camera, spec.name
        cell_size_px = method.flow_cell_px(valid.shape[1])
        self.cells = ray_grid(camera.model, cell_size_px)
        self._shown = self.cells.at_centres(valid)
        self._caster = ExactFlowCaster(build_scene(scenario, spec), camera, valid=valid, cell_size_px=cell_size_px)
        self._object_cells, self._differing_cells = 0, 0

    def look(self, given: MethodInput, ids: NDArray[np.uint16]) -> ExactPair:
        """Return what is exactly known of the last pair of images, and the motion between all of them.

        Args:
            given: the method's input as recorded.
            ids: (H, W) uint16, the true instance ids of the current image, which the scene has to show again.
        """
        previous_ns, current_ns = given.timestamps_ns[-2:]
        flow = self._caster.flow(current_ns=current_ns, previous_ns=previous_ns)
        self._compare(flow, ids)
        exact = replace(
            given,
            camera=self._camera.model,
            road=self._caster.road(current_ns),
            current_from_previous=tuple(
                self._caster.motion(current_ns=later_ns, previous_ns=earlier_ns)
                for earlier_ns, later_ns in pairwise(given.timestamps_ns)
            ),
        )
        return ExactPair(given=exact, cells=self.cells, flow=flow, below_horizon=self._below_horizon(exact, flow))

    def check(self) -> None:
        """Refuse a scene that is not the one that was rendered.

        Raises:
            DataError: objects are not where the truth images show them.
        """
        if self._differing_cells > LARGEST_DISAGREEMENT * self._object_cells:
            share = self._differing_cells / self._object_cells
            raise DataError(
                self._name,
                expected="a scenario that describes the scene as it was rendered",
                got=f"one that shows other objects in {100 * share:.0f} % of their cells",
                hint="render the data set again",
            )

    def _compare(self, flow: ExactFlow, ids: NDArray[np.uint16]) -> None:
        steps = (0,) if self.cells.cell_size_px % 2 else (0, 1)  # an even cell's centre lies between four pixels
        padded, (height, width) = np.pad(ids, ((0, 1), (0, 1)), mode="edge"), ids.shape
        about = [self.cells.at_centres(padded[v : v + height, u : u + width]) for v in steps for u in steps]
        objects = self._shown & ((about[0] > 0) | (flow.instance_ids > 0))
        differing = objects & np.all([rendered != flow.instance_ids for rendered in about], axis=0)
        self._object_cells += int(np.count_nonzero(objects))
        self._differing_cells += int(np.count_nonzero(differing))

    def _below_horizon(self, exact: MethodInput, flow: ExactFlow) -> NDArray[np.bool_]:
        rays, _ = exact.camera.unproject((self.cells.pixels + flow.flow).reshape(-1, 2))
        rotated = exact.current_from_previous[-1].rotate(rays).reshape(self.cells.rays_camera.shape)
        with np.errstate(invalid="ignore"):
            return (rotated @ exact.road.down > 0) & (self.cells.rays_camera @ exact.road.down > 0)


def instance_ids(tracks: Mapping[str, int | None]) -> dict[str, int]:
    """Instance id by track, -1 (which no pixel has) for a track that truth images do not know."""
    return {track: -1 if number is None else number for track, number in tracks.items()}


def same_objects(
    by_lidar: Sequence[ReferenceFrame], ids: NDArray[np.uint16], instance_of: Mapping[str, int]
) -> tuple[ReferenceFrame, ...]:
    """References of one image that differ in their regions alone; the exact masks make the last one.

    An object is evaluated in all of them or in none. Ignored are those that a lidar reference does not evaluate, and
    those of which the camera sees no pixel, which a mask cannot score (as occluded). Category and reason of every other
    object are the first lidar reference's.

    Args:
        by_lidar: at least one, of the same annotations.
        ids: (H, W) uint16, the image's true instance ids.
        instance_of: instance id by track.

    Returns:
        The lidar references, and the one whose regions G and I are the exact masks in V.
    """
    first = by_lidar[0]
    shown = ids.astype(np.int32)
    masks = {item.track_id: (shown == instance_of[item.track_id]) & first.valid for item in first.objects}
    evaluated = {track_id for track_id, mask in masks.items() if mask.any()}
    for reference in by_lidar:
        evaluated &= {item.track_id for item in reference.objects if item.status is Status.EVALUATED}
    same = [_evaluating(reference, evaluated) for reference in by_lidar]
    labels, ignored = np.zeros_like(first.labels), np.zeros_like(first.ignored)
    objects: list[ReferenceObject] = []
    for number, item in enumerate(same[0].objects, start=1):
        mask = masks[item.track_id]
        if item.status is Status.EVALUATED:
            labels[mask] = number
            item = replace(item, region_px=int(np.count_nonzero(mask)), unknown_px=0)
        elif item.status is Status.IGNORED:
            ignored |= mask
        objects.append(item)
    unknown = np.zeros_like(ignored)
    return (*same, replace(first, objects=tuple(objects), labels=labels, ignored=ignored, unknown=unknown))


def _evaluating(reference: ReferenceFrame, evaluated: Set[str]) -> ReferenceFrame:
    """The reference with its other evaluated objects ignored, their regions among the ignored ones."""
    others = [
        number
        for number, item in enumerate(reference.objects, start=1)
        if item.status is Status.EVALUATED and item.track_id not in evaluated
    ]
    if not others:
        return reference
    labels, ignored, objects = reference.labels.copy(), reference.ignored.copy(), list(reference.objects)
    for number in others:
        objects[number - 1] = replace(
            objects[number - 1], status=Status.IGNORED, reason=IgnoreReason.OCCLUDED, region_px=0, unknown_px=0
        )
        ignored |= labels == number
        labels[labels == number] = 0
    return replace(reference, objects=tuple(objects), labels=labels, ignored=ignored)
