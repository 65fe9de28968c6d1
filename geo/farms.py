"""Built-in farms: the farms of the Waterberry Farms benchmark, placed near Plant City, Florida.

Sizes and patches are as in the benchmark, in feet; a cell is one square foot. The table gives the position of
a farm's south-west corner. The x axis points east (rotation 0), and the ground is 30 m above mean sea level.

================  ==========  ===========  =====================
farm              latitude    longitude    size in cells
================  ==========  ===========  =====================
waterberry        28.0500     -82.1500     6000 x 5000
miniberry-100     28.0400     -82.1500     100 x 100
miniberry-30      28.0380     -82.1500     30 x 30
miniberry-10      28.0370     -82.1500     10 x 10
================  ==========  ===========  =====================

Source: L. Boloni et al., the Waterberry Farms benchmark for multi-robot information gathering.

A farm is made at its first use, so listing the names imports neither numpy nor shapely.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from geo.errors import FarmError
from geo.texts import FOOT_M, unknown

if TYPE_CHECKING:
    from geo.farm import Farm

_Corners = list[tuple[float, float]]
_Patches = list[tuple[str, str, str, _Corners]]  # In painting order: name, crop, owner, corners in feet.

_GROUND_ALTITUDE_M = 30.0
_LONGITUDE_DEG = -82.1500
_OWNER = "owner"


def _box(left: float, bottom: float, right: float, top: float) -> _Corners:
    return [(left, bottom), (right, bottom), (right, top), (left, top)]


def _arc(x: float, y: float, radius: float, steps: range) -> _Corners:
    """Return the corners of an arc; `steps` are multiples of 15 degrees, clockwise from north."""
    angles = [math.pi * step / 12 for step in steps]
    return [(x + radius * math.sin(angle), y + radius * math.cos(angle)) for angle in angles]


def _miniberry(size: int) -> _Patches:
    return [
        ("strawberries", "strawberry", _OWNER, _box(0, 0, size, size / 2)),
        ("tomatoes", "tomato", _OWNER, _box(0, size / 2, size, size)),
    ]


_WATERBERRY: _Patches = [
    ("strawberries", "strawberry", _OWNER, [(1000, 1000), (4000, 1000), (3000, 4000), (1000, 4000)]),
    ("tomatoes", "tomato", _OWNER, [(4000, 1000), (5000, 1000), (5000, 4000), (3000, 4000)]),
    ("pond", "pond", _OWNER, _arc(2000, 2000, 200, range(24))),
    ("wetland", "wetland", _OWNER, _arc(4000, 4000, 500, range(6, 19))),
    ("N1-strawberries", "strawberry", "N1", _box(0, 0, 6000, 1000)),
    ("N2-strawberries", "strawberry", "N2", _box(5000, 1000, 6000, 4000)),
    ("N3-tomatoes", "tomato", "N3", _box(0, 4000, 6000, 5000)),
    ("N4-tomatoes", "tomato", "N4", _box(0, 1000, 1000, 4000)),
]

# A farm's latitude; width and height in cells; index of home's cell, equal in x and y; patches
_FARMS: dict[str, tuple[float, tuple[int, int], int, _Patches]] = {
    "miniberry-10": (28.0370, (10, 10), 0, _miniberry(10)),
    "miniberry-30": (28.0380, (30, 30), 0, _miniberry(30)),
    "miniberry-100": (28.0400, (100, 100), 0, _miniberry(100)),
    "waterberry": (28.0500, (6000, 5000), 1000, _WATERBERRY),
}


def farm_names() -> tuple[str, ...]:
    """Return the names of the built-in farms.

    Examples
    --------
    >>> farm_names()
    ('miniberry-10', 'miniberry-30', 'miniberry-100', 'waterberry')
    """
    return tuple(_FARMS)


def get_farm(
    name_or_path: str | Path, *, crop: str | None = None, crs: str | None = None, repair: bool = False
) -> Farm:
    """Return a built-in farm by name (in any case), or read a farm file by path.

    The other parameters are as in `geo.load_farm`; a built-in farm ignores them. Raise FarmError if there is
    no farm of that name, or the file cannot be used.

    Examples
    --------
    >>> farm = get_farm("Miniberry-30")
    >>> farm.grid().shape, farm.owner_cells
    ((30, 30), 900)
    """
    from geo.farm_file import farm_suffixes, load_farm, split_layer

    text = str(name_or_path)
    if text.lower() in _FARMS:
        return _built_in(text.lower())
    if split_layer(text)[0].suffix.lower() in farm_suffixes():
        return load_farm(text, crop=crop, crs=crs, repair=repair)
    kinds = ", ".join(farm_suffixes())
    raise FarmError(unknown("farm", text, _FARMS, f", or give a file ({kinds})"))


@lru_cache(maxsize=8)
def _built_in(name: str) -> Farm:
    import shapely

    from geo.farm import Farm, Patch
    from geo.frame import LocalFrame
    from geo.grid import Crop

    latitude_deg, (width, height), home, patches = _FARMS[name]
    made = []
    for patch, crop, owner, corners in patches:
        # C libraries differ in the last bits of a sine; rounding makes the corners equal on every machine.
        corners_m = [(round(x, 6) * FOOT_M, round(y, 6) * FOOT_M) for x, y in corners]
        made.append(Patch(patch, Crop(crop), owner, shapely.Polygon(corners_m)))
    return Farm(
        name=name,
        frame=LocalFrame(latitude_deg, _LONGITUDE_DEG, _GROUND_ALTITUDE_M),
        width_cells=width,
        height_cells=height,
        patches=tuple(made),
        owner=_OWNER,
        home_m=((home + 0.5) * FOOT_M, (home + 0.5) * FOOT_M),
    )
