"""Look at a camera's calibration: lidar, road, lens and ego-motion drawn onto an image, without any method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.atomic import write_bytes
from bench.cameras import ray_grid
from bench.harness.stages import Progress
from bench.recordings import read_image
from bench.records.recording import MountedCamera, Recording
from bench.reporting import canvas
from bench.reporting.film import rerun_log
from bench.reporting.formats import file_name, image_name
from bench.reporting.frame import FARTHEST_M, NEAREST_M, SeenSweep, SweepViewer, draw_points
from bench.validation.fits.flow import SeenFlow, reduced, seen_flow

GRID_M, GRID_STEP_M, LINE_STEP_M = 10.0, 1.0, 0.05  # reach of the grid, between its lines, between points of a line
HORIZON_POINTS = 1441
ARROWS_ACROSS, ARROW_PX = 32, 16.0  # arrows are drawn as many times as long as makes half of them longer than this
_WIDTH_IN, _TOP_IN, _FOOT_IN, _GAP_IN = 4.2, 0.2, 0.2, 0.08
_FADE = 0.55
_PREDICTED, _SEEN = canvas.VERMILION, canvas.SKY_BLUE


def write_calibration(
    recording: Recording,
    chosen: Mapping[str, Sequence[int]],
    *,
    out: Path,
    rrd: Path | None,
    progress: Progress,
) -> list[Path]:
    """Write `<recording>-<camera>/<index>-<image>/calibration.png` of images, and log them for the viewer.

    Args:
        recording: the drive.
        chosen: indices of images by camera.
        out: folder of the pictures.
        rrd: the file for the viewer; None for none.
        progress: called with the pictures done and their number.

    Returns:
        The files.

    Raises:
        DataError: an image or its sweep cannot be read.
        OutputError: a file cannot be written.
    """
    tasks = [(name, index) for name, indices in chosen.items() for index in indices]
    tasks.sort(key=lambda task: recording.images[task[0]][task[1]].timestamp_ns)
    sweeps = {name: SweepViewer(recording, recording.cameras[name]) for name in chosen}
    files = []
    with ExitStack() as stack:
        log = None if rrd is None else stack.enter_context(rerun_log(rrd, recording=recording, cameras=list(chosen)))
        for number, (name, index) in enumerate(tasks, start=1):
            image = recording.images[name][index]
            figure = draw_calibration(recording, name, index, sweeps[name])
            if log is not None:
                log.add(image, canvas.figure_pixels(figure), sweeps[name].see(image))
            folder = out / f"{file_name(recording.name)}-{file_name(name)}"
            files.append(folder / f"{index:06d}-{file_name(image.path.stem)}" / "calibration.png")
            write_bytes(files[-1], canvas.figure_bytes(figure, "png"))
            progress(number, len(tasks))
    return [*files, *([] if rrd is None else [rrd])]


@canvas.styled
def draw_calibration(recording: Recording, camera_name: str, index: int, sweeps: SweepViewer) -> Figure:
    """Draw four panels of an image.

    Lidar points by range where they were when the image was exposed, and as they were measured; the flow of static
    points that lidar and ego-motion predict beside the flow seen; horizon, a grid on the road, the lens's field of view
    and the mask of the vehicle's own body.

    Args:
        recording: the drive; it needs no annotations.
        camera_name: one of its cameras.
        index: of the image.
        sweeps: of the camera.

    Raises:
        DataError: the image or its sweep cannot be read.
    """
    camera, image = recording.cameras[camera_name], recording.images[camera_name][index]
    grey = canvas.faded(read_image(image, camera), _FADE)
    height_in = _WIDTH_IN * grey.shape[0] / grey.shape[1]
    full_in = 2 * (height_in + _TOP_IN) + _FOOT_IN
    figure = canvas.new_figure(2 * _WIDTH_IN + 3 * _GAP_IN, full_in)
    axes = []
    for row in (0, 1):
        for column in (0, 1):
            left_in = _GAP_IN + column * (_WIDTH_IN + _GAP_IN)
            bottom_in = full_in - _TOP_IN - height_in - row * (height_in + _TOP_IN)
            panel = canvas.axes_at(figure, left_in, bottom_in, _WIDTH_IN, height_in)
            canvas.show_image(panel, grey)
            axes.append(panel)
    _draw_points(axes[0], "(a) lidar at the exposure, by range", sweeps.see(image))
    as_measured = sweeps.see(image, compensated=False)
    _draw_points(axes[1], "(b) lidar as measured, without motion compensation", as_measured)
    _draw_flow(axes[2], recording, camera, index)
    _draw_geometry(axes[3], camera)
    name = image_name(recording.name, camera_name, image.timestamp_ns)
    figure.text(0.5, 0.06 / full_in, f"{name}; points from {NEAREST_M:g} m, yellow, to {FARTHEST_M:g} m, dark",
                ha="center", va="bottom", fontsize=6.5)  # fmt: skip
    return figure


def _draw_points(axes: Axes, title: str, seen: SeenSweep | None) -> None:
    some = seen is not None and len(seen.pixels) > 0
    axes.set_title(title if some else f"{title}: no points within 100 ms", pad=3)
    if seen is not None:
        draw_points(axes, seen, size=0.35)


def _draw_flow(axes: Axes, recording: Recording, camera: MountedCamera, index: int) -> None:
    """Arrows to where a static point is from where it was in the image before, as predicted and as seen."""
    flow = seen_flow(recording, reduced(camera), index) if index else None
    arrows = None if flow is None else _arrows(recording, camera, flow)
    if arrows is None:
        told = ": too little motion or texture"
    elif not len(arrows[0]):
        told = ": none where there is flow"
    else:
        current, predicted, seen = arrows
        told = f"; they differ by {np.median(np.linalg.norm(predicted - seen, axis=1)):.1f} px"
        times = max(1, round(ARROW_PX / max(float(np.median(np.linalg.norm(seen - current, axis=1))), 0.1)))
        for ends, colour, width in ((predicted, _PREDICTED, 0.9), (seen, _SEEN, 0.5)):
            axes.quiver(
                *(current - times * (current - ends)).T, *times * (current - ends).T, color=colour, angles="xy",
                scale_units="xy", scale=1.0, width=width / 72 / _WIDTH_IN, headwidth=4, headlength=5, zorder=4,
            )  # fmt: skip
        axes.text(
            0.01, 0.015, f"arrows {times} times as long as the flow; the median of the differences is said above",
            transform=axes.transAxes, fontsize=5.5, color="white",
        )  # fmt: skip
    axes.set_title(f"(c) flow of what stands: predicted red, seen blue{told}", pad=3)


def _arrows(
    recording: Recording, camera: MountedCamera, flow: SeenFlow
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Of a point in each cell of a grid: its place, its place before as predicted and as seen; each (K, 2), px."""
    small = reduced(camera)
    pixels = []
    for time_ns in (flow.current_ns, flow.previous_ns):
        world_from_camera = recording.trajectory.world_from_vehicle(time_ns) @ camera.vehicle_from_camera
        pixels.append(_project(world_from_camera.inverse().apply(flow.points_world), small))
    (current, now), (previous, before) = pixels
    rows = np.flatnonzero(now & before)
    u, v = np.round(current[rows]).astype(int).T
    seen = current[rows] + flow.flow[np.clip(v, 0, small.model.height - 1), np.clip(u, 0, small.model.width - 1)]
    kept = np.isfinite(seen).all(axis=1)
    rows, seen = rows[kept], seen[kept]
    step = small.model.width / ARROWS_ACROSS
    cells = (current[rows] // step).astype(int) @ np.array([1, ARROWS_ACROSS + 1])
    _, first = np.unique(cells, return_index=True)
    scale = camera.model.width / small.model.width
    full = [
        (pixels_small + 0.5) * scale - 0.5
        for pixels_small in (current[rows][first], previous[rows][first], seen[first])
    ]
    return full[0], full[1], full[2]


def _draw_geometry(axes: Axes, camera: MountedCamera) -> None:
    road = camera.road
    up = -road.down
    forward = camera.vehicle_from_camera.inverse().rotate(np.array([1.0, 0.0, 0.0]))
    ahead = forward - (forward @ up) * up
    ahead /= np.linalg.norm(ahead)
    left = np.cross(up, ahead)
    turn = np.linspace(0.0, 2 * np.pi, HORIZON_POINTS)[:, None]
    _draw_line(axes, np.cos(turn) * ahead + np.sin(turn) * left, camera, colour=canvas.YELLOW, width=1.1)
    foot = road.down * road.height_m - (camera.vehicle_from_camera.translation_m[:2] @ np.eye(2, 3)) @ np.stack(
        [ahead, left, up]
    )
    along = np.arange(-GRID_M, GRID_M + LINE_STEP_M / 2, LINE_STEP_M)[:, None]
    for across in np.arange(-GRID_M, GRID_M + GRID_STEP_M / 2, GRID_STEP_M):
        for points in (foot + along * ahead + across * left, foot + across * ahead + along * left):
            fifth = round(across / GRID_STEP_M) % 5 == 0
            _draw_line(axes, points, camera, colour=canvas.SKY_BLUE, width=0.9 if fifth else 0.35)
    valid = ray_grid(camera.model).valid
    if not valid.all():
        axes.contour(valid, levels=[0.5], colors=[canvas.GREEN], linewidths=1.0)
    if camera.ego_body is not None and camera.ego_body.any():
        axes.contour(camera.ego_body, levels=[0.5], colors=[canvas.VERMILION], linewidths=1.0)
    axes.set_title("(d) horizon yellow, road by metres blue, lens green, own body red", pad=3)


def _draw_line(
    axes: Axes, points_camera: NDArray[np.float64], camera: MountedCamera, *, colour: str, width: float
) -> None:
    pixels, seen = _project(points_camera, camera)
    axes.plot(*np.where(seen[:, None], pixels, np.nan).T, color=colour, linewidth=width, zorder=3)


def _project(
    points_camera: NDArray[np.float64], camera: MountedCamera
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Pixels, (N, 2), and which of them are in the image."""
    pixels, valid = camera.model.project(points_camera)
    return pixels, valid & camera.model.contains(pixels)
