"""Write a native recording, file by file; each appears whole or not at all, with the same bytes every time."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.atomic import replacing, write_bytes, write_text
from bench.cameras.stored import camera_parameters
from bench.egomotion.files import write_tum
from bench.errors import ShapeError
from bench.geometry import RigidTransform
from bench.lidar.files import write_sweep
from bench.lidar.sweep import LidarSweep
from bench.recordings.annotations import AnnotationFile, PartlyAnnotated, Statement, annotation_document
from bench.recordings.mounting import Mounting
from bench.recordings.native import CONVENTIONS, HEAD, SCHEMA_VERSION, TRUE_CALIBRATION, TRUE_POSES, RecordingHead
from bench.recordings.validation import parse_json, validated
from bench.records.recording import MountedCamera, Track


class RecordingWriter:
    """Writes the files of one recording.

    Args:
        root: folder of the recording; its name is the recording's.
        decimals: of numbers in annotations, poses, bus signals and true calibration; None for every digit.
    """

    def __init__(self, root: str | Path, *, decimals: int | None = None) -> None:
        self.root, self._decimals = Path(root), decimals

    def header(
        self,
        *,
        name: str,
        licence: str,
        frame_interval_ns: int,
        cameras: Mapping[str, MountedCamera],
        vehicle_from_lidar: RigidTransform,
        vehicle_outline_m: NDArray[np.float64],
        ground_height_m: float = 0.0,
        lidar_from_sensor: RigidTransform | None = None,
        annotated: Statement | None = None,
    ) -> None:
        """Write `recording.json` and the masks of the ego vehicle's body.

        Args:
            name: of the recording.
            licence: of the data.
            frame_interval_ns: nominal time between images.
            cameras: by name, with the lens at the size of the images.
            vehicle_from_lidar: mounting of the lidar.
            vehicle_outline_m: (K, 2) float64, the ego vehicle seen from above, vehicle frame, m.
            ground_height_m: height of the road in the vehicle frame.
            lidar_from_sensor: as of the recording; None where points are given in the lidar's own axes.
            annotated: "none", "complete", or times and areas that are; None for complete if annotations are written.

        Raises:
            ShapeError: a camera whose lens has another size than its images.
            DataError: a value that the format refuses.
        """
        beams = {} if lidar_from_sensor is None else {"lidar_from_sensor": _mounting(lidar_from_sensor)}
        head = {
            "schema_version": SCHEMA_VERSION,
            "name": name,
            "licence": licence,
            "frame_interval_ns": int(frame_interval_ns),
            "conventions": CONVENTIONS,
            "vehicle": {
                "outline_m": np.asarray(vehicle_outline_m, dtype=np.float64).tolist(),
                "ground_height_m": float(ground_height_m),
            },
            "cameras": {camera: self._camera(camera, mounted) for camera, mounted in cameras.items()},
            "lidar": {"vehicle_from_lidar": _mounting(vehicle_from_lidar), **beams},
        }
        if annotated is not None:
            head["annotated"] = annotated.model_dump() if isinstance(annotated, PartlyAnnotated) else annotated
        text = _json(head)
        file = self.root / HEAD
        parse_json(RecordingHead, text.encode(), file)
        write_text(file, text)

    def image(
        self, camera: str, timestamp_ns: int, pixels: NDArray[np.uint8], *, jpeg_quality: int | None = None
    ) -> None:
        """Write an image: (H, W) grey or (H, W, 3) BGR, uint8; as PNG, or as JPEG of a quality from 1 to 100."""
        suffix, options = (".png", []) if jpeg_quality is None else (".jpg", [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
        _write_image(self.root / "images" / camera / f"{int(timestamp_ns)}{suffix}", pixels, np.uint8, options)

    def truth(self, camera: str, timestamp_ns: int, instance_ids: NDArray[np.uint16]) -> None:
        """Write the true instance ids of an image: (H, W) uint16, 0 where no object is seen."""
        _write_image(self.root / "truth" / camera / f"{int(timestamp_ns)}.png", instance_ids, np.uint16)

    def sweep(self, sweep: LidarSweep) -> None:
        """Write a lidar sweep."""
        with replacing(self.root / "lidar" / f"{int(sweep.timestamp_ns)}.npz") as temporary:
            write_sweep(temporary, sweep)

    def bus_signals(
        self,
        *,
        timestamps_ns: NDArray[np.int64],
        speed_mps: NDArray[np.float64],
        yaw_rate_radps: NDArray[np.float64],
        gear: Sequence[str | int] | NDArray[Any] | None = None,
    ) -> None:
        """Write `egomotion.csv`, one row per time; gear "R" or -1 is reverse, and the speed counts backwards."""
        lines = ["timestamp_ns,speed_mps,yaw_rate_radps" + ("" if gear is None else ",gear")]
        speeds, rates = (_rounded(np.asarray(x).tolist(), self._decimals) for x in (speed_mps, yaw_rate_radps))
        for i, (time_ns, speed, rate) in enumerate(zip(timestamps_ns, speeds, rates, strict=True)):
            last = "" if gear is None else f",{gear[i]}"
            lines.append(f"{int(time_ns)},{float(speed)!r},{float(rate)!r}{last}")
        write_text(self.root / "egomotion.csv", "\n".join(lines) + "\n")

    def poses(
        self,
        timestamps_ns: NDArray[np.int64],
        rotations: Rotation,
        positions_m: NDArray[np.float64],
        *,
        truth: bool = False,
    ) -> None:
        """Write `poses.csv` in TUM form, world_from_vehicle.

        Args:
            timestamps_ns: (N,) int64.
            rotations: N rotations as SciPy's `Rotation` holds them, world_from_vehicle.
            positions_m: (N, 3) float64, m.
            truth: write `truth/poses.csv` instead: the exact poses of a synthetic drive, which no method sees.

        Raises:
            ShapeError: `rotations` are of another type, for example an array of quaternions.
        """
        if not isinstance(rotations, Rotation):
            got = type(rotations).__name__
            raise ShapeError(f"rotations: expected scipy's Rotation, as Rotation.from_quat(xyzw) gives it, got {got}")
        path = self.root / (TRUE_POSES if truth else "poses.csv")
        with replacing(path) as temporary:
            write_tum(
                temporary, timestamps_ns=timestamps_ns, rotations=rotations, positions_m=positions_m,
                decimals=self._decimals,
            )  # fmt: skip

    def true_calibration(self, *, cameras: Mapping[str, MountedCamera], vehicle_from_lidar: RigidTransform) -> None:
        """Write `truth/calibration.json`: where the sensors of a synthetic recording sit, which no method sees.

        Args:
            cameras: by name.
            vehicle_from_lidar: mounting of the lidar.
        """
        mountings = {
            "vehicle_from_camera": {name: _mounting(camera.vehicle_from_camera) for name, camera in cameras.items()},
            "vehicle_from_lidar": _mounting(vehicle_from_lidar),
        }
        write_text(self.root / TRUE_CALIBRATION, _json(_rounded(mountings, self._decimals)))

    def annotations(self, tracks: Sequence[Track], *, timestamps_ns: Iterable[int] = ()) -> None:
        """Write `annotations.json`.

        Args:
            tracks: objects with their states.
            timestamps_ns: further times at which the scene was annotated, also where it held nothing.
        """
        path = self.root / "annotations.json"
        write_annotations(path, tracks, timestamps_ns=timestamps_ns, decimals=self._decimals)

    def _camera(self, name: str, camera: MountedCamera) -> dict[str, Any]:
        size = camera.model.width, camera.model.height
        if camera.stored_size_px != size:
            raise ShapeError(
                f"camera {name!r}: expected a lens at the size of the images {camera.stored_size_px}, got {size}"
            )
        parameters = camera_parameters(camera.model)
        mask = None
        if camera.ego_body is not None:
            mask = f"ego_body/{name}.png"
            _write_image(self.root / mask, camera.ego_body.astype(np.uint8) * 255, np.uint8)
        shutter = {} if camera.rolling_shutter is None else {"rolling_shutter": asdict(camera.rolling_shutter)}
        return {
            "model": {key: value for key, value in parameters.items() if key not in {"width", "height"}},
            "image_size": size,
            "vehicle_from_camera": _mounting(camera.vehicle_from_camera),
            "ego_body_mask": mask,
            **shutter,
        }


def write_annotations(
    path: Path, tracks: Sequence[Track], *, timestamps_ns: Iterable[int] = (), decimals: int | None = None
) -> None:
    """Write tracks as an annotation file.

    Args:
        path: the file.
        tracks: objects with their states.
        timestamps_ns: further times at which the scene was annotated, also where it held nothing.
        decimals: of numbers; None for every digit.

    Raises:
        DataError: what `read_annotations` would refuse to read back; nothing is written.
    """
    write_text(path, annotation_text(path, tracks, timestamps_ns=timestamps_ns, decimals=decimals))


def annotation_text(
    path: Path, tracks: Sequence[Track], *, timestamps_ns: Iterable[int] = (), decimals: int | None = None
) -> str:
    """The content of an annotation file; arguments and errors as of `write_annotations`."""
    document = annotation_document(tracks, timestamps_ns)
    validated(AnnotationFile, document, file=path)
    return _json(_rounded(document, decimals))


def _mounting(transform: RigidTransform) -> dict[str, Any]:
    return Mounting.of(transform).model_dump()


def _rounded(values: Any, decimals: int | None) -> Any:
    """A document with every float rounded, so that 0 has no sign; as it is where `decimals` is None."""
    if decimals is None:
        return values
    match values:
        case float():
            return round(values, decimals) + 0.0
        case dict():
            return {key: _rounded(value, decimals) for key, value in values.items()}
        case list() | tuple():
            return [_rounded(value, decimals) for value in values]
    return values


def _json(values: Any) -> str:
    return json.dumps(values, indent=1, allow_nan=False) + "\n"


def _write_image(path: Path, pixels: NDArray[Any], dtype: type[np.generic], options: Sequence[int] = ()) -> None:
    if pixels.dtype != dtype or pixels.ndim not in {2, 3}:
        raise ShapeError(f"{path.name}: expected an image of {dtype.__name__}, got {pixels.dtype} {pixels.shape}")
    written, encoded = cv2.imencode(path.suffix, pixels, options)
    assert written
    write_bytes(path, encoded.tobytes())
