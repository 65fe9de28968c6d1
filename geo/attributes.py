"""Property names of farm files, and their names and spellings in files of other programs."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

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
"""Each property of a farm file with its names in other files, in order of preference; case is ignored."""
LATITUDES = ("latitude", "lat", "latitude_deg", "lat_deg", "gps_latitude", "gpslatitude", "gps_lat")
LONGITUDES = (
    *("longitude", "lon", "lng", "long", "longitude_deg", "lon_deg", "gps_longitude", "gpslongitude"),
    *("gps_lon", "gps_lng", "gps_long"),
)
"""Names of longitude columns in tables, as `column_name` returns them; `LATITUDES` has those of latitude."""
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
_MAX_TEXT = 200  # The limit of `geo.features.text_member`


def column_name(text: str) -> tuple[str, str]:
    """Return a table column's name as one lower-case word, and its unit.

    >>> column_name(" Rel Alt (m)"), column_name("Lat")
    (('rel_alt', 'm'), ('lat', ''))
    """
    found = re.fullmatch(r"([^(\[]*)[(\[]?([^)\]]*)[)\]]?", text.strip().lower())
    name, unit = (found[1], found[2].strip()) if found else (text.strip().lower(), "")
    return re.sub(r"[\s-]+", "_", name.strip()), unit


def kind_of(text: object) -> str:
    """Return the kind of feature named by a property, a layer or a point; empty if `text` names none.

    >>> [kind_of(text) for text in ("No-fly zones", "Rally 2", "obstacle", "maize", None)]
    ['no-fly', 'rally', 'obstacle', '', '']
    """
    if not isinstance(text, str):
        return ""
    plain = re.sub(r"[-_ ]?\d+$", "", text.strip().lower())
    return next((kind for kind, pattern in _KINDS.items() if re.fullmatch(pattern, plain)), "")


def farm_properties(properties: Mapping[str, Any], *, literal: bool) -> dict[str, Any]:
    """Return the non-empty properties of a feature, renamed as in farm files.

    Values are converted, because other formats have no booleans and write numbers as text. `literal`:
    properties that already have a farm file's name keep their values.

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
        except (TypeError, ValueError):
            return value
    text = " ".join("".join(char if char.isprintable() else " " for char in str(value)).split())
    return crop_of(text) if key == "crop" else text[:_MAX_TEXT]


def crop_of(text: str) -> str:
    """Return a valid crop name for a crop's name in another program.

    >>> crop_of("Mais/Silomais"), crop_of("115")
    ('mais silomais', 'crop 115')
    """
    plain = " ".join(re.sub(r"[^\w -]", " ", text.lower()).split())
    return (plain if re.match(r"[^\W\d_]", plain) else f"crop {plain}")[:40].strip()
