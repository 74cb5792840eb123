"""Least squares of a camera's calibration and clock on flow seen at static lidar returns, and on edges.

Rotation, focal length, centre of the image, position and clock leave different residual fields. Each has a prior: the
wide one where it is taken for the cause, the narrow one, what a good calibration leaves, where it is not. What the
ego-motion does not know (bias of its yaw rate, scale of its speed, springs of the body) is fitted along: flow cannot
tell a camera that looks aside from a car that slips, edges can.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.egomotion.trajectory import Trajectory
from bench.recordings import MountedCamera
from bench.times import SECOND_NS
from bench.validation.fits.flow import FARTHEST_PX, SECTORS, SeenFlow
from bench.validation.fits.readings import DEGREE
from bench.validation.fits.scan_matching import MeasuredMotion

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """Numbers of the calibration that are wrong together, or what the ego-motion does not know.

    Attributes:
        numbers: how many.
        narrow: standard deviation where it is right: what a calibration at the end of the line leaves.
        wide: standard deviation where it is wrong.
        step: of the numeric derivative, about a pixel.
        starts: values of each number at which a fit begins; none for what is never the cause.
        smallest: that is told.
        gain: by how much it must raise the logarithm of the posterior to be told.
        measured: as `narrow`, where the lidar measures the motion.
    """

    numbers: int = 1
    narrow: float
    wide: float = 0.0
    step: float
    starts: tuple[float, ...] = ()
    smallest: float = np.inf
    gain: float = 8.0
    measured: float | None = None


def _either_way(*sizes: float) -> tuple[float, ...]:
    return (*(-size for size in sizes), *sizes)


UNKNOWNS = {
    # rad, camera axes; the flow cannot tell less from springs of the body and slip of the tyres
    "rotation": Unknown(numbers=3, narrow=0.15 * DEGREE, wide=5.0 * DEGREE, step=0.005, smallest=0.6 * DEGREE,
                        starts=_either_way(*(size * DEGREE for size in (1.0, 2.0, 3.5, 5.0)))),
    # logarithm of the scale
    "focal": Unknown(narrow=0.003, wide=0.2, step=0.005, smallest=0.012, starts=_either_way(0.05, 0.1, 0.2)),
    # px, right and down
    "centre": Unknown(numbers=2, narrow=0.5, wide=20.0, step=1.0, smallest=5.0, starts=_either_way(5.0, 10.0, 20.0)),
    # m, vehicle axes; clean slow drives were fitted by up to 16 cm, one at night by 26 cm at a gain of 14
    "position": Unknown(numbers=3, narrow=0.02, wide=0.3, step=0.02, smallest=0.2, gain=20.0,
                        starts=_either_way(0.15, 0.3, 0.5)),
    # s, that the stated times are early
    "clock": Unknown(narrow=0.001, wide=0.1, step=0.004, smallest=0.004, starts=_either_way(0.02, 0.05, 0.1)),
    # What the ego-motion gets wrong, the same in the whole drive; never the cause here.
    "yaw bias": Unknown(narrow=0.2 * DEGREE, measured=0.05 * DEGREE, step=0.01),  # rad/s
    "speed scale": Unknown(narrow=0.01, measured=0.003, step=0.01),
    "direction": Unknown(numbers=2, narrow=0.3 * DEGREE, measured=0.08 * DEGREE, step=0.01),  # rad, left and up
}  # fmt: skip
CAUSES = tuple(name for name, unknown in UNKNOWNS.items() if unknown.starts)
_FIRST = np.cumsum([0, *(unknown.numbers for unknown in UNKNOWNS.values())])
SLICES = {name: slice(int(a), int(b)) for name, a, b in zip(UNKNOWNS, _FIRST[:-1], _FIRST[1:], strict=True)}
STEPS = np.concatenate([np.full(unknown.numbers, unknown.step) for unknown in UNKNOWNS.values()])
# Of each pair: rotation about the vehicle's axes, rad/s; speed to the front, to the left and up, parts of the speed.
# Braking from 30 km/h lets a nose dive by 1 degree in half a second; bumps are slower.
PAIR_SIGMAS = np.array([1.5 * DEGREE, 1.5 * DEGREE, 0.2 * DEGREE, 0.01, 0.005, 0.015])
PAIR_STEPS = np.array([0.05, 0.05, 0.05, 0.01, 0.01, 0.01])
POINTS = 250  # of each pair
LEAST_POINTS, LEAST_PAIRS = 40, 6
MOST_STEPS, LEAST_FALL = 25, 0.1  # of the fit, and of its cost in a step
AGREES_PX, AGREES = 0.4, 0.15  # residual of flow as predicted, px or part of its length
LEAST_SEEN = 0.3  # of the points: on fewer a fit says nothing
SCALE_PX = (0.15, 1.0)  # of the residual, for Cauchy's weights
TOGETHER = 10.0  # points whose flow errs alike: DIS smooths over patches, and lidar returns lie close
EDGE_CELL_PX, EDGES = 32.0, 5  # of each cell of an image: many in one place are one thing, and likely a fence
EDGE_PX = 1.0  # of an edge's residual, for Cauchy's weights
EDGES_TOGETHER = 5.0  # beams that meet one edge


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """A calibration that fits the flow.

    Attributes:
        values: (14,) float64, as `UNKNOWNS`: true minus stated.
        sigmas: (14,) float64, standard deviations.
        pair_errors: (pairs, 6) float64, as `PAIR_SIGMAS`.
        losses: (N,) float64, of each point, minus the logarithm of its likelihood; where its flow is not seen, that of
            the fit that this one is compared with.
        cost: their sum and that of the edges' losses, minus the logarithm of the prior of values and errors.
        share: of the points whose flow is as predicted.
        residual_px: median length of the residual.
        scale_px: of the residual, for Cauchy's weights.
    """

    values: Floats
    sigmas: Floats
    pair_errors: Floats
    losses: Floats
    cost: float
    share: float
    residual_px: float
    scale_px: float


class CameraFit:
    """A camera's seen flow and edges, and their residuals for any calibration.

    Args:
        flows: of pairs of images.
        trajectory: ego-motion.
        camera: as stated.
        measured: what the lidar says of the ego-motion.
    """

    def __init__(
        self, flows: Sequence[SeenFlow], trajectory: Trajectory, camera: MountedCamera, measured: MeasuredMotion
    ) -> None:
        self._flows, self._trajectory = flows, trajectory
        self._model, self._stated = camera.model, camera.vehicle_from_camera
        self._times_ns = np.array([[f.current_ns, f.previous_ns] for f in flows], dtype=np.int64)
        self._seconds = np.diff(self._times_ns[:, ::-1], axis=1)[:, 0] / SECOND_NS
        middle_ns = self._times_ns.sum(axis=1) // 2
        self._measured = bool(measured.at(middle_ns).all())
        if self._measured:
            self._errors, self._error_sigmas = measured.between(middle_ns)
        else:
            self._error_sigmas = np.tile(PAIR_SIGMAS, (len(flows), 1))
            self._errors = np.zeros_like(self._error_sigmas)
        self._points = np.concatenate([flow.points_world for flow in flows])
        self._pair = np.repeat(np.arange(len(flows)), [len(flow.points_world) for flow in flows])
        self._edges = np.concatenate([flow.edges_world for flow in flows], axis=1)
        self._edge_image = np.repeat(np.arange(len(flows)), [flow.edges_world.shape[1] for flow in flows])
        self._select_edges()
        self.points = self._select()

    def residuals(self, values: Floats, pair_errors: Floats | None = None) -> tuple[Floats, Floats]:
        """Seen minus predicted place in the previous image, and seen flow, of all points; NaN where not seen.

        Args:
            values: (14,) float64, as `Fit`.
            pair_errors: (pairs, 6) float64, as `PAIR_SIGMAS`.

        Returns:
            residual, flow: (N, 2) float64, px.
        """
        errors = self._errors if pair_errors is None else pair_errors
        rotations, positions_m = self._poses(values)
        now, before = rotations[:, 0], rotations[:, 1]
        back = before.transpose(0, 2, 1) @ now
        path_m = np.einsum("nji,nj->ni", before, positions_m[:, 0] - positions_m[:, 1])
        turn = errors[:, :3] * self._seconds[:, None]
        turn[:, 2] += float(values[SLICES["yaw bias"]][0]) * self._seconds
        back = Rotation.from_rotvec(turn).as_matrix() @ back
        length_m, (left, up) = np.linalg.norm(path_m, axis=1), values[SLICES["direction"]]
        path_m = path_m * (1.0 + values[SLICES["speed scale"]] + errors[:, 3:4])
        path_m[:, 1] += length_m * (left + errors[:, 4])
        path_m[:, 2] += length_m * (up + errors[:, 5])

        pair = self._pair
        vehicle_now = np.einsum("nji,nj->ni", now[pair], self._points - positions_m[pair, 0])
        vehicle_before = np.einsum("nij,nj->ni", back[pair], vehicle_now) + path_m[pair]
        seen = self._pixels(vehicle_now, values)
        flow = np.full_like(seen, np.nan)
        for i, one in enumerate(self._flows):
            rows = slice(*np.searchsorted(pair, [i, i + 1]))
            if rows.start == rows.stop:
                continue
            u, v = seen[rows].astype(np.float32).T
            flow[rows] = cv2.remap(
                one.flow, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan, np.nan)
            ).reshape(-1, 2)
        return seen + flow - self._pixels(vehicle_before, values), flow

    def edge_residuals(self, values: Floats) -> tuple[Floats, Floats]:
        """Distance from the lidar's edges to those of the image, across them.

        Args:
            values: (14,) float64, as `Fit`.

        Returns:
            residual: (M,) float64, px; NaN where the image has no edge near. across: (M, 2) float64, unit vectors.
        """
        image, (pixels, ends) = self._edge_image, self.edge_pixels(values)
        along = ends - pixels
        across = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
        sector = np.round(np.arctan2(across[:, 1], across[:, 0]) / np.pi * SECTORS)
        nearest = np.round(pixels)
        inside = self._model.contains(nearest) & np.isfinite(across).all(axis=1)
        residual = np.full(len(pixels), np.nan)
        for i, flow in enumerate(self._flows):
            rows = np.flatnonzero(inside & (image == i))
            u, v = nearest[rows].astype(int).T
            offset = flow.edge_offsets[sector[rows].astype(int) % SECTORS, v, u]
            away = ((nearest[rows] + offset - pixels[rows]) * across[rows]).sum(axis=1)
            near = np.linalg.norm(offset.astype(float), axis=1) < FARTHEST_PX
            residual[rows] = np.where(near, away, np.nan)
        return residual, across

    def edge_pixels(self, values: Floats) -> Floats:
        """Pixels at which the lidar's edges and their ends are predicted, (2, M, 2) float64; `values` as in `Fit`."""
        rotations, positions_m = self._poses(values)
        image = self._edge_image
        vehicle = np.einsum("nji,knj->kni", rotations[image, 0], self._edges - positions_m[image, 0])
        return self._pixels(vehicle.reshape(-1, 3), values).reshape(2, -1, 2)

    def _poses(self, values: Floats) -> tuple[Floats, Floats]:
        """Of the vehicle at both images of each pair: rotations (pairs, 2, 3, 3), positions (pairs, 2, 3), m."""
        clock_ns = round(float(values[SLICES["clock"]][0]) * SECOND_NS)
        rotations, positions_m, _ = self._trajectory.at((self._times_ns + clock_ns).ravel())
        return rotations.reshape(-1, 2, 3, 3), positions_m.reshape(-1, 2, 3)

    def fit(self, causes: Collection[str], *, beside: Fit | None = None) -> Fit | None:
        """Gauss-Newton with Cauchy's weights, as long as its steps, or half or a quarter of them, lead downhill.

        Args:
            causes: of `UNKNOWNS`, those that may be wrong.
            beside: a fit of fewer causes to begin with; by how much the cost falls from there is what the causes
                explain.

        Returns:
            None where too little is seen.
        """
        if not self.points:
            return None
        sigmas = np.concatenate([
            np.full(unknown.numbers, self._sigma(unknown, name in causes)) for name, unknown in UNKNOWNS.items()
        ])  # fmt: skip
        if beside is None:
            best = self._at(np.zeros(len(STEPS)), self._errors, sigmas, None)
        else:
            best = min(self._starts(causes, sigmas, beside), key=lambda one: one.cost)
        for _ in range(MOST_STEPS):
            change, pair_change, deviations = self._step(best, sigmas)
            best = replace(best, sigmas=deviations)
            shorter = (
                self._at(best.values + part * change, best.pair_errors + part * pair_change, sigmas, best)
                for part in (1.0, 0.5, 0.25)
            )
            step = next((one for one in shorter if one.cost < best.cost - LEAST_FALL), None)
            if step is None:
                break
            best = replace(step, sigmas=deviations)
        return best

    def _sigma(self, unknown: Unknown, wrong: bool) -> float:
        """Standard deviation of numbers that may be wrong, or may not."""
        if wrong:
            return unknown.wide
        return unknown.measured if self._measured and unknown.measured is not None else unknown.narrow

    def share(self) -> float:
        """Share of the points whose flow is as predicted, without any fit."""
        return self._seen_share(*self.residuals(np.zeros(len(STEPS))))

    def _starts(self, causes: Collection[str], sigmas: Floats, beside: Fit) -> Iterator[Fit]:
        """The fit beside, and others with one number of a cause changed: flow is not smooth over many pixels."""
        yield self._at(beside.values, beside.pair_errors, sigmas, beside)
        for cause in causes:
            for index, value in product(range(UNKNOWNS[cause].numbers), UNKNOWNS[cause].starts):
                values = beside.values.copy()
                values[SLICES[cause].start + index] += value
                yield self._at(values, beside.pair_errors, sigmas, beside)

    def _at(self, values: Floats, errors: Floats, sigmas: Floats, beside: Fit | None) -> Fit:
        residual, flow = self.residuals(values, errors)
        lengths = np.linalg.norm(residual, axis=1)
        seen = np.isfinite(lengths)
        median_px = float(np.median(lengths[seen])) if seen.any() else np.inf
        scale_px = float(np.clip(median_px, *SCALE_PX)) if beside is None else beside.scale_px
        losses = np.log1p((lengths / scale_px) ** 2) / TOGETHER
        losses = np.where(seen, losses, np.mean(losses, where=seen) if beside is None else beside.losses)
        off = (errors - self._errors) / self._error_sigmas
        prior = 0.5 * float(((values / sigmas) ** 2).sum() + (off**2).sum())
        edges, _ = self.edge_residuals(values)
        edge_losses = np.log1p((np.nan_to_num(edges, nan=FARTHEST_PX) / EDGE_PX) ** 2) / EDGES_TOGETHER
        return Fit(
            values=values,
            sigmas=sigmas,
            pair_errors=errors,
            losses=losses,
            cost=float(losses.sum() + edge_losses.sum()) + prior if seen.mean() > LEAST_SEEN else np.inf,
            share=self._seen_share(residual, flow),
            residual_px=median_px,
            scale_px=scale_px,
        )

    @staticmethod
    def _seen_share(residual: Floats, flow: Floats) -> float:
        lengths = np.linalg.norm(residual, axis=1)
        seen = np.isfinite(lengths)
        if seen.mean() < LEAST_SEEN:
            return 0.0
        return float(np.mean(lengths[seen] < np.maximum(AGREES_PX, AGREES * np.linalg.norm(flow[seen], axis=1))))

    def _pixels(self, points_vehicle: Floats, values: Floats) -> Floats:
        turned = self._stated.rotation @ Rotation.from_rotvec(values[SLICES["rotation"]]).as_matrix()
        points_camera = (points_vehicle - self._stated.translation_m - values[SLICES["position"]]) @ turned
        centre = np.array(self._model.principal_point)
        pixels, _ = self._model.project(points_camera)
        return np.asarray((pixels - centre) * np.exp(values[SLICES["focal"]]) + centre + values[SLICES["centre"]])

    def _select(self) -> int:
        """Take some of the points that are seen, and return their number; 0 for too few."""
        residual, _ = self.residuals(np.zeros(len(STEPS)))
        seen = np.isfinite(residual).all(axis=1)
        rows = [np.flatnonzero(seen & (self._pair == i))[:POINTS] for i in range(len(self._flows))]
        rows = [few for few in rows if len(few) >= LEAST_POINTS]
        if len(rows) < LEAST_PAIRS:
            return 0
        chosen = np.concatenate(rows)
        self._points, self._pair = self._points[chosen], self._pair[chosen]
        return len(chosen)

    def _select_edges(self) -> None:
        """Take some of the edges in each part of each image."""
        pixels, _ = self.edge_pixels(np.zeros(len(STEPS)))
        order = np.random.default_rng(0).permutation(np.flatnonzero(np.isfinite(pixels).all(axis=1)))
        cells = np.column_stack([self._edge_image[order], np.floor(pixels[order] / EDGE_CELL_PX)])
        _, cell = np.unique(cells, axis=0, return_inverse=True)
        by_cell = np.argsort(cell, kind="stable")
        place_in_cell = np.arange(len(order)) - np.searchsorted(cell[by_cell], cell[by_cell])
        chosen = np.sort(order[by_cell[place_in_cell < EDGES]])
        self._edges, self._edge_image = self._edges[:, chosen], self._edge_image[chosen]

    def _slopes(self, values: Floats, errors: Floats) -> tuple[Floats, Floats, Floats]:
        """Residual (N, 2), and its slopes by values (N, 2, 14) and by the errors of each point's pair (N, 2, 6)."""
        base, _ = self.residuals(values, errors)
        by_values = [(self.residuals(values + step, errors)[0] - base) / step.sum() for step in np.diag(STEPS)]
        by_errors = [(self.residuals(values, errors + step)[0] - base) / step.sum() for step in np.diag(PAIR_STEPS)]
        slopes, pair_slopes = np.stack(by_values, axis=-1), np.stack(by_errors, axis=-1)
        lost = ~(np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(pair_slopes).all(axis=(1, 2)))
        base = base.copy()
        base[lost], slopes[lost], pair_slopes[lost] = 0.0, 0.0, 0.0
        return base, slopes, pair_slopes

    def _edge_slopes(self, values: Floats) -> tuple[Floats, Floats]:
        """Residuals of the edges that an image has near, (M,), and their slopes by values, (M, 14)."""
        (residual, across), (pixels, _) = self.edge_residuals(values), self.edge_pixels(values)
        moved = [(self.edge_pixels(values + step)[0] - pixels) / step.sum() for step in np.diag(STEPS)]
        slopes = -(np.stack(moved, axis=-1) * across[:, :, None]).sum(axis=1)
        near = np.isfinite(residual) & np.isfinite(slopes).all(axis=1)
        return residual[near], slopes[near]

    def _step(self, at: Fit, sigmas: Floats) -> tuple[Floats, Floats, Floats]:
        """Solve the normal equations: changes of values and of the errors of pairs, and deviations of the values."""
        residual, slopes, pair_slopes = self._slopes(at.values, at.pair_errors)
        weights = 1.0 / (1.0 + (np.linalg.norm(residual, axis=1) / at.scale_px) ** 2) / (at.scale_px**2 * TOGETHER)
        # One column for each value, then six for each pair, which are 0 for the points of the others.
        pairs, numbers = len(self._flows), len(sigmas)
        of_pairs = np.zeros((len(residual), 2, pairs, len(PAIR_SIGMAS)))
        of_pairs[np.arange(len(residual)), :, self._pair] = pair_slopes
        design = np.concatenate([slopes, of_pairs.reshape(len(residual), 2, -1)], axis=2).reshape(2 * len(residual), -1)
        weighted = np.repeat(weights, 2)[:, None] * design
        precision = np.concatenate([sigmas, self._error_sigmas.ravel()]) ** -2.0
        information = weighted.T @ design + np.diag(precision)
        off = np.concatenate([at.values, (at.pair_errors - self._errors).ravel()])
        gradient = weighted.T @ residual.ravel() + precision * off
        edges, edge_slopes = self._edge_slopes(at.values)
        edge_weights = 1.0 / (1.0 + (edges / EDGE_PX) ** 2) / (EDGE_PX**2 * EDGES_TOGETHER)
        information[:numbers, :numbers] += edge_slopes.T @ (edge_weights[:, None] * edge_slopes)
        gradient[:numbers] += edge_slopes.T @ (edge_weights * edges)
        covariance = np.linalg.inv(information)
        change = -covariance @ gradient
        deviations = np.sqrt(np.diag(covariance))[:numbers]
        return change[:numbers], change[numbers:].reshape(pairs, -1), deviations
