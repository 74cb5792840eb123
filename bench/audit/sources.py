"""What is audited: recordings with their exact masks and, where a scenario rendered them, exact flow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.cameras import ray_grid
from bench.errors import DataError, UsageError
from bench.methods import MethodInput
from bench.recordings import DatasetCard, MountedCamera, RecordingHandle, open_dataset
from bench.reference import IgnoreReason, ReferenceFrame, ReferenceObject, Status
from bench.synthesis import Scenario, read_scenario
from bench.synthesis.exact_flow import ExactFlow, ExactFlowCaster
from bench.synthesis.scenario import RecordingSpec
from bench.synthesis.scene import build_scene

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
    exact = {handle.name: handle for handle in open_dataset(_exact_card(card), split)}
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


def _exact_card(card: DatasetCard) -> DatasetCard:
    options = {**card.content.options, **EXACT}
    return replace(card, content=card.content.model_copy(update={"options": options}))


LARGEST_DISAGREEMENT = 0.02  # of the cells that show an object, over a recording


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExactPair:
    """What is exactly known of a pair of images.

    Attributes:
        given: the method's input with the true lens, ego-motion and road.
        flow: on the method's cells.
        below_horizon: (rows, columns) bool; the rays to both places of the point go below the horizon.
    """

    given: MethodInput
    flow: ExactFlow
    below_horizon: NDArray[np.bool_]


class SimulatedTruth:
    """The exact flow and motion of one camera's images.

    Args:
        scenario: that the recording was rendered from.
        spec: the recording.
        camera: with its true calibration.
        valid: (H, W) bool, the region V.
        cell_size_px: side of the method's cells, whose grid is `cells`.
    """

    def __init__(
        self,
        scenario: Scenario,
        spec: RecordingSpec,
        *,
        camera: MountedCamera,
        valid: NDArray[np.bool_],
        cell_size_px: int,
    ) -> None:
        self._camera, self._name = camera, spec.name
        self.cells = ray_grid(camera.model, cell_size_px)
        self._shown = self.cells.at_centres(valid)
        self._caster = ExactFlowCaster(build_scene(scenario, spec), camera, valid=valid, cell_size_px=cell_size_px)
        self._object_cells, self._differing_cells = 0, 0

    def look(self, given: MethodInput, ids: NDArray[np.uint16]) -> ExactPair:
        """What is exactly known of the last pair of images.

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
            current_from_previous=(
                *given.current_from_previous[:-1],
                self._caster.motion(current_ns=current_ns, previous_ns=previous_ns),
            ),
        )
        return ExactPair(given=exact, flow=flow, below_horizon=self._below_horizon(exact, flow))

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
                do="render the data set again",
            )

    def _compare(self, flow: ExactFlow, ids: NDArray[np.uint16]) -> None:
        rendered = self.cells.at_centres(ids)
        objects = self._shown & ((rendered > 0) | (flow.instance_ids > 0))
        self._object_cells += int(np.count_nonzero(objects))
        self._differing_cells += int(np.count_nonzero(objects & (rendered != flow.instance_ids)))

    def _below_horizon(self, exact: MethodInput, flow: ExactFlow) -> NDArray[np.bool_]:
        rays, _ = exact.camera.unproject((self.cells.pixels + flow.flow).reshape(-1, 2))
        rotated = exact.current_from_previous[-1].rotate(rays).reshape(self.cells.rays_camera.shape)
        with np.errstate(invalid="ignore"):
            return (rotated @ exact.road.down > 0) & (self.cells.rays_camera @ exact.road.down > 0)


def instance_ids(tracks: Mapping[str, int | None]) -> dict[str, int]:
    """Instance id by track, -1 (which no pixel has) for a track that truth images do not know."""
    return {track: -1 if number is None else number for track, number in tracks.items()}


def paired_references(
    lidar: ReferenceFrame, ids: NDArray[np.uint16], instance_of: Mapping[str, int]
) -> tuple[ReferenceFrame, ReferenceFrame]:
    """Two references that differ in their regions alone.

    Status, reason and category of every object are the lidar's. An object of which the camera sees no pixel cannot be
    scored by a mask: it is ignored as occluded in both, so that both are over the same object-frames.

    Args:
        lidar: the reference of the protocol.
        ids: (H, W) uint16, the image's true instance ids.
        instance_of: instance id by track.

    Returns:
        The lidar's reference, and the one whose regions G and I are the exact masks in V.
    """
    shown = ids.astype(np.int32)
    masks = [(shown == instance_of[item.track_id]) & lidar.valid for item in lidar.objects]
    unseen = [
        item.status is Status.EVALUATED and not mask.any() for item, mask in zip(lidar.objects, masks, strict=True)
    ]
    by_lidar = _with_ignored(lidar, unseen)
    labels, ignored = np.zeros_like(lidar.labels), np.zeros_like(lidar.ignored)
    objects: list[ReferenceObject] = []
    for number, (item, mask) in enumerate(zip(by_lidar.objects, masks, strict=True), start=1):
        if item.status is Status.EVALUATED:
            labels[mask] = number
            item = replace(item, region_px=int(np.count_nonzero(mask)), unknown_px=0)
        elif item.status is Status.IGNORED:
            ignored |= mask
        objects.append(item)
    return by_lidar, replace(lidar, objects=tuple(objects), labels=labels, ignored=ignored)


def _with_ignored(reference: ReferenceFrame, which: list[bool]) -> ReferenceFrame:
    """The reference with some of its evaluated objects ignored, their regions among the ignored ones."""
    if not any(which):
        return reference
    labels, ignored = reference.labels.copy(), reference.ignored.copy()
    objects = list(reference.objects)
    for index in np.flatnonzero(which).tolist():
        objects[index] = replace(
            objects[index], status=Status.IGNORED, reason=IgnoreReason.OCCLUDED, region_px=0, unknown_px=0
        )
        ignored |= labels == index + 1
        labels[labels == index + 1] = 0
    return replace(reference, objects=tuple(objects), labels=labels, ignored=ignored)
