"""The pictures, videos, logs and calibration that `view` makes of frames; and the frames of stored runs, drawn.

The viewer rerun knows pinhole cameras only, so what a fisheye sees is drawn here and logged as a flat picture, beside
the path, the lidar in the world, and boxes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import cv2
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.atomic import refuse_foreign, replacing, write_bytes
from bench.cameras.model import ray_grid
from bench.errors import BenchError, OutputError, UsageError
from bench.evaluation.rows import IMAGE, pick
from bench.execution import Progress
from bench.harness.datasets import StoredFrames
from bench.harness.frames import FramePipeline, ProcessedFrame, UnscorableFrame
from bench.harness.stored import StoredRun
from bench.plain_text import counted
from bench.recordings import Cuboid, DatasetCard, ImageRef, read_image
from bench.records.recording import MountedCamera, Recording
from bench.records.reference import Category, ReferenceFrame, Status
from bench.reference.exposure import Readout
from bench.reference.sweeps import SweepCache
from bench.reporting import figures
from bench.reporting.formats import file_name, frame_name, image_name, made_by
from bench.reporting.frame import (
    FARTHEST_M,
    NEAREST_M,
    Layers,
    SeenSweep,
    draw_cluster,
    draw_frames,
    draw_panels,
    draw_points,
    faded,
    reference_layers,
    scored_layers,
    show_image,
)
from bench.validation.fits.flow import SeenFlow, reduced, seen_flow

# Pictures of a frame.


def write_frame_pictures(
    reference: ReferenceFrame,
    image: ImageRef,
    pipeline: FramePipeline,
    folder: Path,
    *,
    made_by: str,
    processed: ProcessedFrame | None = None,
) -> list[Path]:
    """Write pictures of an image, and `cluster-<track>.png` of each evaluated object; the files.

    Args:
        reference: of the image.
        image: of the pipeline's camera.
        pipeline: that built the reference.
        folder: is made.
        made_by: what is shown, as `made_by` says it, or the protocol.
        processed: what a method made of the image, for `panels.png` and `areas.png`; None for `reference.png` alone.

    Raises:
        DataError: the image cannot be read.
    """
    name = frame_name(reference)
    if processed is None:
        layers = reference_layers(read_image(image, pipeline.camera, colour=True), reference, label=made_by)
        drawn = {"reference": draw_frames([layers], name=name)}
    else:
        layers = scored_layers(processed, label=made_by)
        drawn = {"panels": draw_panels(processed, made_by=made_by), "areas": draw_frames([layers], name=name)}
    for target in reference.objects if image.moving_path is None else ():  # masks have no lidar points
        if target.status is Status.EVALUATED and target.polygon is not None:
            drawn[f"cluster-{file_name(target.track_id)}"] = draw_cluster(
                pipeline.references.geometry(target.track_id, image),
                image=layers.pixels,
                polygon=target.polygon,
                vehicle_outline_m=pipeline.recording.vehicle_outline_m,
                title=f"{target.object_class} {target.track_id}, {target.category}, {target.range_m:.1f} m, "
                f"{counted(target.points, 'point')}",
                image_name=name,
            )
    return [file for what, figure in drawn.items() for file in figures.write_picture(folder / what, figure, "png")]


# Frames of stored runs.

ImageKey = tuple[str, str, int]  # recording, camera, timestamp_ns


LARGEST = [*IMAGE, "category", "region_px"]


def example_frames(objects: Iterable[pd.DataFrame]) -> dict[Category, ImageKey]:
    """For every category the frame in which an object of it fills most pixels.

    Args:
        objects: the evaluated rows of each recording, at least the columns `LARGEST`.
    """

    def largest(rows: pd.DataFrame) -> pd.DataFrame:
        return rows.sort_values("region_px", ascending=False, kind="stable").drop_duplicates("category")

    rows = pick((rows.sort_values(IMAGE) for rows in objects), largest).set_index("category")[IMAGE]
    keys = {str(kind): (str(r.recording), str(r.camera), int(r.timestamp_ns)) for kind, r in rows.iterrows()}
    return {kind: keys[kind] for kind in Category if kind in keys}


Drawn = TypeVar("Drawn")


def draw_images(
    runs: Sequence[StoredRun],
    images: Iterable[ImageKey],
    draw: Callable[[ImageKey, Sequence[ProcessedFrame], FramePipeline], Drawn],
    *,
    card: DatasetCard | None = None,
    progress: Progress | None = None,
) -> tuple[dict[ImageKey, Drawn], list[str]]:
    """Draw images as runs were scored on them, from the data set that they name.

    Args:
        runs: of the same data set.
        images: in any order, also several times.
        draw: called with an image, the frame of every run, and the pipeline of the first.
        card: of the data set; None for that which each run names.
        progress: called with the images done and their number.

    Returns:
        drawn: of the images that could be processed.
        problems: why others could not, one line each: a run holds no masks or did not score them, the data set is not
            there, or code or data have changed since.
    """
    keys, drawn, problems = sorted(set(images)), dict[ImageKey, Drawn](), dict[str, None]()  # a recording at a time
    try:
        stored = [StoredFrames(run, card=card) for run in runs if keys]
    except BenchError as error:
        return {}, [str(error)]
    for number, key in enumerate(keys, start=1):
        try:
            frames = [frames_of_run.process(*key) for frames_of_run in stored]
            drawn[key] = draw(key, frames, stored[0].pipeline(*key[:2]))
        except (BenchError, UnscorableFrame) as error:
            problems[str(error)] = None
        if progress is not None:
            progress(number, len(keys))
    return drawn, list(problems)


def write_example_pictures(
    run: StoredRun, *, card: DatasetCard | None, progress: Progress
) -> tuple[list[Path], list[str]]:
    """Write, as it was scored, the frame of every category in which an object fills most pixels, into `pictures`.

    Returns:
        The files, and a line for every reason why a picture could not be made.
    """
    made = made_by(run.manifest.method.name, run.protocol.name)
    categories: dict[ImageKey, list[str]] = {}
    for category, key in example_frames(run.evaluated("objects", LARGEST)).items():
        categories.setdefault(key, []).append(category.value)

    def write(key: ImageKey, frames: Sequence[ProcessedFrame], pipeline: FramePipeline) -> list[Path]:
        (processed,), files = frames, list[Path]()
        for category in categories[key]:
            folder = run.folder / "pictures" / category
            files += write_frame_pictures(
                processed.reference, processed.image, pipeline, folder, made_by=made, processed=processed
            )
        return files

    written, problems = draw_images([run], categories, write, card=card, progress=progress)
    return [file for files in written.values() for file in files], problems


FARTHEST_SWEEP_NS = 100_000_000


class SweepViewer:
    """Projects the sweep nearest to an exposure.

    Args:
        recording: the drive.
        camera: whose images the sweeps are projected into.
    """

    def __init__(self, recording: Recording, camera: MountedCamera) -> None:
        self._recording, self._camera = recording, camera
        self._sweeps = SweepCache(recording, FARTHEST_SWEEP_NS)

    def see(self, image: ImageRef, *, compensated: bool = True) -> SeenSweep | None:
        """The sweep at an exposure; None where there is none within 100 ms, or no ego-motion.

        Args:
            image: the exposure.
            compensated: False for points as they were measured, as if nothing moved meanwhile.

        Raises:
            DataError: the sweep's file cannot be read.
        """
        placed = self._sweeps.nearest(None, image.timestamp_ns)
        if placed is None:
            return None
        world_from_vehicle = self._recording.trajectory.world_from_vehicle(image.timestamp_ns)
        if compensated:
            points_world = placed.points_world()
            points_vehicle = world_from_vehicle.inverse().apply(points_world)
            readout = Readout.at(image.timestamp_ns, trajectory=self._recording.trajectory, camera=self._camera)
        else:
            points_vehicle = self._recording.vehicle_from_lidar.apply(placed.sweep.points_lidar.astype(np.float64))
            points_world, readout = world_from_vehicle.apply(points_vehicle), None
        points_camera = self._camera.vehicle_from_camera.inverse().apply(points_vehicle)
        shown = points_camera if readout is None else readout.seen(points_camera, self._camera.model)
        pixels, seen = _project(shown, self._camera)
        range_m = np.linalg.norm(points_camera[seen], axis=1)
        return SeenSweep(points_world=points_world, pixels=pixels[seen], range_m=range_m)


# Videos and logs.

# The codecs that the OpenCV wheel carries; H.264 is not among them for its licence. Browsers play .webm only.
CODECS = {".mp4": "mp4v", ".webm": "VP90"}
DISK_HINT = "free some disk space, then run the same command again"
NEAR_STATE_NS = 60_000_000
POINT_RADIUS_M = 0.03
LEAST_ROOM_BYTES = 65_536  # of a log: with less the library waits for ever


def refuse_other_files(*, video: Path | None, rrd: Path | None) -> None:
    """Refuse what `write_film` could not write, before anything is rendered.

    Raises:
        UsageError: another suffix, or no viewer.
    """
    if video is not None and video.suffix.lower() not in CODECS:
        raise UsageError(f"video: expected a file {', '.join('*' + s for s in CODECS)}, got {video.name!r}")
    if rrd is not None and rrd.suffix.lower() != ".rrd":
        raise UsageError(f"--rrd: expected a file *.rrd, got {rrd.name!r}")
    if rrd is not None:
        viewer()


def viewer() -> ModuleType:
    """The viewer's library, which is optional.

    Raises:
        UsageError: it is not installed.
    """
    try:
        import rerun
    except ImportError as error:
        raise UsageError(
            f"--rrd: expected the optional viewer rerun, got none ({error}); "
            "install it: pip install 'fisheye-bench[viewer]', or write a --video instead"
        ) from error
    module: ModuleType = rerun
    return module


@contextmanager
def video_file(path: Path, *, frame_rate_hz: float) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
    """A video file that appears whole or not at all.

    Args:
        path: .mp4 or .webm.
        frame_rate_hz: pictures per second.

    Yields:
        Takes a picture, (H, W, 3) BGR uint8, at least one, all of one size; without the last row or column if odd.

    Raises:
        UsageError: a codec that cannot be written.
        OutputError: the file is there, cannot be written, or not to its end.
    """
    refuse_foreign(path)
    codec, pictures, writer = CODECS[path.suffix.lower()], 0, cv2.VideoWriter()

    def add(picture: NDArray[np.uint8]) -> None:
        nonlocal pictures
        even = picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]  # as codecs need it
        if not pictures:
            temporary.touch()  # OpenCV reports a path that cannot be written as it does a missing codec
            writer.open(str(temporary), cv2.VideoWriter.fourcc(*codec), frame_rate_hz, even.shape[1::-1])
        if not writer.isOpened():
            raise UsageError(
                f"{path}: expected a codec for {path.suffix} in this OpenCV, got none ({codec}); "
                f"try another of {', '.join(CODECS)}"
            )
        writer.write(np.ascontiguousarray(even))
        pictures += 1

    with replacing(path) as temporary:
        try:
            yield add
        finally:
            writer.release()
        video, held = cv2.VideoCapture(str(temporary)), 0  # OpenCV does not report that a disk is full
        while video.grab():
            held += 1
        stated = video.get(cv2.CAP_PROP_FRAME_COUNT)
        video.release()
        if not pictures == stated == held:
            raise OutputError(path, got="a file that ends before its last picture", hint=DISK_HINT)


@contextmanager
def rerun_log(
    path: Path, *, recording: Recording, camera: str
) -> Iterator[Callable[[ImageRef, NDArray[np.uint8], SeenSweep | None], None]]:
    """A file for the viewer that appears whole or not at all.

    Args:
        path: *.rrd.
        recording: the drive.
        camera: name of the camera whose images are logged.

    Yields:
        Takes an image, its overlay, (H, W, 3) BGR uint8, and its lidar sweep, if there is one.

    Raises:
        UsageError: the viewer's library is not installed.
        OutputError: the file is there, cannot be written, or not to its end.
        DataError: no ego-motion at an image.
    """
    rr = viewer()
    refuse_foreign(path)
    stream = rr.RecordingStream("fisheye-bench", recording_id=f"{recording.name}-{camera}")

    def add(image: ImageRef, picture: NDArray[np.uint8], seen: SeenSweep | None) -> None:
        stream.set_time("exposure", timestamp=np.datetime64(image.timestamp_ns, "ns"))
        pose = recording.trajectory.world_from_vehicle(image.timestamp_ns)
        stream.log("world/vehicle", rr.Transform3D(translation=pose.translation_m, mat3x3=pose.rotation))
        rgb = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
        stream.log(f"images/{image.camera}", rr.Image(rgb).compress(jpeg_quality=90))
        if seen is not None:
            stream.log("world/lidar", rr.Points3D(seen.points_world.astype(np.float32), radii=POINT_RADIUS_M))
        stream.log("world/objects", _boxes(rr, recording, image.timestamp_ns))

    with replacing(path) as temporary:
        temporary.write_bytes(bytes(LEAST_ROOM_BYTES))
        try:
            with _write_errors(path):
                stream.save(str(temporary))
            stream.log("world", rr.ViewCoordinates.FLU, static=True)
            path_m = recording.trajectory.positions_m.astype(np.float32)
            stream.log("world/path", rr.LineStrips3D([path_m]), static=True)
            outline = np.column_stack([recording.vehicle_outline_m, np.zeros(len(recording.vehicle_outline_m))])
            stream.log("world/vehicle/outline", rr.LineStrips3D([np.vstack([outline, outline[:1]])]), static=True)
            yield add
            with _write_errors(path):
                stream.flush()
        finally:
            stream.disconnect()


@contextmanager
def _write_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except RuntimeError as error:  # the library's thread that writes has ended; why, it prints itself
        raise OutputError(path, got=str(error), hint=DISK_HINT) from error


def _boxes(rr: ModuleType, recording: Recording, time_ns: int) -> Any:
    """The annotated boxes near a time, in the world."""
    placed = [
        (track, state.shape, recording.trajectory.world_from_vehicle(state.timestamp_ns))
        for track in recording.tracks
        if (state := track.state_near(time_ns, within_ns=NEAR_STATE_NS)) is not None and isinstance(state.shape, Cuboid)
    ]
    poses = [world_from_vehicle @ shape.vehicle_from_object for _, shape, world_from_vehicle in placed]
    turns = [Rotation.from_matrix(pose.rotation).as_quat(scalar_first=False) for pose in poses]
    return rr.Boxes3D(
        centers=np.array([pose.translation_m for pose in poses]).reshape(-1, 3),
        half_sizes=np.array([shape.size_m / 2 for _, shape, _ in placed]).reshape(-1, 3),
        quaternions=np.array(turns).reshape(-1, 4),
        labels=[f"{track.object_class} {track.track_id}" for track, *_ in placed],
    )


def write_film(
    pipeline: FramePipeline,
    indices: range,
    *,
    video: Path | None,
    rrd: Path | None,
    made_by: str,
    with_method: bool,
    progress: Progress,
) -> list[Path]:
    """Draw frames, those without a score as they are.

    Args:
        pipeline: processes the images of a camera.
        indices: of images, in steps that give the rate.
        video: the video file; None for none.
        rrd: the file for the viewer; None for none.
        made_by: method and protocol, in every picture.
        with_method: ask the method; else the reference is drawn alone.
        progress: called with the pictures done and their number.

    Returns:
        The files.

    Raises:
        UsageError: a codec that is missing.
        OutputError: a file cannot be written.
        DataError: an image or sweep cannot be read.
    """
    recording, camera = pipeline.recording, pipeline.camera
    sweeps = SweepViewer(recording, camera)
    rate_hz = 1e9 / recording.frame_interval_ns / indices.step
    with ExitStack() as stack:
        film = None if video is None else stack.enter_context(video_file(video, frame_rate_hz=rate_hz))
        log = None if rrd is None else stack.enter_context(rerun_log(rrd, recording=recording, camera=camera.name))
        for number, index in enumerate(indices, start=1):
            image = pipeline.images[index]
            sweep = sweeps.see(image)
            try:
                if with_method:
                    layers = scored_layers(pipeline.process(index), label=made_by, sweep=sweep)
                else:
                    pixels, reference = read_image(image, camera), pipeline.reference(index)
                    layers = reference_layers(pixels, reference, label=made_by, sweep=sweep)
            except UnscorableFrame as reason:
                pixels = read_image(image, camera)
                layers = Layers(pixels=pixels, reference=None, label=made_by, note=f"no score: {reason}")
            figure = draw_frames([layers], name=image_name(recording.name, camera.name, image.timestamp_ns))
            picture = figures.figure_pixels(figure)
            if film is not None:
                film(picture)
            if log is not None:
                log(image, picture, sweep)
            progress(number, len(indices))
    return [file for file in (video, rrd) if file is not None]


# The calibration of a camera: lidar, road, lens and ego-motion drawn onto an image, without any method.

GRID_M, GRID_STEP_M, LINE_STEP_M = 10.0, 1.0, 0.05  # reach of the grid, between its lines, between points of a line
HORIZON_POINTS = 1441
ARROWS_ACROSS, ARROW_PX = 32, 16.0  # arrows are drawn as many times as long as makes half of them longer than this
_WIDTH_IN, _TEXTS_IN = 4.3, 0.45
_FADE = 0.55


def write_calibration(
    recording: Recording, chosen: Mapping[str, Sequence[int]], *, out: Path, progress: Progress
) -> list[Path]:
    """Write `<recording>-<camera>/<index>-<image>/calibration.png` of images; the files.

    Args:
        recording: the drive.
        chosen: indices of images by camera.
        out: folder of the pictures.
        progress: called with the pictures done and their number.

    Raises:
        DataError: an image or its sweep cannot be read.
        OutputError: a file cannot be written.
    """
    tasks = [(name, index) for name, indices in chosen.items() for index in indices]
    sweeps = {name: SweepViewer(recording, recording.cameras[name]) for name in chosen}
    files = []
    for number, (name, index) in enumerate(tasks, start=1):
        figure = draw_calibration(recording, name, index, sweeps[name])
        image_folder = f"{index:06d}-{file_name(recording.images[name][index].path.stem)}"
        files.append(out / f"{file_name(recording.name)}-{file_name(name)}" / image_folder / "calibration.png")
        write_bytes(files[-1], figures.figure_bytes(figure, "png"))
        progress(number, len(tasks))
    return files


@figures.styled
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
    grey = faded(read_image(image, camera), _FADE)
    height_in = _WIDTH_IN * grey.shape[0] / grey.shape[1]
    figure = figures.new_figure(2 * _WIDTH_IN, 2 * height_in + _TEXTS_IN, layout="constrained")
    axes = figure.subplots(2, 2).ravel()
    for panel in axes:
        show_image(panel, grey)
    _draw_points(axes[0], "(a) lidar at the exposure, by range", sweeps.see(image))
    as_measured = sweeps.see(image, compensated=False)
    _draw_points(axes[1], "(b) lidar as measured, without motion compensation", as_measured)
    _draw_flow(axes[2], recording, camera, index)
    _draw_geometry(axes[3], camera)
    name = image_name(recording.name, camera_name, image.timestamp_ns)
    figure.supxlabel(f"{name}; points from {NEAREST_M:g} m, yellow, to {FARTHEST_M:g} m, dark", fontsize=6.5)
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
    elif not arrows.size:
        told = ": none where there is flow"
    else:
        current, predicted, seen = arrows
        told = f"; they differ by {np.median(np.linalg.norm(predicted - seen, axis=1)):.1f} px"
        times = max(1, round(ARROW_PX / max(float(np.median(np.linalg.norm(seen - current, axis=1))), 0.1)))
        for ends, colour, width in ((predicted, figures.VERMILION, 0.9), (seen, figures.SKY_BLUE, 0.5)):
            axes.quiver(
                *(current - times * (current - ends)).T, *times * (current - ends).T, color=colour, angles="xy",
                scale_units="xy", scale=1.0, width=width / 72 / _WIDTH_IN, headwidth=4, headlength=5, zorder=4,
            )  # fmt: skip
        axes.text(
            0.01, 0.015, f"arrows: {times} x the flow; the median of the differences is said above",
            transform=axes.transAxes, fontsize=5.5,
            bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 0.8},
        )  # fmt: skip
    axes.set_title(f"(c) flow of what stands: predicted red, seen blue{told}", pad=3)


def _arrows(recording: Recording, camera: MountedCamera, flow: SeenFlow) -> NDArray[np.float64]:
    """(3, K, 2), px, of a point in each cell of a grid: its place, its place before as predicted, and as seen."""
    small = reduced(camera)
    pixels = []
    for time_ns in (flow.current_ns, flow.previous_ns):
        world_from_camera = recording.trajectory.world_from_vehicle(time_ns) @ camera.vehicle_from_camera
        pixels.append(_project(world_from_camera.inverse().apply(flow.points_world), small))
    (current, now), (previous, before) = pixels
    rows = np.flatnonzero(now & before)
    u, v = np.round(current[rows]).astype(int).T
    seen = current[rows] + flow.flow[np.clip(v, 0, small.model.height - 1), np.clip(u, 0, small.model.width - 1)]
    places = np.stack([current[rows], previous[rows], seen])[:, np.isfinite(seen).all(axis=1)]
    step = small.model.width / ARROWS_ACROSS
    cells = (places[0] // step).astype(int) @ np.array([1, ARROWS_ACROSS + 1])
    _, first = np.unique(cells, return_index=True)
    return (places[:, first] + 0.5) * (camera.model.width / small.model.width) - 0.5


def _draw_geometry(axes: Axes, camera: MountedCamera) -> None:
    road = camera.road
    up = -road.down
    forward = camera.vehicle_from_camera.inverse().rotate(np.array([1.0, 0.0, 0.0]))
    ahead = forward - (forward @ up) * up
    ahead /= np.linalg.norm(ahead)
    left = np.cross(up, ahead)
    turn = np.linspace(0.0, 2 * np.pi, HORIZON_POINTS)[:, None]
    _draw_line(axes, np.cos(turn) * ahead + np.sin(turn) * left, camera, colour=figures.YELLOW, width=1.1)
    foot = road.down * road.height_m - (camera.vehicle_from_camera.translation_m[:2] @ np.eye(2, 3)) @ np.stack(
        [ahead, left, up]
    )
    along = np.arange(-GRID_M, GRID_M + LINE_STEP_M / 2, LINE_STEP_M)[:, None]
    for across in np.arange(-GRID_M, GRID_M + GRID_STEP_M / 2, GRID_STEP_M):
        for points in (foot + along * ahead + across * left, foot + across * ahead + along * left):
            fifth = round(across / GRID_STEP_M) % 5 == 0
            _draw_line(axes, points, camera, colour=figures.SKY_BLUE, width=0.9 if fifth else 0.35)
    valid = ray_grid(camera.model).valid
    if not valid.all():
        axes.contour(valid, levels=[0.5], colors=[figures.GREEN], linewidths=1.0)
    if camera.ego_body is not None and camera.ego_body.any():
        axes.contour(camera.ego_body, levels=[0.5], colors=[figures.VERMILION], linewidths=1.0)
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
