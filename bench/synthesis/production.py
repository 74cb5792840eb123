"""A whole scenario, read and checked, rendered in parallel, resumed where it was interrupted.

`synthesis.json` in the folder of each recording says what it was made from, and the digest of each of its files. A
recording is rendered again when the former changes or files are missing. Only files that are as they were rendered are
ever removed.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Collection, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bench.atomic import folder_lock, make_folder, write_text
from bench.errors import DataError, UsageError
from bench.execution import FailedTask, local_executor, usable_cores
from bench.geometry import RigidTransform
from bench.plain_yaml import parse_yaml
from bench.recordings import Cuboid, ObjectState, RecordingWriter, Track
from bench.recordings.files import read_text
from bench.recordings.validation import validated
from bench.synthesis.ego import OUTLINE_M, bus_report, mounted_rig
from bench.synthesis.imaging.renderer import write_images
from bench.synthesis.scanner import scans
from bench.synthesis.scenario import (
    DrawError,
    RecordingSpec,
    Scenario,
    ScenarioFile,
    ScenarioHead,
    interval_ns,
    named_rng,
)
from bench.synthesis.scene import FIRST_IMAGE_NS, Actor, Scene, build_scene, camera_fault, first_clash

LARGEST_BYTES = 4_000_000


ATTEMPTS = 60  # draws of a recording before a series counts as one that leaves no space
EXPECTED_SPACE = "bodies that never overlap"


def read_scenario(path: Path) -> Scenario:
    """Read a scenario file and spell out its series.

    A recording of a series in which bodies would overlap is drawn anew, so that the series need not foresee every
    encounter of what it draws.

    Raises:
        DataError: missing, too large, not YAML, not a scenario, or bodies inside one another; the message names file
            and field.
    """
    values = parse_yaml(read_text(path, largest_bytes=LARGEST_BYTES, expected="a readable scenario"), file=path)
    if not isinstance(values, dict):
        raise DataError(path, expected="keys and values", got=type(values).__name__)
    file = validated(ScenarioFile, values, file=path)
    for number, camera in enumerate(file.cameras):
        if (got := camera_fault(camera)) is not None:
            raise DataError(path, field=f"cameras.{number}.position_m", expected="a camera in the open", got=got)
    for number, spec in enumerate(file.recordings):
        _refuse_unknown_cameras(path, f"recordings.{number}", file, spec)
        if (clash := first_clash(file, spec)) is not None:
            field = f"recordings.{number}.actors.{clash[0]}"
            raise DataError(path, field=field, expected=EXPECTED_SPACE, got=clash[1], hint=f"see {spec.name}")
    drawn = [
        _drawn(path, file, number, index) for number, series in enumerate(file.series) for index in range(series.count)
    ]
    head = {key: getattr(file, key) for key in ScenarioHead.model_fields}
    return validated(Scenario, {**head, "recordings": (*file.recordings, *drawn)}, file=path)


def _drawn(path: Path, file: ScenarioFile, number: int, index: int) -> RecordingSpec:
    """One recording of a series, drawn until no bodies overlap."""
    series, field, actor, reason = file.series[number], f"series.{number}", "", ""
    for attempt in range(ATTEMPTS):
        try:
            values, origins = series.recording(index, seed=file.seed, attempt=attempt)
        except DrawError as error:
            fault = f"{field}.{error.path}"
            raise DataError(path, field=fault, expected=error.expected, got=error.got) from None
        spec = _validated(values, path, field, origins)
        _refuse_unknown_cameras(path, field, file, spec)
        if (clash := first_clash(file, spec)) is None:
            return spec
        actor, reason = f"{field}.actors.{origins[clash[0]]}", clash[1]
    raise DataError(
        path,
        field=actor,
        expected=f"space for all bodies in recording {index + 1} of {series.count}",
        got=f"bodies inside one another in each of {ATTEMPTS} draws, at last {reason}",
        hint="give them more space, or ask for fewer",
    )


def _refuse_unknown_cameras(path: Path, field: str, file: ScenarioFile, spec: RecordingSpec) -> None:
    known = [camera.name for camera in file.cameras]
    if unknown := [name for name in spec.cameras if name not in known]:
        raise DataError(path, field=f"{field}.cameras", expected=f"some of {', '.join(known)}", got=", ".join(unknown))


def _validated(values: dict[str, Any], path: Path, field: str, origins: list[int]) -> RecordingSpec:
    """A drawn recording; a fault is that of the series' actor that it was drawn from."""
    try:
        return validated(RecordingSpec, values, file=path, field=field)
    except DataError as error:
        keys = (error.field or "").split(".")
        if len(keys) > 3 and keys[2] == "actors" and keys[3].isdigit():
            keys[3] = str(origins[int(keys[3])])
        raise DataError(path, field=".".join(keys), expected=error.expected, got=error.got, hint=error.hint) from None


