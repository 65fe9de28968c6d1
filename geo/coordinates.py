"""Coordinates of any system that PROJ knows, made longitudes and latitudes of WGS 84; without network."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pyproj
import pyproj.network

from geo.errors import FarmError

if TYPE_CHECKING:
    from numpy.typing import NDArray

EXAMPLE_CRS = "EPSG:32617"
_CODE = re.compile(
    r"(?:urn:ogc:def:crs:|https?://www\.opengis\.net/def/crs/)?"
    r"(EPSG|ESRI|IGNF|OGC)[:/]+(?:[\d.]*[:/])?([A-Za-z0-9_]+)",
    re.IGNORECASE,
)
_WGS84 = re.compile(r"(OGC:CRS84|EPSG:4326)|WGS ?84", re.IGNORECASE)
_TOLD_FROM_M = 1.5


class Coordinates:
    """A coordinate reference system, whose axes are x and y (east, north; longitude, latitude).

    Parameters
    ----------
    name : str
        A code such as ``EPSG:32617``, a URN of one, or the text of a .prj file (WKT).

    Raises
    ------
    FarmError
        If there is no such system, or it has no way to WGS 84.
    """

    def __init__(self, name: str) -> None:
        pyproj.network.set_network_enabled(False)  # type: ignore[attr-defined]
        try:
            crs = pyproj.CRS.from_user_input(name)
            self.name = crs.name
            self._accuracy_m = -1.0  # Of the last positions; not known
            self._transformer = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
        except pyproj.exceptions.ProjError as error:
            problem = " ".join(str(error).split())[:120]
            raise FarmError(f"coordinate system {name[:60]!r} cannot be used: {problem}") from None

    def to_wgs84(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return float64[n, 2] longitude, latitude of x, y; not finite where there is no such place."""
        positions = np.column_stack(self._transformer.transform(xy[:, 0], xy[:, 1]))
        self._accuracy_m = self._transformer.get_last_used_operation().accuracy
        return positions

    def accuracy_note(self) -> str:
        """Return how exact the last positions are, if that is worse than a field's border is known."""
        if self._accuracy_m <= _TOLD_FROM_M:
            return ""
        return f"{self.name} is converted to WGS 84 to within {self._accuracy_m:g} m"


@lru_cache(maxsize=32)
def coordinates_of(name: str) -> Coordinates | None:
    """Return the coordinates of a code; None for longitudes and latitudes of WGS 84 themselves.

    >>> coordinates_of("urn:ogc:def:crs:OGC:1.3:CRS84"), coordinates_of("EPSG:32617").name
    (None, 'WGS 84 / UTM zone 17N')
    """
    found = _CODE.fullmatch(name.strip())
    code = f"{found[1]}:{found[2]}".upper() if found else name.strip()
    if _WGS84.fullmatch(code):
        return None
    if found is None:
        raise FarmError(f"{name[:60]!r} is no code of a coordinate system; give one such as {EXAMPLE_CRS}")
    return Coordinates(code)


def member_crs(holder: dict[str, Any], where: str, default: Coordinates | None) -> Coordinates | None:
    """Return what the member "crs" says, which GeoJSON of 2008 had and RFC 7946 has not; else the default."""
    crs = holder.get("crs")
    if crs is None:
        return default
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str):
        raise FarmError(
            f'{where}: member "crs" names no coordinate system; give {{"type": "name", "properties": '
            f'{{"name": "{EXAMPLE_CRS}"}}}}, or leave it out for WGS 84'
        )
    try:
        return coordinates_of(name)
    except FarmError as error:
        raise FarmError(f'{where}: member "crs": {error}') from None
