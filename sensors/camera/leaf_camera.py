"""The leaf camera, which reads the fields in its footprint, and the footprint's place on the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol

import numpy as np

from geo.texts import unknown
from sensors.errors import ObservationError
from sensors.fields import PAPER_FIELDS, FieldSet

if TYPE_CHECKING:
    from numpy.typing import NDArray

HEALTHY = 1.0
INFECTED = 0.5
MAX_FOOTPRINT_CELLS = 64
NOWHERE_M = 1e7
"""East and north offset (m) of an image that shows no ground: a place outside every farm."""
MOST_READINGS = 1 << 24
"""Largest number of a reading: 32-bit floats hold all whole numbers up to this limit exactly."""
_FARTHEST_M = 10_000.0
# Rounding to single precision tilts a vertical axis by at most this angle (rad, less than 0.01 degrees).
_STRAIGHT = 5e-5
_UNIT = 0.01  # The squared norm of a rotation differs from 1 by less than this


class Sampled(Protocol):
    """Source of the field values that a leaf camera reads, such as a `sensors.environment.Environment`."""

    def sample(self, day: int, ix: NDArray[np.int64], iy: NDArray[np.int64], /) -> NDArray[np.float32]:
        """Return the values of k fields at n cells on the farm, float32[n, k]."""
        ...


class Camera(Protocol):
    """Interface of leaf cameras."""

    options: LeafCameraOptions

    def capture(self, ix: Sequence[int], iy: Sequence[int]) -> NDArray[np.float32]:
        """Take an image centred on each cell (ix, iy), and return float32[images, cells, fields]."""
        ...


@dataclass(frozen=True, slots=True)
class LeafCameraOptions:
    """Footprint and errors of a leaf camera. By default the camera reads one cell, all fields, without error.

    Parameters
    ----------
    footprint_cells : int
        Side of the square of cells that an image covers.
    noise_std : float or sequence of float
        Standard deviation of Gaussian noise: one number for all fields, or one number for each field. Noisy
        readings are not clipped to 0..1, because clipping would bias them.
    false_positive_rate : float
        Probability that a healthy leaf (1.0) is read as infected (0.5), for each disease field.
    false_negative_rate : float
        Probability that a diseased or lost leaf (below 1.0) is read as healthy (1.0), for each disease field.
    sensed : sequence of str, optional
        Names of the measured fields, without repetitions; readings of other fields are NaN. Default: all.
    fields : FieldSet
        The fields, in the order of the readings.

    Raises
    ------
    ObservationError
        If an option is out of range, or a field is unknown or given twice.
    """

    footprint_cells: int = 1
    noise_std: float | Sequence[float] = 0.0
    false_positive_rate: float = 0.0
    false_negative_rate: float = 0.0
    sensed: Sequence[str] | None = None
    fields: FieldSet = PAPER_FIELDS

    def __post_init__(self) -> None:
        if not 1 <= self.footprint_cells <= MAX_FOOTPRINT_CELLS or self.footprint_cells % 1:
            msg = f"camera: footprint of {self.footprint_cells} cells is outside 1..{MAX_FOOTPRINT_CELLS}"
            raise ObservationError(msg)
        object.__setattr__(self, "noise_std", self._per_field())
        for name in ("false_positive_rate", "false_negative_rate"):
            rate = getattr(self, name)
            if not 0.0 <= rate <= 1.0:
                raise ObservationError(f"camera: {name} {rate} is outside 0..1")
        object.__setattr__(self, "sensed", self._sensed())

    def _sensed(self) -> tuple[str, ...]:
        names = self.fields.names
        if self.sensed is None:
            return names
        sensed = (self.sensed,) if isinstance(self.sensed, str) else tuple(self.sensed)
        if not sensed:
            raise ObservationError(f"camera: no field is sensed; choose from {', '.join(names)}")
        for name in sensed:
            if name not in names:
                raise ObservationError(f"camera: {unknown('field', name, names)}")
            if sensed.count(name) > 1:
                raise ObservationError(f"camera: field {name!r} is given twice; give it once")
        return sensed

    def _per_field(self) -> tuple[float, ...]:
        given, names = self.noise_std, self.fields.names
        stds = (float(given),) * len(names) if isinstance(given, int | float) else tuple(map(float, given))
        if len(stds) != len(names) or not all(math.isfinite(std) and std >= 0.0 for std in stds):
            msg = f"camera: noise_std {given}: give one number >= 0, or one for each of {', '.join(names)}"
            raise ObservationError(msg)
        return stds

    @property
    def random(self) -> bool:
        """Whether the camera's readings have random errors."""
        return any(self._per_field()) or self.false_positive_rate > 0.0 or self.false_negative_rate > 0.0


