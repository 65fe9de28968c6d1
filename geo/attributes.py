"""What attributes of a feature mean, by the names that people give them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

ATTRIBUTES: Mapping[str, tuple[str, ...]] = {
    "name": ("name", "field_name", "fieldname", "field", "label", "title"),
    "crop": (
        "crop",
        "crop_name",
        "cropname",
        "crop_type",
        "croptype",
        "culture",
        "kultur",
        "cultura",
        "landuse",
    ),
    "owner": ("owner", "farmer", "grower"),
    "kind": ("kind", "role"),
    "obstacle": ("obstacle",),
    "no_fly": ("no_fly", "nofly", "no-fly"),
    "height_m": ("height_m", "height"),
    "margin_m": ("margin_m", "margin"),
}
"""The properties of a farm file, and the names, in any case, under which other files have them."""
LATITUDES = ("latitude", "lat", "latitude_deg", "lat_deg", "gps_latitude", "gpslatitude", "gps_lat")
LONGITUDES = (
    *("longitude", "lon", "lng", "long", "longitude_deg", "lon_deg", "gps_longitude", "gpslongitude"),
    *("gps_lon", "gps_lng", "gps_long"),
)
"""Columns of tables that hold positions, as `column_name` returns them."""
DEGREES = ("", "deg", "degrees", "°")
KNOWN = frozenset(name for names in ATTRIBUTES.values() for name in names)
_KINDS = {
    "no-fly": r"no[-_ ]?fly([-_ ]zones?)?",
    "obstacle": r"obstacles?",
    "home": r"home|launch",
    "rally": r"rally([-_ ]points?)?",
}
_WORDS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
_MAX_TEXT = 200


def column_name(text: str) -> tuple[str, str]:
    """Return the name of a table's column in one word of small letters, and its unit.

    >>> column_name(" Rel Alt (m)"), column_name("Lat")
    (('rel_alt', 'm'), ('lat', ''))
    """
    found = re.fullmatch(r"([^(\[]*)[(\[]?([^)\]]*)[)\]]?", text.strip().lower())
    name, unit = (found[1], found[2].strip()) if found else (text.strip().lower(), "")
    return re.sub(r"[\s-]+", "_", name.strip()), unit


def kind_of(text: object) -> str:
    """Return what a kind, the name of a layer or that of a point says: a kind, or nothing.

    >>> [kind_of(text) for text in ("No-fly zones", "Rally 2", "obstacle", "maize", None)]
    ['no-fly', 'rally', 'obstacle', '', '']
    """
    if not isinstance(text, str):
        return ""
    plain = re.sub(r"[-_ ]?\d+$", "", text.strip().lower())
    return next((kind for kind, pattern in _KINDS.items() if re.fullmatch(pattern, plain)), "")


def meant(properties: Mapping[str, Any], *, literal: bool) -> dict[str, Any]:
    """Return a feature's properties under the names of a farm file; what is empty is left out.

    With `literal` a property that has such a name already stays as it is. Values of all others are made
    what is wanted: other formats have no true and false, and texts for numbers.

    >>> meant({"CROP_NAME": "Maize (silage)", "Height": "6.5", "id": 4}, literal=True)
    {'crop': 'maize silage', 'height_m': 6.5}
    """
    lowered: dict[str, Any] = {}
    for key, value in properties.items():
        empty = value is None or value == "" or (isinstance(value, float) and math.isnan(value))
        if not empty:
            lowered.setdefault(key.lower(), value)
    found = {}
    for meaning, names in ATTRIBUTES.items():
        if literal and properties.get(meaning) is not None:
            found[meaning] = properties[meaning]
            continue
        value = next((lowered[name] for name in names if name in lowered), None)
        if value is not None:
            found[meaning] = _made(meaning, value)
    return found


def _made(meaning: str, value: Any) -> Any:
    if meaning in ("obstacle", "no_fly"):
        return _WORDS.get(str(value).strip().lower().removesuffix(".0"), value)
    if meaning in ("height_m", "margin_m"):
        try:
            return float(value)
        except (TypeError, ValueError):
            return value
    text = " ".join("".join(char if char.isprintable() else " " for char in str(value)).split())
    return crop_of(text) if meaning == "crop" else text[:_MAX_TEXT]


def crop_of(text: str) -> str:
    """Return the name of a crop that a text of another program becomes.

    >>> crop_of("Mais/Silomais"), crop_of("115")
    ('mais silomais', 'crop 115')
    """
    plain = " ".join(re.sub(r"[^\w -]", " ", text.lower()).split())
    return (plain if re.match(r"[^\W\d_]", plain) else f"crop {plain}")[:40].strip()
