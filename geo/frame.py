"""The local frame of a farm, the coordinate systems of files, and attitudes as angles and quaternions."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pyproj
import pyproj.network
from pyproj import Transformer
from pyproj.enums import TransformDirection

from geo.errors import FarmError

if TYPE_CHECKING:
    from numpy.typing import NDArray

Values = TypeVar("Values", float, "NDArray[Any]")

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
    """A flat coordinate system in metres around an origin on the WGS84 ellipsoid.

    The projection is azimuthal equidistant on the ellipsoid (PROJ ``aeqd``): distances and azimuths from the
    origin are exact. Other distances within 2 km of the origin have a relative error below 2e-8.

    Parameters
    ----------
    latitude_deg, longitude_deg : float
        The origin, degrees of WGS84.
    altitude_m : float
        Height of the ground above mean sea level, metres.
    rotation_deg : float
        Direction of the x axis, degrees anticlockwise from east. With 0, x is east and y is north.

    Raises
    ------
    FarmError
        If a number is not finite or out of range.

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

    def to_wgs84(self, x_m: Values, y_m: Values) -> tuple[Values, Values]:
        """Convert x and y in the frame (m) to latitude and longitude (degrees); scalars or arrays."""
        if self._sin:
            x_m, y_m = x_m * self._cos - y_m * self._sin, x_m * self._sin + y_m * self._cos
        longitude_deg, latitude_deg = _projection(self.latitude_deg, self.longitude_deg).transform(
            x_m, y_m, direction=_INVERSE
        )
        return latitude_deg, _within_date_line(longitude_deg)

    def from_wgs84(self, latitude_deg: Values, longitude_deg: Values) -> tuple[Values, Values]:
        """Convert latitude and longitude (degrees) to x and y in the frame (m); scalars or arrays.

        For an impossible position, x and y are not finite.
        """
        east_m, north_m = _projection(self.latitude_deg, self.longitude_deg).transform(
            longitude_deg, latitude_deg
        )
        return self.from_east_north(east_m, north_m)

    def from_east_north(self, east: Values, north: Values) -> tuple[Values, Values]:
        """Convert a vector's east and north components to x and y components of the frame; scalars or arrays.

        Examples
        --------
        >>> x, y = LocalFrame(28.05, -82.15, rotation_deg=90.0).from_east_north(3.0, 4.0)
        >>> round(x, 9), round(y, 9)
        (4.0, -3.0)
        """
        if self._sin:
            # Components may be infinite or NaN; numpy would warn about such values.
            with np.errstate(invalid="ignore"):
                return east * self._cos + north * self._sin, north * self._cos - east * self._sin
        return east, north


def _within_date_line(longitude_deg: Any) -> Any:
    """Clip longitudes to -180..180: at the date line PROJ exceeds the limits by up to 6e-11 degrees."""
    if isinstance(longitude_deg, np.ndarray):
        return np.clip(longitude_deg, -180.0, 180.0)
    return min(max(longitude_deg, -180.0), 180.0)


EXAMPLE_CRS = "EPSG:32617"  # This is UTM zone 17N, in which the benchmark's farms lie
_CODE = re.compile(
    r"(?:urn:ogc:def:crs:|https?://www\.opengis\.net/def/crs/)?"
    r"(EPSG|ESRI|IGNF|OGC)[:/]+(?:[\d.]*[:/])?([A-Za-z0-9_]+)",
    re.IGNORECASE,
)
_WGS84 = re.compile(r"(OGC:CRS84|EPSG:4326)|WGS ?84", re.IGNORECASE)
# Borders drawn from aerial pictures have errors of this size; smaller conversion errors are not reported.
_BORDER_ACCURACY_M = 1.5


class Coordinates:
    """A coordinate reference system that PROJ knows; PROJ uses no network here.

    The first coordinate is x (east or longitude), the second is y (north or latitude).

    Parameters
    ----------
    name : str
        A code such as ``EPSG:32617``, the URN of a code, or the text of a .prj file (WKT).

    Raises
    ------
    FarmError
        If PROJ does not know the system, or cannot convert it to WGS 84.
    """

    def __init__(self, name: str) -> None:
        pyproj.network.set_network_enabled(False)  # type: ignore[attr-defined]
        try:
            crs = pyproj.CRS.from_user_input(name)
            self.name = crs.name
            self._accuracy_m = -1.0  # -1: the last conversion's accuracy is unknown
            self._transformer = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
        except pyproj.exceptions.ProjError as error:
            problem = " ".join(str(error).split())[:120]
            raise FarmError(f"coordinate system {name[:60]!r} cannot be used: {problem}") from None

    def to_wgs84(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert x, y to longitude, latitude, float64[n, 2]; not finite for points outside the system."""
        positions = np.column_stack(self._transformer.transform(xy[:, 0], xy[:, 1]))
        self._accuracy_m = self._transformer.get_last_used_operation().accuracy
        return positions

    def accuracy_note(self) -> str:
        """Return a note on the error of the last conversion; empty if the error is at most 1.5 m."""
        if self._accuracy_m <= _BORDER_ACCURACY_M:
            return ""
        return f"{self.name} is converted to WGS 84 with an error of up to {self._accuracy_m:g} m"


@lru_cache(maxsize=32)
def coordinates_of(name: str) -> Coordinates | None:
    """Return the coordinate system that a code names; None for WGS 84 longitude and latitude.

    >>> coordinates_of("urn:ogc:def:crs:OGC:1.3:CRS84"), coordinates_of("EPSG:32617").name
    (None, 'WGS 84 / UTM zone 17N')
    """
    found = _CODE.fullmatch(name.strip())
    code = f"{found[1]}:{found[2]}".upper() if found else name.strip()
    if _WGS84.fullmatch(code):
        return None
    if found is None:
        raise FarmError(f"{name[:60]!r} is not a coordinate system; give a code such as {EXAMPLE_CRS}")
    return Coordinates(code)


Quaternion = tuple[float, float, float, float]  # w, x, y, z


def quaternion_of(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Return the quaternion (w, x, y, z) of an attitude given by roll, pitch and yaw.

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
    """Return roll, pitch and yaw (rad) of a unit quaternion (w, x, y, z).

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
