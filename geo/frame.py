"""The local frame of a farm and its georeference; attitudes as angles and as quaternions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from pyproj import Transformer
from pyproj.enums import TransformDirection

from geo.errors import FarmError

if TYPE_CHECKING:
    from numpy.typing import NDArray

_INVERSE = TransformDirection.INVERSE


@lru_cache(maxsize=256)
def _projection(latitude_deg: float, longitude_deg: float) -> Transformer:
    """Return the transformer from (longitude, latitude) in degrees to (east, north) in metres."""
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        f"+step +proj=aeqd +ellps=WGS84 +lat_0={latitude_deg!r} +lon_0={longitude_deg!r}"
    )


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """A plane of metres about an origin on the WGS84 ellipsoid.

    The projection is azimuthal equidistant on the ellipsoid (PROJ ``aeqd``): distances and azimuths from the
    origin are those of the geodesic. Within 2 km of the origin other distances are true to 2e-8.

    Parameters
    ----------
    latitude_deg, longitude_deg : float
        The origin, degrees of WGS84.
    altitude_m : float
        Height of the ground above mean sea level, metres.
    rotation_deg : float
        Direction of the x axis, degrees anticlockwise from east. With 0 the frame is east, north.

    Raises
    ------
    FarmError
        If a number is not finite, or the origin is no position on the globe.

    Examples
    --------
    >>> frame = LocalFrame(28.05, -82.15)
    >>> latitude_deg, longitude_deg = frame.to_wgs84(100.0, 0.0)
    >>> round(latitude_deg, 7), round(longitude_deg, 7)
    (28.05, -82.1489829)
    >>> x_m, y_m = frame.from_wgs84(latitude_deg, longitude_deg)
    >>> round(x_m, 6), round(abs(y_m), 5)
    (100.0, 0.0)
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0
    rotation_deg: float = 0.0
    _cos: float = field(init=False, repr=False, compare=False, default=1.0)
    _sin: float = field(init=False, repr=False, compare=False, default=0.0)

    def __post_init__(self) -> None:
        for name, limit in (
            ("latitude_deg", 90.0),
            ("longitude_deg", 180.0),
            ("altitude_m", 10_000.0),
            ("rotation_deg", 360.0),
        ):
            value = float(getattr(self, name))
            if not (math.isfinite(value) and abs(value) <= limit):
                raise FarmError(f"local frame: {name} {value} is outside -{limit:g}..{limit:g}")
            object.__setattr__(self, name, value)
        if self.rotation_deg:
            object.__setattr__(self, "_cos", math.cos(math.radians(self.rotation_deg)))
            object.__setattr__(self, "_sin", math.sin(math.radians(self.rotation_deg)))

    @overload
    def to_wgs84(self, x_m: float, y_m: float) -> tuple[float, float]: ...

    @overload
    def to_wgs84(self, x_m: NDArray[Any], y_m: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]: ...

    def to_wgs84(self, x_m: Any, y_m: Any) -> tuple[Any, Any]:
        """Return latitude and longitude, degrees, of points of the frame, metres (scalars or arrays)."""
        if self._sin:
            x_m, y_m = x_m * self._cos - y_m * self._sin, x_m * self._sin + y_m * self._cos
        longitude_deg, latitude_deg = _projection(self.latitude_deg, self.longitude_deg).transform(
            x_m, y_m, direction=_INVERSE
        )
        return latitude_deg, _within_date_line(longitude_deg)

    @overload
    def from_wgs84(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]: ...

    @overload
    def from_wgs84(
        self, latitude_deg: NDArray[Any], longitude_deg: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[Any]]: ...

    def from_wgs84(self, latitude_deg: Any, longitude_deg: Any) -> tuple[Any, Any]:
        """Return x and y, metres, of positions in degrees (scalars or arrays).

        They are not finite where there is no such position.
        """
        east_m, north_m = _projection(self.latitude_deg, self.longitude_deg).transform(
            longitude_deg, latitude_deg
        )
        return self.from_east_north(east_m, north_m)

    @overload
    def from_east_north(self, east: float, north: float) -> tuple[float, float]: ...

    @overload
    def from_east_north(
        self, east: NDArray[Any], north: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[Any]]: ...

    def from_east_north(self, east: Any, north: Any) -> tuple[Any, Any]:
        """Return the parts along x and y of directions or velocities about the origin (scalars or arrays).

        Examples
        --------
        >>> x, y = LocalFrame(28.05, -82.15, rotation_deg=90.0).from_east_north(3.0, 4.0)
        >>> round(x, 9), round(y, 9)
        (4.0, -3.0)
        """
        if self._sin:
            # What is not finite stays so.
            with np.errstate(invalid="ignore"):
                return east * self._cos + north * self._sin, north * self._cos - east * self._sin
        return east, north


def _within_date_line(longitude_deg: Any) -> Any:
    """Return longitudes from -180 to 180: PROJ leaves those of the date line up to 6e-11 degrees beyond."""
    if isinstance(longitude_deg, np.ndarray):
        return np.clip(longitude_deg, -180.0, 180.0)
    return min(max(longitude_deg, -180.0), 180.0)


Quaternion = tuple[float, float, float, float]


def quaternion_of(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Return the quaternion (w, x, y, z) of an attitude.

    Examples
    --------
    >>> quaternion_of(0.0, 0.0, math.pi)[3]
    1.0
    """
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def angles_of(quaternion: Sequence[float]) -> tuple[float, float, float]:
    """Return roll, pitch and yaw (rad) of a quaternion (w, x, y, z) of length 1.

    Examples
    --------
    >>> [round(angle, 9) for angle in angles_of(quaternion_of(0.3, -0.2, 2.0))]
    [0.3, -0.2, 2.0]
    """
    w, x, y, z = quaternion
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0)),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )
