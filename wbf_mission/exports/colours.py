"""The colours in which other tools show a run."""

from __future__ import annotations

from wbf_mission.pictures.plots import CROP_COLOURS, LINE_COLOURS

OBSTACLE, FENCE = "#b22222", "#e69f00"
_LAND = "#8c8c8c"


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
