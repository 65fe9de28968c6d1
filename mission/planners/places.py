"""Random places of an area."""

from __future__ import annotations

import math

import numpy as np
import shapely

from mission.errors import PlanningError
from mission.planners.path import Area, Points

_ATTEMPTS = 1000


def draw_places(area: Area, count: int, rng: np.random.Generator) -> Points:
    """Return one or more uniformly distributed positions of the area, about `count`, drawn from its bounds.

    The rejected draws are part of the stream, so the positions do not depend on how many are asked for at
    once.

    Parameters
    ----------
    area : shapely Polygon or MultiPolygon
        In metres.
    count : int
        How many are wanted.

    Returns
    -------
    float64[n, 2]
        Metres.

    Raises
    ------
    PlanningError
        If hardly any position of the area's bounds lies in it.
    """
    x_min, y_min, x_max, y_max = area.bounds
    share = area.area / ((x_max - x_min) * (y_max - y_min))
    size = math.ceil(min(1.1 * count / share + 16, 1_000_000))
    shapely.prepare(area)
    for _ in range(_ATTEMPTS):
        draws = np.array((x_min, y_min)) + rng.random((size, 2)) * np.array((x_max - x_min, y_max - y_min))
        kept: Points = draws[shapely.contains_xy(area, draws[:, 0], draws[:, 1])]
        if len(kept):
            return kept
    msg = "the area is too thin to draw places in it; use a smaller footprint or a wider area"
    raise PlanningError(msg)
