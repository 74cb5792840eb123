"""Two views of methods: flow on cells, where each cell's content was before, and the times of rows.

With a rolling shutter, the time between two rows changes the geometry of two views.

Row tau' of the current image and row tau of the previous one are T + tau' - tau apart, not T: by the share
x = (tau' - tau) / T more of the camera's motion lies between them. At constant twist the motion between the rows is
R^(1+x), along a path of 1 + x times the length whose direction is rotated by R^(x/2), in the camera frame at the later
row. Both rays are rotated half of the way, so that R, the direction of t and the equations of two views stay as they
are:

    p~ = R^(x/2) p      p~' = R^(-x/2) p'      t~ = (1 + x) t

It is exact for a planar motion, rotation about the road's normal, but for the difference between an arc and its chord.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.cameras.model import CameraModel, RayGrid, RollingShutter
from bench.flow.dense import flow_on_cells
from bench.geometry import Bools, Floats, RigidTransform
from bench.methods.contract import MethodInput


def cell_flow(
    frame: MethodInput, flow: str, parameters: Mapping[str, object], cell_size_px: int
) -> NDArray[np.float32]:
    """Flow from the current to the previous image, which methods share.

    Args:
        frame: of the current image.
        flow: name of the dense flow, see `bench.flow.DENSE_FLOWS`.
        parameters: what the flow takes.
        cell_size_px: side of the cells.

    Returns:
        (rows, columns, 2) float32, px, mean over each cell.
    """
    now, before = frame.images[-1], frame.images[-2]
    return flow_on_cells(now, before, flow=flow, parameters=parameters, cell_size_px=cell_size_px)


def flow_rays(frame: MethodInput, cells: RayGrid, flow: NDArray[np.float32]) -> tuple[Floats, Bools]:
    """Rays of each cell's content in the previous image.

    Args:
        frame: of the current image.
        cells: of the current image.
        flow: (rows, columns, 2) float32, px, from the current to the previous image.

    Returns:
        rays_previous: (rows, columns, 3) float64, unit rays, previous camera frame; NaN where the lens has none.
        seen: (rows, columns) bool; inside the lens's field and the image, both times, and valid in the current one.
    """
    pixels = (cells.pixels + flow).reshape(-1, 2)
    rays, valid = frame.camera.unproject(pixels)
    seen = (valid & frame.camera.contains(pixels)).reshape(cells.valid.shape) & cells.valid
    return rays.reshape(cells.rays_camera.shape), seen & cells.at_centres(frame.valid)


def flow_parts(flow: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """Flow, (rows, columns, 2), as the two parts that pictures look for."""
    return {"flow_u": flow[..., 0], "flow_v": flow[..., 1]}


@dataclass(frozen=True, slots=True, kw_only=True)
class RowTimes:
    """Times at which the rows of a pair of images were exposed.

    Attributes:
        shutter: of the camera.
        seconds: between the two images.
    """

    shutter: RollingShutter
    seconds: float

    @classmethod
    def of(cls, frame: MethodInput, *, back: int = 1) -> RowTimes | None:
        """Those of the current image and the one `back` before it; None where all rows are exposed at once."""
        if frame.rolling_shutter is None:
            return None
        seconds = (frame.timestamps_ns[-1] - frame.timestamps_ns[-1 - back]) / 1e9
        return cls(shutter=frame.rolling_shutter, seconds=seconds)

    def extra_motion(
        self, pixels: NDArray[np.floating], pixels_previous: NDArray[np.floating], camera: CameraModel
    ) -> Floats:
        """x above, (...) float64, for pixels (..., 2) of the current and the previous image; NaN is the middle row."""
        later_s, earlier_s = (self.shutter.row_time_offset_s(seen, camera) for seen in (pixels, pixels_previous))
        return (later_s - earlier_s) / self.seconds


def extra_motion(
    frame: MethodInput, pixels: NDArray[np.floating], pixels_previous: NDArray[np.floating]
) -> Floats | None:
    """x of the last two images, see `RowTimes.extra_motion`; None where all rows are exposed at once."""
    row_times = RowTimes.of(frame)
    return None if row_times is None else row_times.extra_motion(pixels, pixels_previous, frame.camera)


def rotated_halfway(
    rays_previous: Floats, rays_current: Floats, *, current_from_previous: RigidTransform, extra_motion: Floats
) -> tuple[Floats, Floats]:
    """p~ and p~' above, (..., 3) each.

    Args:
        rays_previous: (..., 3) float64, unit rays p.
        rays_current: (..., 3) float64, unit rays p'.
        current_from_previous: motion between the images.
        extra_motion: (...) float64, x.
    """
    half = _part_of(current_from_previous, extra_motion / 2)
    return np.einsum("...ij,...j", half, rays_previous), np.einsum("...ji,...j", half, rays_current)


def seen_before(
    rays_current: Floats,
    inverse_depth: NDArray[np.floating],
    *,
    current_from_previous: RigidTransform,
    extra_motion: Floats,
) -> Floats:
    """Points along p of static content at an inverse depth along p', previous camera frame.

    From p~' / rho = R p~ s + t~, for some s: p is along R^-1 R^(-x/2) (R^(-x/2) p' - rho (1 + x) t).

    Args:
        rays_current: (N, 3) float64, unit rays p'.
        inverse_depth: (N,), rho, 1/m.
        current_from_previous: motion between the images.
        extra_motion: (N,) float64, x.

    Returns:
        (N, 3) float64, any length.
    """
    back = _part_of(current_from_previous, -extra_motion / 2)
    parallax = (inverse_depth * (1.0 + extra_motion))[:, None] * current_from_previous.translation_m
    half = np.einsum("nij,nj->ni", back, rays_current) - parallax
    return np.asarray(np.einsum("nij,nj->ni", back, half) @ current_from_previous.rotation)


def _part_of(motion: RigidTransform, share: Floats) -> Floats:
    """R to the power of each share, (..., 3, 3)."""
    turns_rad = share.reshape(-1, 1) * Rotation.from_matrix(motion.rotation).as_rotvec()
    return Rotation.from_rotvec(turns_rad).as_matrix().reshape(*share.shape, 3, 3)
