"""The farms of the Waterberry Farms benchmark, placed in the strawberry country near Plant City, Florida.

Sizes and patches are the benchmark's, in feet: one cell is one square foot. Every farm has its south-west
corner at the origin below, its x axis to the east (rotation 0), and its ground 30 m above mean sea level.

================  ==========  ===========  =====================
farm              latitude    longitude    size in cells
================  ==========  ===========  =====================
waterberry        28.0500     -82.1500     6000 x 5000
miniberry-100     28.0400     -82.1500     100 x 100
miniberry-30      28.0380     -82.1500     30 x 30
miniberry-10      28.0370     -82.1500     10 x 10
================  ==========  ===========  =====================

Source: L. Boloni et al., the Waterberry Farms benchmark for multi-robot information gathering.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import shapely

from geo.built_in import farm_names
from geo.errors import FarmError
from geo.farm import Farm, Patch
from geo.farm_file import FARM_SUFFIXES, load_farm, split_layer
from geo.frame import LocalFrame
from geo.grid import Crop
from geo.units import FOOT_M

GROUND_ALTITUDE_M = 30.0
OWNER = "owner"
_MINIBERRY_LATITUDES = {10: 28.0370, 30: 28.0380, 100: 28.0400}
_LONGITUDE = -82.1500
_WATERBERRY_LATITUDE = 28.0500


def get_farm(
    name_or_path: str | Path, *, crop: str | None = None, crs: str | None = None, repair: bool = False
) -> Farm:
    """Return a built-in farm by name (in any case), or read a farm file by path.

    The other parameters are those of `geo.load_farm`; a built-in farm has no use for them.

    Raises
    ------
    FarmError
        If there is no farm of that name, or the file cannot be used.

    Examples
    --------
    >>> farm = get_farm("Miniberry-30")
    >>> farm.grid().shape, farm.owner_cells
    ((30, 30), 900)
    """
    text = str(name_or_path)
    if text.lower() in farm_names():
        return _built_in(text.lower())
    if split_layer(text)[0].suffix.lower() in FARM_SUFFIXES:
        return load_farm(text, crop=crop, crs=crs, repair=repair)
    kinds = ", ".join(FARM_SUFFIXES)
    msg = f"unknown farm {text!r}: choose one of {', '.join(farm_names())}, or give a file ({kinds})"
    raise FarmError(msg)


@lru_cache(maxsize=8)
def _built_in(name: str) -> Farm:
    return _waterberry() if name == "waterberry" else _miniberry(int(name.removeprefix("miniberry-")))


def _patch(name: str, crop: Crop, owner: str, corners_ft: Sequence[tuple[float, float]]) -> Patch:
    rounded = [(round(x, 6) * FOOT_M, round(y, 6) * FOOT_M) for x, y in corners_ft]
    return Patch(name, crop, owner, shapely.Polygon(rounded))


def _miniberry(size: int) -> Farm:
    half = size / 2
    return Farm(
        name=f"miniberry-{size}",
        frame=LocalFrame(_MINIBERRY_LATITUDES[size], _LONGITUDE, GROUND_ALTITUDE_M),
        width_cells=size,
        height_cells=size,
        patches=(
            _patch("strawberries", Crop.STRAWBERRY, OWNER, [(0, 0), (size, 0), (size, half), (0, half)]),
            _patch("tomatoes", Crop.TOMATO, OWNER, [(0, half), (size, half), (size, size), (0, size)]),
        ),
        owner=OWNER,
        home_m=(0.5 * FOOT_M, 0.5 * FOOT_M),
    )


def _arc(
    x: float, y: float, radius: float, steps: range, steps_per_half_turn: int = 12
) -> list[tuple[float, float]]:
    angles = [math.pi * step / steps_per_half_turn for step in steps]
    return [(x + radius * math.sin(angle), y + radius * math.cos(angle)) for angle in angles]


def _waterberry() -> Farm:
    strawberry, tomato = Crop.STRAWBERRY, Crop.TOMATO
    return Farm(
        name="waterberry",
        frame=LocalFrame(_WATERBERRY_LATITUDE, _LONGITUDE, GROUND_ALTITUDE_M),
        width_cells=6000,
        height_cells=5000,
        patches=(
            _patch(
                "strawberries", strawberry, OWNER, [(1000, 1000), (4000, 1000), (3000, 4000), (1000, 4000)]
            ),
            _patch("tomatoes", tomato, OWNER, [(4000, 1000), (5000, 1000), (5000, 4000), (3000, 4000)]),
            _patch("pond", Crop.POND, OWNER, _arc(2000, 2000, 200, range(24))),
            _patch("wetland", Crop.WETLAND, OWNER, _arc(4000, 4000, 500, range(6, 19))),
            _patch("N1-strawberries", strawberry, "N1", [(0, 0), (6000, 0), (6000, 1000), (0, 1000)]),
            _patch(
                "N2-strawberries", strawberry, "N2", [(5000, 1000), (6000, 1000), (6000, 4000), (5000, 4000)]
            ),
            _patch("N3-tomatoes", tomato, "N3", [(0, 4000), (6000, 4000), (6000, 5000), (0, 5000)]),
            _patch("N4-tomatoes", tomato, "N4", [(0, 1000), (1000, 1000), (1000, 4000), (0, 4000)]),
        ),
        owner=OWNER,
        home_m=(1000.5 * FOOT_M, 1000.5 * FOOT_M),
    )
