"""Interface of every camera model, the rays of its cells, and the times of its rows.

Rolling shutter: the rows of an image are exposed one after the other. The time of an image is that of its middle row.
Rows are counted as the sensor is mounted: `direction` says which way the readout moves over the stored image, so that
the rows of a sensor mounted on its side are the image's columns.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, Self, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from bench.errors import ShapeError
from bench.geometry import Bools, Floats

Scalar = TypeVar("Scalar", bound=np.generic)
CHUNK_ROWS = 16_384  # temporaries of a chunk stay in the processor's cache


@dataclass(frozen=True, kw_only=True)
class CameraModel(ABC):
    """A map between rays of the camera frame and pixels.

    Attributes:
        width: image width, px.
        height: image height, px.
        principal_point: (u, v), px, where the optical axis meets the image; the centre of the first pixel is (0, 0).
    """

    width: int
    height: int
    principal_point: tuple[float, float]

    def __post_init__(self) -> None:
        if not (int(self.width) == self.width > 0 and int(self.height) == self.height > 0):
            raise ShapeError(f"camera model: expected a positive image size, got {self.width} x {self.height}")
        object.__setattr__(self, "width", int(self.width))
        object.__setattr__(self, "height", int(self.height))
        object.__setattr__(self, "principal_point", finite_pair(self.principal_point, "principal_point"))

    @property
    @abstractmethod
    def limit_angle_rad(self) -> float:
        """Largest angle to the optical axis at which the mapping holds."""

    @abstractmethod
    def _rescaled(self, scale_u: float, scale_v: float) -> dict[str, Any]:
        """The model's own fields that change in an image stretched by these factors."""

    @abstractmethod
    def _project(self, points: Floats) -> tuple[Floats, Floats, Bools]:
        """u, v and validity of a chunk of (n, 3) points; anything where not valid."""

    @abstractmethod
    def _unproject(self, u: Floats, v: Floats, rays: Floats) -> Bools:
        """Write unit rays of a chunk of n pixels into `rays` (n, 3); return validity."""

    def project(self, points_camera: Floats) -> tuple[Floats, Bools]:
        """Map points or rays of the camera frame to pixels.

        Args:
            points_camera: (N, 3) float64, camera frame, any length.

        Returns:
            pixels: (N, 2) float64, px, (u, v), also outside the image; NaN where not valid.
            valid: (N,) bool; False for a zero or non-finite ray and beyond `limit_angle_rad`.

        Raises:
            ShapeError: `points_camera` is not (N, 3).
        """
        points = _rows(points_camera, 3, "points_camera")
        pixels = np.empty((len(points), 2))
        valid = np.empty(len(points), dtype=bool)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for start in range(0, len(points), CHUNK_ROWS):
                part = slice(start, start + CHUNK_ROWS)
                pixels[part, 0], pixels[part, 1], valid[part] = self._project(points[part])
        pixels[~valid] = np.nan
        return pixels, valid

    def unproject(self, pixels: Floats) -> tuple[Floats, Bools]:
        """Map pixels to unit rays of the camera frame.

        Args:
            pixels: (N, 2) float64, px, (u, v); may lie outside the image.

        Returns:
            rays_camera: (N, 3) float64, unit length; NaN where not valid.
            valid: (N,) bool; False where the lens maps no ray to the pixel.

        Raises:
            ShapeError: `pixels` is not (N, 2).
        """
        uv = _rows(pixels, 2, "pixels")
        rays = np.empty((3, len(uv))).T  # each component contiguous, for all that is computed from it
        valid = np.empty(len(uv), dtype=bool)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for start in range(0, len(uv), CHUNK_ROWS):
                part = slice(start, start + CHUNK_ROWS)
                valid[part] = self._unproject(uv[part, 0], uv[part, 1], rays[part])
        rays[~valid] = np.nan
        return rays, valid

    def scaled(self, width: int, height: int) -> Self:
        """Return the lens as seen in an image of another size, px.

        The outer borders of the images coincide, so u' = (u + 0.5) width'/width - 0.5.
        """
        scale_u, scale_v = width / self.width, height / self.height
        u, v = self.principal_point
        centre = (u + 0.5) * scale_u - 0.5, (v + 0.5) * scale_v - 0.5
        return replace(self, width=width, height=height, principal_point=centre, **self._rescaled(scale_u, scale_v))

    def zoomed(self, factor: float) -> Self:
        """Return the lens with its focal length multiplied, in an image of the same size."""
        return replace(self, **self._rescaled(factor, factor))

    def contains(self, pixels: Floats) -> Bools:
        """Test that pixels lie in the image: (N, 2) -> (N,) bool; False for NaN."""
        u, v = pixels[:, 0], pixels[:, 1]
        return np.asarray((u >= -0.5) & (u < self.width - 0.5) & (v >= -0.5) & (v < self.height - 0.5))


