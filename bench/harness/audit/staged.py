"""A recording's scene set up again, for the exact flow and the exact ego-motion of its images."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bench.cameras import RayGrid, ray_grid
from bench.errors import DataError
from bench.methods import MethodInput
from bench.recordings import MountedCamera
from bench.synthesis import Scenario
from bench.synthesis.exact_flow import ExactFlow, ExactFlowCaster
from bench.synthesis.scenario import RecordingSpec
from bench.synthesis.stage import set_stage

Scalar = TypeVar("Scalar", bound=np.generic)
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


class StagedTruth:
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
        self._shown = at_centres(valid, self.cells)
        self._caster = ExactFlowCaster(set_stage(scenario, spec), camera, valid=valid, cell_size_px=cell_size_px)
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
                expected="a scenario that stages the scene as it was rendered",
                got=f"one that shows other objects in {100 * share:.0f} % of their cells",
                do="render the data set again",
            )

    def _compare(self, flow: ExactFlow, ids: NDArray[np.uint16]) -> None:
        rendered = at_centres(ids, self.cells)
        objects = self._shown & ((rendered > 0) | (flow.instance_ids > 0))
        self._object_cells += int(np.count_nonzero(objects))
        self._differing_cells += int(np.count_nonzero(objects & (rendered != flow.instance_ids)))

    def _below_horizon(self, exact: MethodInput, flow: ExactFlow) -> NDArray[np.bool_]:
        rays, _ = exact.camera.unproject((self.cells.pixels + flow.flow).reshape(-1, 2))
        turned = exact.current_from_previous[-1].rotate(rays).reshape(self.cells.rays_camera.shape)
        with np.errstate(invalid="ignore"):
            return (turned @ exact.road.down > 0) & (self.cells.rays_camera @ exact.road.down > 0)


def at_centres(image: NDArray[Scalar], cells: RayGrid) -> NDArray[Scalar]:
    """An image's values at the centres of cells: (H, W) -> (rows, columns)."""
    height, width = image.shape
    rows = np.minimum(cells.pixels[:, 0, 1].astype(np.intp), height - 1)
    columns = np.minimum(cells.pixels[0, :, 0].astype(np.intp), width - 1)
    return image[np.ix_(rows, columns)]