# Between true poses a reader moves with constant twist. Measured over hard braking, bends and a bump of 5 cm at up to
# 50 km/h, that is off by at most 2e-5 rad (0.004 px) and 0.06 mm at 200 Hz, four times as much at 100 Hz.
TRUTH_INTERVAL_NS = 5_000_000
DECIMALS = 7  # of m, rad and quaternions that are written: beyond any sensor, before what depends on the processor


def write_motion(scenario: Scenario, spec: RecordingSpec, scene: Scene, writer: RecordingWriter) -> None:
    """Write the bus signals and the exact poses."""
    rng = named_rng(scenario.seed, spec.name, "bus")
    report = bus_report(scene.ego.ground, scenario.vehicle.bus, rng)
    writer.bus_signals(
        timestamps_ns=report.times_ns + FIRST_IMAGE_NS,
        speed_mps=report.speeds_mps,
        yaw_rate_radps=report.yaw_rates_radps,
        gear=["R" if spec.host.gear == "reverse" else "D"] * len(report.times_ns),
    )
    nodes_ns = scene.ego.nodes_ns
    first, last = -(-int(nodes_ns[0]) // TRUTH_INTERVAL_NS), int(nodes_ns[-1]) // TRUTH_INTERVAL_NS
    times_ns = np.arange(first, last + 1, dtype=np.int64) * TRUTH_INTERVAL_NS
    poses = scene.ego.at(times_ns)
    writer.poses(times_ns + FIRST_IMAGE_NS, Rotation.from_matrix(poses.rotations), poses.positions_m, truth=True)


def render_recording(scenario: Scenario, spec: RecordingSpec, root: Path) -> None:
    """Render a recording into a folder.

    Args:
        scenario: the file that it belongs to.
        spec: the recording.
        root: its folder, whose name is free; nothing of an older recording may lie in it.
    """
    scene, rig = build_scene(scenario, spec), mounted_rig(scenario, spec)
    writer = RecordingWriter(root, decimals=DECIMALS)
    for camera in rig.cameras.values():
        write_images(scenario, spec, scene, camera=camera, writer=writer)
    for sweep in scans(scenario, spec, scene, vehicle_from_lidar=rig.vehicle_from_lidar):
        writer.sweep(sweep)
    write_motion(scenario, spec, scene, writer)
    times_ns = (scene.sweep_times_ns + FIRST_IMAGE_NS).tolist()
    writer.annotations([_track(actor, scene) for actor in scene.actors], timestamps_ns=times_ns)
    writer.true_calibration(cameras=rig.cameras, vehicle_from_lidar=rig.vehicle_from_lidar)
    writer.header(
        name=spec.name,
        licence=scenario.licence,
        frame_interval_ns=interval_ns(scenario.frame_rate_hz),
        cameras=rig.recorded_cameras,
        vehicle_from_lidar=rig.recorded_vehicle_from_lidar,
        vehicle_outline_m=OUTLINE_M,
    )


def _track(actor: Actor, scene: Scene) -> Track:
    """A cuboid at the reference time of every sweep, in the frame of the ego vehicle's body as it is at that time."""
    middle = RigidTransform(np.eye(3), np.array([0.0, 0.0, actor.body.size_m[2] / 2]))
    states = []
    for time_ns in scene.sweep_times_ns.tolist():
        vehicle_from_world = scene.ego.at([time_ns]).transform().inverse()
        world_from_centre = actor.path.at([time_ns]).transform() @ middle
        _, yaw_rates_radps = actor.path.signals([time_ns])
        shape = Cuboid(vehicle_from_object=vehicle_from_world @ world_from_centre, size_m=actor.body.size_m)
        states.append(
            ObjectState(
                timestamp_ns=time_ns + FIRST_IMAGE_NS,
                shape=shape,
                velocity_mps=vehicle_from_world.rotate(actor.path.velocity_mps(time_ns)),
                yaw_rate_radps=float(yaw_rates_radps[0]),
            )
        )
    return Track(
        track_id=actor.name, object_class=actor.body.object_class, states=tuple(states), instance_id=actor.instance_id
    )


GENERATOR_VERSION = 8  # raise it whenever the same scenario gives other bytes
MANIFEST = "synthesis.json"
UNFINISHED = ".unfinished"

Progress = Callable[[int, int], None]


def _rendered(scenario: Scenario, specs: list[RecordingSpec], out: Path, workers: int) -> Iterator[RecordingSpec]:
    executor = local_executor(min(workers, len(specs)))
    with executor, closing(executor.compute(partial(_produce, scenario=scenario, out=out), specs)) as results:
        for spec, outcome in results:
            if isinstance(outcome, FailedTask):
                hint = "call it again, with fewer workers where memory is short; what is rendered stays"
                raise DataError(out / spec.name, expected="a rendered recording", got=outcome.reason, hint=hint)
            yield spec


def _produce(spec: RecordingSpec, *, scenario: Scenario, out: Path) -> None:
    """Render one recording in a temporary folder, then move it."""
    unfinished, final = out / UNFINISHED / spec.name, out / spec.name
    shutil.rmtree(unfinished, ignore_errors=True)
    render_recording(scenario, spec, unfinished)
    manifest = _origin(scenario, spec) | {"files": _digests(unfinished)}
    write_text(unfinished / MANIFEST, json.dumps(manifest, indent=1) + "\n")
    if final.exists():
        _refuse_edited(final)
        shutil.rmtree(final)
    unfinished.replace(final)


def _origin(scenario: Scenario, spec: RecordingSpec) -> dict[str, Any]:
    """Digest of what a recording is made from: the generator, the sensors and the recording's own lines."""
    shared = scenario.model_dump(mode="json", exclude={"recordings"})
    content = json.dumps([GENERATOR_VERSION, shared, spec.model_dump(mode="json")], sort_keys=True)
    digest = hashlib.sha256(content.encode()).hexdigest()
    return {"scenario": scenario.name, "recording": spec.name, "digest": digest}


def _digests(folder: Path) -> dict[str, str]:
    """SHA-256 of a recording's files by name, its manifest left out; "" for what is no file, such as a link."""
    return {
        path.relative_to(folder).as_posix(): "" if path.is_symlink() else hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.name != MANIFEST and (path.is_symlink() or not path.is_dir())
    }


def _is_rendered(folder: Path, scenario: Scenario, spec: RecordingSpec) -> bool:
    """Return True where a recording made from the same lines is there, with all of its files."""
    manifest = _read_manifest(folder)
    complete = bool(manifest["files"]) and all((folder / name).is_file() for name in manifest["files"])
    return complete and _origin(scenario, spec).items() <= manifest.items()


def _read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest; one without files where there is none."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        manifest = None
    held = isinstance(manifest, dict) and isinstance(manifest.get("files"), dict)
    return manifest if held else {"files": {}}


def _is_as_rendered(folder: Path) -> bool:
    """Return True where nothing is in a folder but files of its manifest, unchanged; some may be missing."""
    files = _read_manifest(folder)["files"]
    return bool(files) and not folder.is_symlink() and _digests(folder).items() <= files.items()


def _refuse_edited(folder: Path) -> None:
    if not _is_as_rendered(folder):
        expected = "no such folder, or a recording as synthesize rendered it"
        got = "one with files that are of others or were changed"
        hint = "it has to be rendered again: move it away, or render into another folder"
        raise DataError(folder, expected=expected, got=got, hint=hint)


def _remove_former(scenario: Scenario, out: Path) -> None:
    """Remove recordings that this scenario rendered and no longer has, where nobody changed or copied them."""
    names = {spec.name for spec in scenario.recordings}
    for folder in sorted(path for path in out.iterdir() if path.is_dir() and path.name not in names):
        ours = {"scenario": scenario.name, "recording": folder.name}.items() <= _read_manifest(folder).items()
        if ours and _is_as_rendered(folder):
            shutil.rmtree(folder)


def synthesize(
    scenario_path: str | Path,
    out: str | Path,
    *,
    only: Collection[str] | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Render every recording of a scenario that is not there yet.

    A recording is rendered in a temporary folder and then moved. What is there is kept if it was made by the same
    generator from the same lines of the scenario and no file is missing, and replaced otherwise; recordings that the
    scenario no longer has are removed. Files that were added or changed since, and copies, are never removed: where
    one is in the way, nothing is rendered. Recordings do not depend on each other, on the order or on the number of
    workers. A second call for the same folder waits until the first is done, and then finds everything there.

    Args:
        scenario_path: the scenario file.
        out: folder of the recordings.
        only: recordings that are wanted; None for all.
        workers: processes; None for one per core that this process may use.
        progress: called with the numbers of finished and of all recordings.

    Returns:
        Folders of the recordings, in the scenario's order.

    Raises:
        DataError: the scenario is not one, or a folder in the way is not as `synthesize` made it.
        UsageError: fewer than one worker.
    """
    if workers is not None and workers < 1:
        raise UsageError(f"workers: expected at least 1, got {workers}")
    scenario, out = read_scenario(Path(scenario_path)), Path(out)
    make_folder(out)
    with folder_lock(out):
        _remove_former(scenario, out)
        wanted = [spec for spec in scenario.recordings if only is None or spec.name in only]
        missing = [spec for spec in wanted if not _is_rendered(out / spec.name, scenario, spec)]
        for spec in missing:
            if (out / spec.name).exists():
                _refuse_edited(out / spec.name)
        done, total = len(wanted) - len(missing), len(wanted)
        if progress is not None:
            progress(done, total)
        for count, _ in enumerate(_rendered(scenario, missing, out, workers or usable_cores()), start=done + 1):
            if progress is not None:
                progress(count, total)
        shutil.rmtree(out / UNFINISHED, ignore_errors=True)
    return [out / spec.name for spec in wanted]