@dataclass(frozen=True, kw_only=True)
class FocalCamera(CameraModel):
    """Base of the models with a focal length.

    Attributes:
        focal: (fx, fy), px.
    """

    focal: tuple[float, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "focal", finite_pair(self.focal, "focal"))
        if min(self.focal) <= 0:
            raise ShapeError(f"focal: expected two positive numbers, got {self.focal}")

    @override
    def _rescaled(self, scale_u: float, scale_v: float) -> dict[str, Any]:
        return {"focal": (self.focal[0] * scale_u, self.focal[1] * scale_v)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RayGrid:
    """Rays through the centres of square cells that tile the image from its first pixel.

    Attributes:
        cell_size_px: side of a cell; 1 for every pixel.
        pixels: (rows, columns, 2) float64, px, centre (u, v) of each cell. The last row and column may reach
            over the image's border where its size is no multiple of the cell.
        rays_camera: (rows, columns, 3) float64, unit rays; NaN where not valid.
        valid: (rows, columns) bool.
    """

    cell_size_px: int
    pixels: Floats
    rays_camera: Floats
    valid: Bools

    def at_centres(self, image: NDArray[Scalar]) -> NDArray[Scalar]:
        """An image's values at the centres of the cells, of border cells at the nearest pixel.

        Args:
            image: (H, W) of the camera's size.

        Returns:
            (rows, columns), the image's dtype.
        """
        height, width = image.shape
        rows = np.minimum(self.pixels[:, 0, 1].astype(np.intp), height - 1)
        columns = np.minimum(self.pixels[0, :, 0].astype(np.intp), width - 1)
        return image[np.ix_(rows, columns)]


@lru_cache(maxsize=16)
def ray_grid(camera: CameraModel, cell_size_px: int = 1) -> RayGrid:
    """The lookup of rays of a camera.

    Args:
        camera: any camera model; equal cameras share one lookup.
        cell_size_px: side of the square cells, px.

    Raises:
        ShapeError: a cell size below 1.
    """
    if cell_size_px < 1:
        raise ShapeError(f"cell_size_px: expected at least 1, got {cell_size_px}")
    middle = (cell_size_px - 1) / 2
    u = np.arange(0, camera.width, cell_size_px) + middle
    v = np.arange(0, camera.height, cell_size_px) + middle
    pixels = np.stack(np.meshgrid(u, v), axis=-1)
    rays, valid = camera.unproject(pixels.reshape(-1, 2))
    shape = pixels.shape[:2]
    grid = RayGrid(
        cell_size_px=cell_size_px, pixels=pixels, rays_camera=rays.reshape(*shape, 3), valid=valid.reshape(shape)
    )
    for array in (grid.pixels, grid.rays_camera, grid.valid):
        array.flags.writeable = False
    return grid


ReadoutDirection = Literal["down", "up", "left", "right"]
LONGEST_READOUT_S = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class RollingShutter:
    """Readout of a camera whose rows are exposed one after the other.

    Attributes:
        readout_s: number of rows times the time from one row to the next, s. It belongs to the whole image, whatever
            the size at which that is evaluated.
        direction: which way the readout moves over the image; "down" begins with the top row, "left" with the
            rightmost column.

    Raises:
        ShapeError: a readout that is not in (0, 0.2] s, or no direction.
    """

    readout_s: float
    direction: ReadoutDirection = "down"

    def __post_init__(self) -> None:
        if not 0 < self.readout_s <= LONGEST_READOUT_S:  # nor where it is NaN
            raise ShapeError(f"readout_s: expected seconds in (0, {LONGEST_READOUT_S}], got {self.readout_s}")
        if self.direction not in get_args(ReadoutDirection):
            expected = ", ".join(get_args(ReadoutDirection))
            raise ShapeError(f"direction: expected one of {expected}, got {self.direction!r}")

    def row_time_offset_s(self, pixels: NDArray[np.floating], camera: CameraModel) -> Floats:
        """Time of the pixels' rows after that of the image.

        Args:
            pixels: (..., 2), px, (u, v).
            camera: the lens at the size in which the pixels are counted.

        Returns:
            (...) float64, s, from minus to plus half of the readout, which pixels beyond the image have; 0 for NaN.
        """
        upright = self.direction in {"down", "up"}
        place, size = pixels[..., 1 if upright else 0], camera.height if upright else camera.width
        share = np.clip(np.nan_to_num((place + 0.5) / size - 0.5), -0.5, 0.5)
        return np.asarray((self.readout_s if self.direction in {"down", "right"} else -self.readout_s) * share)


def finite_pair(values: object, name: str) -> tuple[float, float]:
    """Two finite numbers as a tuple.

    Raises:
        ShapeError: anything else.
    """
    numbers = finite_numbers(values, name)
    if len(numbers) != 2:
        raise ShapeError(f"{name}: expected two numbers, got {numbers}")
    return numbers[0], numbers[1]


def finite_numbers(values: object, name: str) -> tuple[float, ...]:
    """Finite numbers as a tuple.

    Raises:
        ShapeError: a value that is not a finite number.
    """
    numbers = np.asarray(values, dtype=np.float64)
    if numbers.ndim != 1 or not np.isfinite(numbers).all():
        raise ShapeError(f"{name}: expected finite numbers in a row, got {numbers.tolist()}")
    return tuple(numbers.tolist())


def checked_max_angle(max_angle_rad: float | None) -> float:
    """The lens's stated field limit; pi where none is stated.

    Raises:
        ShapeError: not in (0, pi].
    """
    if max_angle_rad is None:
        return float(np.pi)
    if not 0 < max_angle_rad <= np.pi + 1e-12:
        raise ShapeError(f"max_angle_rad: expected an angle in (0, pi], got {max_angle_rad}")
    return float(max_angle_rad)


def _rows(values: Floats, columns: int, name: str) -> Floats:
    rows = np.asarray(values, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != columns:
        raise ShapeError(f"{name}: expected (N, {columns}), got {rows.shape}")
    return rows
