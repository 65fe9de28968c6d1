"""Camera optics: ground sampling distance, footprint and top speed from sensor and lens."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import msgspec

from geo.reading import UnreadableError, misfit, read_toml
from geo.texts import unknown
from sensors.errors import CameraError

MOST_OVERLAP = 0.95
BLUR_PX = 1.0
"""Default limit of motion blur: the ground's movement in the image during an exposure (pixels)."""


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A frame camera that points straight down.

    Parameters
    ----------
    name : str
        Name in tables and errors.
    sensor_width_mm, sensor_height_mm : float
        Sides of the sensor area in use; usually the width is the longer side.
    focal_length_mm : float
        True focal length of the lens, not the 35 mm equivalent.
    image_width_px, image_height_px : int
        Width and height of an image.
    min_interval_s : float
        Shortest time between two images; 0 for no limit.
    shutter_s : float
        Exposure time, which causes motion blur.
    source : str
        Source of the numbers.

    Raises
    ------
    CameraError
        If a number is not finite or not above zero.

    Examples
    --------
    >>> camera = get_camera("sony-rx1r-ii")
    >>> round(100 * camera.gsd_m(60.0), 2), [round(side, 1) for side in camera.footprint_m(60.0)]
    (0.78, [61.5, 41.1])
    """

    name: str
    sensor_width_mm: float
    sensor_height_mm: float
    focal_length_mm: float
    image_width_px: int
    image_height_px: int
    min_interval_s: float = 0.0
    shutter_s: float = 0.001
    source: str = ""

    def __post_init__(self) -> None:
        for name in ("sensor_width_mm", "sensor_height_mm", "focal_length_mm", "shutter_s"):
            _check(self.name, name, getattr(self, name), above_zero=True)
        for name in ("image_width_px", "image_height_px"):
            _check(self.name, name, getattr(self, name), above_zero=True)
        _check(self.name, "min_interval_s", self.min_interval_s, above_zero=False)

    @property
    def pitch_mm(self) -> float:
        """Length of the longer side of a sensor pixel (mm)."""
        return max(self.sensor_width_mm / self.image_width_px, self.sensor_height_mm / self.image_height_px)

    def gsd_m(self, height_m: float) -> float:
        """Return the ground sampling distance, the side of a pixel (m) on flat ground `height_m` below."""
        return self.pitch_mm * height_m / self.focal_length_mm

    def height_m(self, gsd_m: float) -> float:
        """Return the height above the ground (m) that gives this ground sampling distance (m)."""
        return gsd_m * self.focal_length_mm / self.pitch_mm

    def footprint_m(self, height_m: float) -> tuple[float, float]:
        """Return the width and height (m) that an image covers on flat ground `height_m` below."""
        scale = height_m / self.focal_length_mm
        return self.sensor_width_mm * scale, self.sensor_height_mm * scale


@dataclass(frozen=True, slots=True)
class Imaging:
    """Images taken by a camera at a height above the ground, with an overlap.

    Parameters
    ----------
    camera : CameraModel
        The camera, which points straight down.
    height_m : float
        Height above the ground, metres.
    front_overlap, side_overlap : float
        Overlap of consecutive images of a row, and overlap of neighbouring rows, as a fraction 0..0.95.
    portrait : bool
        True if the width of an image lies along the flight direction, False if it lies across.
    blur_px : float
        Largest movement of the ground during an exposure, pixels.

    Raises
    ------
    CameraError
        If a number is out of its range.

    Examples
    --------
    >>> over = Imaging(get_camera("dji-p1-35"), 80.0, 0.8, 0.7)
    >>> round(over.across_m, 1), round(over.row_spacing_m, 1), round(over.image_distance_m, 1)
    (82.1, 24.6, 11.0)
    >>> round(over.top_speed_m_s, 1)
    10.0
    """

    camera: CameraModel
    height_m: float
    front_overlap: float
    side_overlap: float
    portrait: bool = False
    blur_px: float = BLUR_PX

    def __post_init__(self) -> None:
        _check(self.camera.name, "height_m", self.height_m, above_zero=True)
        _check(self.camera.name, "blur_px", self.blur_px, above_zero=True)
        for name in ("front_overlap", "side_overlap"):
            value = getattr(self, name)
            if not 0.0 <= value <= MOST_OVERLAP:
                raise CameraError(
                    f"camera {self.camera.name}: {name} {value:g} is out of range: give 0 to {MOST_OVERLAP:g}"
                )

    @property
    def gsd_m(self) -> float:
        """Ground sampling distance (m)."""
        return self.camera.gsd_m(self.height_m)

    @property
    def across_m(self) -> float:
        """Length (m) that an image covers on the ground across the flight direction."""
        return self.camera.footprint_m(self.height_m)[1 if self.portrait else 0]

    @property
    def along_m(self) -> float:
        """Length (m) that an image covers on the ground along the flight direction."""
        return self.camera.footprint_m(self.height_m)[0 if self.portrait else 1]

    @property
    def row_spacing_m(self) -> float:
        """Distance between neighbouring rows (m)."""
        return self.across_m * (1.0 - self.side_overlap)

    @property
    def image_distance_m(self) -> float:
        """Distance between consecutive images of a row (m)."""
        return self.along_m * (1.0 - self.front_overlap)

    @property
    def sure_along_m(self) -> float:
        """Length of ground (m) that an image still shows if shifted by `image_distance_m` either way."""
        return max(self.along_m - 2.0 * self.image_distance_m, 0.0)

    @property
    def interval_speed_m_s(self) -> float:
        """Largest ground speed (m/s) at which the camera can keep the distance between images."""
        interval = self.camera.min_interval_s
        return self.image_distance_m / interval if interval > 0.0 else math.inf

    @property
    def blur_speed_m_s(self) -> float:
        """Largest ground speed (m/s) at which motion blur is at most `blur_px` pixels."""
        return self.blur_px * self.gsd_m / self.camera.shutter_s

    @property
    def top_speed_m_s(self) -> float:
        """Largest ground speed (m/s) that satisfies both `interval_speed_m_s` and `blur_speed_m_s`."""
        return min(self.interval_speed_m_s, self.blur_speed_m_s)


def camera_names() -> tuple[str, ...]:
    """Return the sorted names of the built-in cameras.

    >>> "sentera-6x" in camera_names()
    True
    """
    return tuple(sorted(_table()))


def get_camera(name: str) -> CameraModel:
    """Return a built-in camera by name, or read a camera from a TOML file with the keys of `CameraModel`.

    Raise CameraError if no camera has this name, or the file is not a camera file.
    """
    if name.lower().endswith(".toml"):
        return read_camera(Path(name))
    table = _table()
    if name.lower() not in table:
        raise CameraError(unknown("camera", name, camera_names(), ", or give a file (.toml)"))
    return table[name.lower()]


def read_camera(path: Path) -> CameraModel:
    """Read a camera from a TOML file; without the key ``name``, the camera is named after the file."""
    where = f"camera file {path}"
    try:
        return _camera(path.stem, read_toml(path))
    except (UnreadableError, CameraError) as error:
        raise CameraError(f"{where}: {error}") from None
    except msgspec.ValidationError as error:
        raise CameraError(f"{where}: {misfit(error)}") from None


@cache
def _table() -> dict[str, CameraModel]:
    data = tomllib.loads(files("sensors.camera").joinpath("cameras.toml").read_text("utf-8"))
    return {name: _camera(name, values) for name, values in data.items()}


def _camera(name: str, values: dict[str, object]) -> CameraModel:
    known = CameraModel.__dataclass_fields__
    wrong = sorted(values.keys() - known.keys())
    if wrong:
        raise CameraError(unknown("key", wrong[0], known))
    return msgspec.convert({"name": name, **values}, CameraModel)


def _check(camera: str, name: str, value: float, *, above_zero: bool) -> None:
    value = math.inf if abs(value) > 1e300 else value  # A whole number can be too large for a float
    if not (math.isfinite(value) and (value > 0 if above_zero else value >= 0)):
        least = "above zero" if above_zero else "not below zero"
        raise CameraError(f"camera {camera}: {name} {value:g} must be a finite number {least}")
