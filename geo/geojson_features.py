"""What a farm file holds: GeoJSON features whose members are checked, before they are placed on a grid."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from geo.decoding import not_json
from geo.errors import FarmError
from geo.farm import Crop
from geo.reading import UnreadableError, read_text

__all__ = [
    "MAX_VERTICES",
    "Feature",
    "check_crs",
    "number_member",
    "position_of",
    "read_document",
    "read_feature",
    "shortened",
    "text_member",
]

MAX_FILE_BYTES = 32 * 2**20
MAX_VERTICES = 100_000
MAX_LATITUDE_DEG = 75.0
_NAMES = {crop.name.lower(): crop for crop in Crop}
_WGS84 = re.compile(
    r"(urn:ogc:def:crs:|https?://www\.opengis\.net/def/crs/)?"
    r"(OGC[:/]+(1\.3[:/])?CRS84|EPSG[:/]+(0[:/])?4326|WGS ?84)",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class Feature:
    """A feature as the file has it: rings of float64[n, 2] longitude, latitude."""

    where: str
    name: str
    crop: Crop
    owner: str
    obstacle: bool
    rings: tuple[np.ndarray[Any, np.dtype[np.float64]], ...]


def read_document(path: Path) -> dict[str, Any]:
    """Return the members of a feature collection; FarmError if the file holds none."""
    try:
        text = read_text(path, MAX_FILE_BYTES)
        document = msgspec.json.decode(text)
    except UnreadableError as error:
        msg = f"cannot be read: {error}"
        raise FarmError(msg) from None
    except RecursionError:
        msg = "is nested too deeply"
        raise FarmError(msg) from None
    except msgspec.DecodeError as error:
        msg = f"is not JSON ({not_json(error, text.encode())})"
        raise FarmError(msg) from None
    if not isinstance(document, dict) or document.get("type") != "FeatureCollection":
        msg = 'is not a GeoJSON "FeatureCollection"'
        raise FarmError(msg)
    return document


def check_crs(holder: dict[str, Any], where: str) -> None:
    """Refuse what GeoJSON of 2008 could say and RFC 7946 cannot: coordinates that are not WGS 84."""
    crs = holder.get("crs")
    if crs is None:
        return
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not (isinstance(name, str) and _WGS84.fullmatch(name.strip())):
        shown = shortened(name if isinstance(name, str) else crs)
        msg = (
            f'{where}: member "crs" is {shown!r}, but a farm file holds longitudes and latitudes of WGS 84: '
            "convert it (ogr2ogr -t_srs EPSG:4326)"
        )
        raise FarmError(msg)


def read_feature(entry: object, index: int) -> Feature:
    """Return a member of "features"; FarmError, naming it, if it is no patch and no obstacle."""
    where = f"feature {index + 1}"
    if not isinstance(entry, dict) or entry.get("type") != "Feature":
        msg = f'{where}: is not a GeoJSON "Feature"'
        raise FarmError(msg)
    properties = entry.get("properties")
    if not isinstance(properties, dict):
        msg = f'{where}: has no "properties" with crop and owner'
        raise FarmError(msg)
    name = text_member(properties, "name", f"patch {index}", where)
    where = f"feature {index + 1} ({name!r})"
    check_crs(entry, where)
    obstacle = properties.get("obstacle", False)
    if not isinstance(obstacle, bool):
        msg = f'{where}: property "obstacle" is not true or false'
        raise FarmError(msg)
    crop, owner = Crop.NONE, ""
    if not obstacle:
        for key in ("crop", "owner"):
            if properties.get(key) is None:
                msg = f'{where}: property "{key}" is missing'
                raise FarmError(msg)
        label = text_member(properties, "crop", "", where).lower()
        if label not in _NAMES:
            msg = f"{where}: unknown crop {label!r}; crops are {', '.join(_NAMES)}"
            raise FarmError(msg)
        crop, owner = _NAMES[label], text_member(properties, "owner", "", where)
    geometry = entry.get("geometry")
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if not isinstance(geometry, dict) or kind != "Polygon":
        kind = kind if isinstance(kind, str) else "nothing"
        advice = "; make each part a feature of its own" if kind == "MultiPolygon" else ""
        msg = f"{where}: geometry is {shortened(kind)!r}, not a Polygon{advice}"
        raise FarmError(msg)
    check_crs(geometry, where)
    rings = geometry.get("coordinates")
    if not isinstance(rings, list) or not rings or not rings[0]:
        msg = f"{where}: the polygon is empty"
        raise FarmError(msg)
    return Feature(where, name, crop, owner, obstacle, tuple(_ring(ring, where) for ring in rings))


def _ring(ring: object, where: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    if not isinstance(ring, list) or len(ring) < 4:
        msg = f"{where}: a ring has fewer than four positions"
        raise FarmError(msg)
    if len(ring) > MAX_VERTICES:
        msg = f"{where}: a ring of {len(ring)} positions is longer than {MAX_VERTICES}; simplify it"
        raise FarmError(msg)
    positions = np.array([position_of(position, where) for position in ring])
    if not np.array_equal(positions[0], positions[-1]):
        msg = f"{where}: a ring is not closed (its last position must repeat the first)"
        raise FarmError(msg)
    return positions


def position_of(position: object, where: str) -> tuple[float, float]:
    """Return longitude and latitude of a GeoJSON position."""
    if (
        not isinstance(position, list)
        or not 2 <= len(position) <= 4
        or not all(type(value) in (int, float) and abs(value) < 1e300 for value in position)
    ):
        msg = f"{where}: {shortened(position)} is not a position [longitude, latitude] of finite numbers"
        raise FarmError(msg)
    longitude_deg, latitude_deg = float(position[0]), float(position[1])
    if abs(latitude_deg) > 90.0:
        msg = f"{where}: latitude {latitude_deg:g} is outside -90..90; positions are [longitude, latitude]"
        raise FarmError(msg)
    if abs(longitude_deg) > 180.0:
        msg = f"{where}: longitude {longitude_deg:g} is outside -180..180"
        raise FarmError(msg)
    if abs(latitude_deg) > MAX_LATITUDE_DEG:
        msg = (
            f"{where}: nothing grows at latitude {latitude_deg:g}; "
            "are latitude and longitude swapped? positions are [longitude, latitude]"
        )
        raise FarmError(msg)
    return longitude_deg, latitude_deg


def text_member(members: dict[str, Any], key: str, default: str, where: str) -> str:
    """Return a member that is a short line of text, its default if it is missing, or raise FarmError."""
    value = members.get(key)
    if value is None:
        return default
    if not isinstance(value, str) or not value.strip() or len(value) > 200 or not value.isprintable():
        msg = f'{where}: "{key}" is {shortened(value)}, not a short line of text'
        raise FarmError(msg)
    return value.strip()


def number_member(document: dict[str, Any], key: str, default: float, low: float, high: float) -> float:
    """Return a member that is a number in low..high, its default if it is missing, or raise FarmError."""
    value = document.get(key)
    if value is None:
        return default
    if type(value) not in (int, float) or not low <= value <= high:
        msg = f'member "{key}": {shortened(value)} is not a number in {low:g}..{high:g}'
        raise FarmError(msg)
    return float(value)


def shortened(value: object) -> str:
    """Return a value as an error shows it."""
    text = value if isinstance(value, str) else repr(value)[:200]
    return text if len(text) <= 60 else text[:57] + "..."
