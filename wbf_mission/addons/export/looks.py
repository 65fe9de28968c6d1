"""How other tools show a run: colours, sizes, and how often what grows is shown."""

from __future__ import annotations

from geo import Farm
from wbf_mission.pictures.plots import CROP_COLOURS, LINE_COLOURS

OBSTACLE, FENCE = "#b22222", "#e69f00"
_LAND = "#8c8c8c"
SHOWN_AGAIN = 100
"""What grows (tracks, readings) is shown as a whole about so often in a run: who jumps there sees it."""
TRACK_POINTS = 1000
"""Of a track that is shown, at most."""


def vehicle_size_m(farm: Farm) -> float:
    """Return how large vehicles are drawn, so that they are seen over a whole farm."""
    return max(farm.width_cells, farm.height_cells) * farm.cell_size_m / 60


def vehicle_colour(system_id: int) -> str:
    """Return the colour of a vehicle, ``#rrggbb``."""
    return LINE_COLOURS[(system_id - 1) % len(LINE_COLOURS)]


def crop_colour(crop: str) -> str:
    """Return the colour of a crop; others have that of bare land."""
    return CROP_COLOURS.get(crop, _LAND)


def rgb(colour: str) -> tuple[int, int, int]:
    """Return the parts of a colour.

    >>> rgb("#0072b2")
    (0, 114, 178)
    """
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
