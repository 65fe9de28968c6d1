"""Checked features of a farm file (patches, obstacles, home, rally points), and names of their properties."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from geo.errors import FarmError
from geo.frame import Coordinates
from geo.grid import Crop, is_crop_name
from geo.texts import is_number

if TYPE_CHECKING:
    from numpy.typing import NDArray

# These limits protect against hostile files; a usual farm has tens of features and thousands of vertices.
MAX_FEATURES = 10_000
MAX_VERTICES = 100_000
MAX_LATITUDE_DEG = 75.0  # Crops do not grow at higher latitudes
DEFAULT_CROP = "crop"
DEFAULT_OWNER = "owner"

ATTRIBUTES: Mapping[str, tuple[str, ...]] = {
    "name": ("name", "field_name", "fieldname", "field", "label", "title"),
    "crop": (
        *("crop", "crop_name", "cropname", "crop_type", "croptype"),
        *("culture", "kultur", "cultura", "landuse"),
    ),
    "owner": ("owner", "farmer", "grower"),
    "kind": ("kind", "role"),
    "obstacle": ("obstacle",),
    "no_fly": ("no_fly", "nofly", "no-fly"),
    "height_m": ("height_m", "height"),
    "margin_m": ("margin_m", "margin"),
}
"""Names of each property in files of other programs, the preferred name first; case does not matter."""
LATITUDES = ("latitude", "lat", "latitude_deg", "lat_deg", "gps_latitude", "gpslatitude", "gps_lat")
LONGITUDES = (
    *("longitude", "lon", "lng", "long", "longitude_deg", "lon_deg", "gps_longitude", "gpslongitude"),
    *("gps_lon", "gps_lng", "gps_long"),
)
"""Names of longitude columns as `column_name` returns them; `LATITUDES` has the names of latitude columns."""
DEGREES = ("", "deg", "degrees", "°")
"""Units of position columns."""
KNOWN = frozenset(name for names in ATTRIBUTES.values() for name in names)
_KINDS = {
    "no-fly": r"no[-_ ]?fly([-_ ]zones?)?",
    "obstacle": r"obstacles?",
    "home": r"home|launch",
    "rally": r"rally([-_ ]points?)?",
}
_WORDS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
_MAX_TEXT = 200  # Characters


def column_name(text: str) -> tuple[str, str]:
    """Split the heading of a table column into a name, as one lower-case word, and a unit.

    >>> column_name(" Rel Alt (m)"), column_name("Lat")
    (('rel_alt', 'm'), ('lat', ''))
    """
    found = re.fullmatch(r"([^(\[]*)[(\[]?([^)\]]*)[)\]]?", text.strip().lower())
    name, unit = (found[1], found[2].strip()) if found else (text.strip().lower(), "")
    return re.sub(r"[\s-]+", "_", name.strip()), unit


def kind_of(text: object) -> str:
    """Return the kind of feature that a text names, such as a layer's name; empty if it names no kind.

    >>> [kind_of(text) for text in ("No-fly zones", "Rally 2", "obstacle", "maize", None)]
    ['no-fly', 'rally', 'obstacle', '', '']
    """
    if not isinstance(text, str):
        return ""
    plain = re.sub(r"[-_ ]?\d+$", "", text.strip().lower())
    return next((kind for kind, pattern in _KINDS.items() if re.fullmatch(pattern, plain)), "")


def farm_properties(properties: Mapping[str, Any], *, literal: bool) -> dict[str, Any]:
    """Return the non-empty properties of a feature under the names that farm files use.

    Values are converted, because other formats have no booleans and write numbers as text. With `literal`, a
    property that already has the name used in farm files keeps its value.

    >>> farm_properties({"CROP_NAME": "Maize (silage)", "Height": "6.5", "id": 4}, literal=True)
    {'crop': 'maize silage', 'height_m': 6.5}
    """
    lowered: dict[str, Any] = {}
    for key, value in properties.items():
        empty = value is None or value == "" or (isinstance(value, float) and math.isnan(value))
        if not empty:
            lowered.setdefault(key.lower(), value)
    found = {}
    for key, names in ATTRIBUTES.items():
        if literal and properties.get(key) is not None:
            found[key] = properties[key]
            continue
        value = next((lowered[name] for name in names if name in lowered), None)
        if value is not None:
            found[key] = _converted(key, value)
    return found


def _converted(key: str, value: Any) -> Any:
    if key in ("obstacle", "no_fly"):
        return _WORDS.get(str(value).strip().lower().removesuffix(".0"), value)
    if key in ("height_m", "margin_m"):
        try:
            return float(value)
        except (TypeError, ValueError, OverflowError):
            return value
    return crop_of(str(value)) if key == "crop" else short_line(" ".join(str(value).split()))


def short_line(value: object, end: str = "") -> str:
    """Return a value as one printable line that ends in `end`, cut to 200 characters with `end` included."""
    text = str(value)
    if not text.isprintable():
        text = " ".join("".join(char if char.isprintable() else " " for char in text).split())
    return text.strip()[: _MAX_TEXT - len(end)].strip() + end


def crop_of(text: str) -> str:
    """Turn a crop's name from another program into a valid crop name.

    >>> crop_of("Mais/Silomais"), crop_of("115")
    ('mais silomais', 'crop 115')
    """
    plain = " ".join(re.sub(r"[^\w -]", " ", text.lower()).split())
    return (plain if re.match(r"[^\W\d_]", plain) else f"crop {plain}")[:40].strip()


@dataclass(frozen=True, slots=True)
class Entry:
    """A feature as read from a file, not yet checked."""

    number: int  # Number of the feature within its layer, from 1.
    properties: dict[str, Any]
    geometry: object  # GeoJSON geometry; None if the feature has no geometry.
    crs: Coordinates | None = None  # Coordinate system; None is WGS 84.
    layer: str = ""  # Names the layer at the beginning of messages.
    useless: str = ""  # Reason why the file's reader leaves the feature out.

    @property
    def where(self) -> str:
        """Name of the feature in messages."""
        return f"{self.layer}feature {self.number}"


@dataclass(slots=True)
class Document:
    """The content of a farm file."""

    members: dict[str, Any]
    entries: list[Entry]
    crs: Coordinates | None = None
    notes: list[str] = field(default_factory=list)  # Notes for the user on how the file was read


@dataclass(frozen=True, slots=True)
class Feature:
    """A patch or an obstacle; each of its rings is float64[n, 2] longitude, latitude."""

    where: str
    name: str
    crop: str | None  # None: the file gives no crop
    owner: str | None
    obstacle: bool
    height_m: float | None
    margin_m: float | None
    rings: tuple[NDArray[np.float64], ...]


@dataclass(frozen=True, slots=True)
class Place:
    """A home or rally point; `kind` is "home" or "rally"."""

    where: str
    kind: str
    position: tuple[float, float]


_WITHOUT = "without geometry"
_NO_AREA = {
    **dict.fromkeys(("Point", "MultiPoint"), "points that are neither home nor rally"),
    **dict.fromkeys(("LineString", "MultiLineString"), "lines"),
}
_AREAS = ("Polygon", "MultiPolygon")
GEOMETRIES = (*_NO_AREA, *_AREAS, "GeometryCollection")


def read_entry(entry: Entry, notes: list[str], *, repair: bool) -> list[Feature | Place] | str:
    """Return an entry's polygons or points, or a text with the reason to leave the entry out.

    If the feature cannot be read, raise FarmError with the feature's name. With `repair`, latitudes and
    longitudes in the wrong order are exchanged. Rings may still be open; `geo.farm_file` closes them.
    """
    if entry.useless or entry.geometry is None:
        return entry.useless or _WITHOUT
    properties = farm_properties(entry.properties, literal=True)
    geometry = entry.geometry if isinstance(entry.geometry, dict) else {}
    kind, called = kind_of(properties.get("kind")), properties.get("name")
    given = geometry.get("coordinates")
    points: Any = {"Point": [given], "MultiPoint": given}.get(str(geometry.get("type")))
    is_place = isinstance(points, list) and points and (kind or kind_of(called)) in ("home", "rally")
    if not is_place and (reason := _no_area(geometry)):
        bars = kind in ("obstacle", "no-fly") or True in map(properties.get, ("obstacle", "no_fly"))
        return "obstacles that are not polygons" if bars and reason != _WITHOUT else reason
    name = text_member(properties, "name", f"patch {entry.number}", entry.where)
    where = f"{entry.where} ({name!r})"
    if is_place:
        return [Place(where, kind or kind_of(called), position_of(at, where, entry.crs)) for at in points]
    obstacle, no_fly = (_flag(properties, key, kind, where) for key in ("obstacle", "no_fly"))
    obstacle = obstacle or no_fly
    height_m, margin_m = (
        number_member(properties, key, None, 0.0, 1000.0, f"{where}: property") if obstacle else None
        for key in ("height_m", "margin_m")
    )
    if no_fly and height_m is not None:
        raise FarmError(f'{where}: is a no-fly zone, which has no height; leave out "height_m" or "no_fly"')
    crop: str | None = str(Crop.NONE) if obstacle else None
    owner: str | None = "" if obstacle else None
    if not obstacle and "crop" in properties:
        crop = text_member(properties, "crop", "", where).lower()
        if not is_crop_name(crop):
            crop = crop_of(crop)
    if not obstacle and "owner" in properties:
        owner = text_member(properties, "owner", "", where)
    parts = _parts(geometry, where)
    found: list[Feature | Place] = []
    for number, part in enumerate(parts, 1):
        at, called = (
            (where, name) if len(parts) == 1 else (f"{where}, part {number}", short_line(name, f" {number}"))
        )
        rings = [_ring(ring, at, entry.crs) for ring in part]
        if repair and entry.crs is None and _only_swapped(rings):
            rings = [ring[:, ::-1].copy() for ring in rings]
            notes.append(f"{at}: latitude and longitude were swapped")
        for ring in rings:
            for longitude_deg, latitude_deg in ring.tolist():
                check_degrees(longitude_deg, latitude_deg, at)
        found.append(Feature(at, called, crop, owner, obstacle, height_m, margin_m, tuple(rings)))
    return found


def _flag(properties: dict[str, Any], key: str, kind: str, where: str) -> bool:
    value = properties.get(key, kind == key.replace("_", "-"))
    if not isinstance(value, bool):
        raise FarmError(f'{where}: property "{key}" is not true or false')
    return value


def _members(geometry: dict[str, Any]) -> list[dict[str, Any]] | None:
    """Return the geometries in a collection and its nested collections; None for any other geometry."""
    found, left = [], [geometry]
    while left:
        member = left.pop()
        inner = member.get("geometries") if isinstance(member, dict) else None
        if isinstance(inner, list) and member.get("type") == "GeometryCollection":
            left.extend(reversed(inner))
        elif member is geometry:
            return None
        else:
            found.append(member if isinstance(member, dict) else {})
    return found


def _no_area(geometry: dict[str, Any]) -> str:
    """Return the reason to leave out a geometry without area; empty if it has an area or is invalid."""
    inner = _members(geometry)
    if inner is not None:
        reasons = [_NO_AREA.get(str(member.get("type")), "") for member in inner]
        return next(iter(reasons), _WITHOUT) if all(reasons) else ""
    if geometry.get("coordinates") == [] and geometry.get("type") in (*_NO_AREA, *_AREAS):
        return _WITHOUT
    return _NO_AREA.get(str(geometry.get("type")), "")


def _parts(geometry: dict[str, Any], where: str) -> list[list[Any]]:
    """Return the coordinates of each polygon of a geometry; points and lines of a collection are left out."""
    kind, inner = geometry.get("type"), _members(geometry)
    parts: list[Any]
    if inner is not None:
        parts = [part for member in inner if not _no_area(member) for part in _parts(member, where)]
    elif kind == "MultiPolygon":
        given = geometry.get("coordinates")
        parts = given if isinstance(given, list) else []
    elif kind == "Polygon":
        parts = [geometry.get("coordinates")]
    else:
        found = kind if isinstance(kind, str) else "nothing"
        raise FarmError(f"{where}: geometry is {shortened(found)!r}, not a Polygon or MultiPolygon")
    if not parts or not all(isinstance(part, list) and part and part[0] for part in parts):
        raise FarmError(f"{where}: the polygon is empty")
    return parts


def _ring(ring: object, where: str, crs: Coordinates | None) -> NDArray[np.float64]:
    if not isinstance(ring, list) or not ring:
        raise FarmError(f"{where}: a ring is not a list of positions")
    if len(ring) > MAX_VERTICES:
        msg = f"{where}: a ring of {len(ring)} positions is longer than {MAX_VERTICES}; simplify it"
        raise FarmError(msg)
    positions = _in_degrees(np.array([_numbers(position, where) for position in ring]), where, crs)
    if len(positions) < 3 + np.array_equal(positions[0], positions[-1]):
        raise FarmError(f"{where}: a ring has fewer than three corners")
    return positions


def _only_swapped(rings: list[NDArray[np.float64]]) -> bool:
    """Return whether the positions are valid only with latitude and longitude exchanged."""
    first, second = np.abs(np.concatenate(rings)).T
    return bool((second > MAX_LATITUDE_DEG).any() and (first <= MAX_LATITUDE_DEG).all())


def position_of(position: object, where: str, crs: Coordinates | None = None) -> tuple[float, float]:
    """Return longitude and latitude of a GeoJSON position; raise FarmError if `position` is invalid."""
    longitude_deg, latitude_deg = _in_degrees(np.array([_numbers(position, where)]), where, crs)[0].tolist()
    check_degrees(longitude_deg, latitude_deg, where)
    return longitude_deg, latitude_deg


def _numbers(position: object, where: str) -> tuple[float, float]:
    if not isinstance(position, list) or not 2 <= len(position) <= 4 or not all(map(is_number, position)):
        msg = f"{where}: {shortened(position)} is not a position [longitude, latitude] of finite numbers"
        raise FarmError(msg)
    return float(position[0]), float(position[1])


def _in_degrees(xy: NDArray[np.float64], where: str, crs: Coordinates | None) -> NDArray[np.float64]:
    if crs is None:
        return xy
    positions = crs.to_wgs84(xy)
    lost = ~np.isfinite(positions).all(axis=1)
    if lost.any():
        x, y = xy[lost][0].tolist()
        raise FarmError(f"{where}: [{x:g}, {y:g}] is not a place in {crs.name}; check its coordinate system")
    return positions


def check_degrees(longitude_deg: float, latitude_deg: float, where: str) -> None:
    """Raise FarmError if degrees are out of range, or the latitude is too high for crops."""
    if abs(latitude_deg) > 90.0:
        msg = f"{where}: latitude {latitude_deg:g} is outside -90..90; positions are [longitude, latitude]"
        raise FarmError(msg + (" in degrees, or need --farm-crs" if abs(latitude_deg) > 360.0 else ""))
    if abs(longitude_deg) > 180.0:
        msg = f"{where}: longitude {longitude_deg:.10g} is outside -180..180"
        if abs(longitude_deg) <= 360.0:  # Some GIS programs count on across the date line
            msg += f"; write it as {longitude_deg - math.copysign(360.0, longitude_deg):.10g}"
        raise FarmError(msg)
    if abs(latitude_deg) > MAX_LATITUDE_DEG:
        raise FarmError(
            f"{where}: nothing grows at latitude {latitude_deg:g}; "
            "are latitude and longitude swapped? positions are [longitude, latitude]"
        )


def text_member(members: dict[str, Any], key: str, default: str, where: str) -> str:
    """Return the member `key` or else `default`, as `short_line`; raise FarmError if it holds no text."""
    value = members.get(key)
    text = short_line(default if value is None else value)
    if isinstance(value, bool | list | dict) or not text:
        raise FarmError(f'{where}: "{key}" is {shortened(value)}, not a short line of text')
    return text


T = TypeVar("T", float, None)


def number_member(
    members: dict[str, Any], key: str, default: T, low: float, high: float, what: str = "member"
) -> float | T:
    """Return the member `key`, a number in low..high, or else `default`; raise FarmError for other values."""
    value = members.get(key)
    if value is None:
        return default
    if type(value) not in (int, float) or not low <= value <= high:
        raise FarmError(f'{what} "{key}": {shortened(repr(value))} is not a number in {low:g}..{high:g}')
    return float(value)


def shortened(value: object) -> str:
    """Return a value as text of at most 60 characters, for the text of an error."""
    text = value if isinstance(value, str) and value.strip() else repr(value)[:200]
    return text if len(text) <= 60 else text[:57] + "..."
