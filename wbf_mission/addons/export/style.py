"""Places, colours, sizes and update rates shared by the exports."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from wbf_mission.addons.base.plots import CROP_COLOURS, LINE_COLOURS

OBSTACLE, FENCE, _LAND = "#b22222", "#e69f00", "#8c8c8c"
SHOWN_AGAIN = 100  # Approximate full rewrites of growing tracks and readings per run, for viewers that jump
TRACK_POINTS = 1000  # Maximum of a displayed track


def vehicle_size_m(farm: Farm) -> float:
    """Return the size of a vehicle's symbol (m), visible on a view of the whole farm."""
    return max(farm.width_cells, farm.height_cells) * farm.cell_size_m / 60


def vehicle_colour(system_id: int) -> str:
    """Return the colour of a vehicle, ``#rrggbb``."""
    return LINE_COLOURS[(system_id - 1) % len(LINE_COLOURS)]


def crop_colour(crop: str) -> str:
    """Return the colour of a crop; an unknown crop gets the colour of bare land."""
    return CROP_COLOURS.get(crop, _LAND)


def rgb(colour: str) -> tuple[int, int, int]:
    """Return the red, green and blue of ``#rrggbb``, 0 to 255.

    >>> rgb("#0072b2")
    (0, 114, 178)
    """
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def places_of(farm: Farm, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return points of the farm frame, float64[n, 2 or more], as latitude and longitude, float64[n, 2]."""
    return np.column_stack(farm.frame.to_wgs84(points_m[:, 0].copy(), points_m[:, 1].copy()))