class LeafCamera:
    """A camera that reads the fields of an environment in the cells of its footprint.

    Readings depend on the cells, the generator and the order of the images, but not on the number of images
    per call. Readings of cells outside the farm's `shape` are NaN. `rng` generates random errors; without
    `rng`, options with random errors raise ObservationError.

    Examples
    --------
    >>> class Field:
    ...     def sample(self, day, ix, iy):
    ...         return np.stack([ix / 10, iy / 10, np.full(len(ix), day)], axis=1).astype(np.float32)
    >>> camera = LeafCamera(Field(), (10, 10), day=6)
    >>> camera.capture([3, 12], [4, 4])[:, 0].tolist()
    [[0.30000001192092896, 0.4000000059604645, 6.0], [nan, nan, nan]]
    """

    def __init__(
        self,
        environment: Sampled,
        shape: tuple[int, int],
        day: int,
        options: LeafCameraOptions | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        self.environment = environment
        self.shape = shape
        self.day = day
        self.options = options = LeafCameraOptions() if options is None else options
        dx, dy = footprint_offsets(options.footprint_cells)
        self._dx, self._dy = dx, dy
        self._low, self._high = -int(dx.min()), int(dx.max())
        names = options.fields.names
        self._n_fields = len(names)
        self._blind = [k for k, name in enumerate(names) if name not in (options.sensed or names)]
        self._diseases = [names.index(field.name) for field in options.fields.diseases]
        self._noise_std = np.array(options.noise_std, np.float32) if np.any(options.noise_std) else None
        self._flips = options.false_positive_rate > 0.0 or options.false_negative_rate > 0.0
        if options.random and rng is None:
            raise ObservationError("camera: noise or false readings need a random generator")
        self._noise_rng: np.random.Generator | None = None
        self._flip_rng: np.random.Generator | None = None
        if rng is not None and options.random:
            self._noise_rng, self._flip_rng = rng.spawn(2)

    def capture(self, ix: Sequence[int], iy: Sequence[int]) -> NDArray[np.float32]:
        """Take an image centred on each of n cells, on the farm or off it; return float32[n, k, fields].

        The k cells of a footprint are in the order of `footprint_offsets`. A reading is NaN if the camera
        does not sense the field or the cell is off the farm.
        """
        width, height = self.shape
        x, y = np.array(ix, np.int64), np.array(iy, np.int64)
        images, cells = len(x), len(self._dx)
        if cells > 1:
            x, y = (x[:, None] + self._dx).ravel(), (y[:, None] + self._dy).ravel()
        low, right, top = self._low, width - self._high, height - self._high
        # On this hot path Python ints are compared, which is four times as fast as comparing arrays.
        if images and low <= min(ix) and max(ix) < right and low <= min(iy) and max(iy) < top:
            values = self._read(x, y)
        else:
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            values = np.full((len(x), self._n_fields), np.nan, np.float32)
            if inside.any():
                values[inside] = self._read(x[inside], y[inside])
        if self._flips:
            values = self._flipped(values)
        if self._noise_rng is not None and self._noise_std is not None:
            noise = self._noise_rng.standard_normal(values.shape, dtype=np.float32)
            values = values + noise * self._noise_std
        if self._blind:
            values = values.copy()
            values[:, self._blind] = np.nan
        return values.reshape(images, cells, self._n_fields)

    def _read(self, x: NDArray[np.int64], y: NDArray[np.int64]) -> NDArray[np.float32]:
        return self.environment.sample(self.day, x, y).astype(np.float32, copy=False)

    def _flipped(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        assert self._flip_rng is not None
        options = self.options
        luck = self._flip_rng.random((len(values), len(self._diseases)), dtype=np.float32)
        values = values.copy()
        disease = values[:, self._diseases]
        wrongly_infected = (disease >= HEALTHY) & (luck < options.false_positive_rate)
        wrongly_healthy = (disease < HEALTHY) & (luck < options.false_negative_rate)
        disease[wrongly_infected] = INFECTED
        disease[wrongly_healthy] = HEALTHY
        values[:, self._diseases] = disease
        return values


@lru_cache(maxsize=MAX_FOOTPRINT_CELLS)
def footprint_offsets(footprint_cells: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the offsets (x, y) of a footprint's cells from its centre cell, column by column, read-only.

    Examples
    --------
    >>> [offsets.tolist() for offsets in footprint_offsets(2)]
    [[0, 0, 1, 1], [0, 1, 0, 1]]
    """
    side = np.arange(footprint_cells) - (footprint_cells - 1) // 2
    offsets = np.repeat(side, footprint_cells), np.tile(side, footprint_cells)
    for along in offsets:
        along.flags.writeable = False
    return offsets


def ground_offset(quaternion: Sequence[float], height_m: float) -> tuple[float, float]:
    """Return the east and north offset (m) of the point where the optical axis meets flat ground.

    The distance is the height times the tangent of the angle from straight down. Both offsets are `NOWHERE_M`
    for distances above 10 km (ArduPilot's ``AP_MOUNT_POI_DIST_M_MAX``) and axes that do not point down.

    The quaternion (w, x, y, z) is from CAMERA_IMAGE_CAPTURED; it turns the forward axis into the optical
    axis. A quaternion that is not a rotation (zeros, NaN) means straight down.

    Examples
    --------
    >>> half = math.radians(-45.0) / 2.0
    >>> east_m, north_m = ground_offset((math.cos(half), 0.0, math.sin(half), 0.0), 30.0)
    >>> round(east_m, 9), round(north_m, 9)
    (0.0, 30.0)
    >>> ground_offset((1.0, 0.0, 0.0, 0.0), 30.0)
    (10000000.0, 10000000.0)
    """
    w, x, y, z = quaternion
    if not abs(w * w + x * x + y * y + z * z - 1.0) < _UNIT:
        return 0.0, 0.0
    north, east, down = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    if down > 0.0 and math.hypot(north, east) < _STRAIGHT:
        return 0.0, 0.0
    height_m = max(0.0, height_m)
    if not (down > 0.0 and down * _FARTHEST_M > height_m * math.hypot(north, east)):
        return NOWHERE_M, NOWHERE_M
    return height_m * east / down, height_m * north / down


@dataclass(slots=True)
class ImageList:
    """Images that a flight's cameras take, in the order of capture; an image has `cells` cells."""

    cells: int
    _x: list[int] = field(default_factory=list)
    _y: list[int] = field(default_factory=list)
    _camera: list[int] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self._x)

    @property
    def is_exact(self) -> bool:
        """Whether all reading numbers are small enough for 32-bit floats to hold them exactly."""
        return len(self) * self.cells <= MOST_READINGS

    def add(self, ix: Sequence[int], iy: Sequence[int], camera: int) -> None:
        """Add images taken by the camera number `camera`; (ix, iy) are the cells at the image centres."""
        self._x += ix
        self._y += iy
        self._camera += [camera] * len(ix)

    def read(self, cameras: Sequence[Camera]) -> NDArray[np.float32]:
        """Take all images of the list; return the readings, float32[images * cells, fields], in list order.

        `cameras` are in the order of the camera numbers. A camera takes its images in list order.
        """
        x, y, by = (np.array(column, np.int64) for column in (self._x, self._y, self._camera))
        fields = len(cameras[0].options.fields)
        readings = np.empty((len(x), self.cells, fields), np.float32)
        for number, camera in enumerate(cameras):
            own = by == number
            readings[own] = camera.capture(x[own].tolist(), y[own].tolist())
        return readings.reshape(-1, fields)


class NumberingCamera:
    """A leaf camera that returns, in place of each value, the number of the reading within the flight.

    `ImageList.read` replaces the numbers by readings of an environment, so that a flight can be reused for
    several environments. Readings of cells outside the farm's `shape` are NaN. The cameras of a fleet share
    one image list, in which `number` identifies the camera.
    """

    def __init__(
        self, images: ImageList, number: int, shape: tuple[int, int], options: LeafCameraOptions
    ) -> None:
        self.options = options
        self._images = images
        self._number = number
        self._shape = shape

    def capture(self, ix: Sequence[int], iy: Sequence[int]) -> NDArray[np.float32]:
        """Take an image centred on each cell, and return numbers of readings; see `LeafCamera.capture`."""
        images = self._images
        first, fields = len(images) * images.cells, len(self.options.fields)
        images.add(ix, iy, self._number)
        dx, dy = footprint_offsets(self.options.footprint_cells)
        x, y = np.array(ix)[:, None] + dx, np.array(iy)[:, None] + dy
        numbers = np.arange(first, len(images) * images.cells, dtype=np.float32).reshape(x.shape)
        numbers[(x < 0) | (x >= self._shape[0]) | (y < 0) | (y >= self._shape[1])] = np.nan
        return np.repeat(numbers[:, :, None], fields, axis=2)
