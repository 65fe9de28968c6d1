"""The paper's robot in cells: an independent statement of its motion rule."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


def ideal_positions(
    waypoints: ArrayLike,
    steps: int,
    *,
    start: tuple[float, float] = (0.0, 0.0),
    velocity: float = 1.0,
    repeat: bool = True,
) -> NDArray[np.float64]:
    """Return the positions (cells) of the paper's robot after each time step, float64[steps, 2]."""
    points = np.asarray(waypoints, dtype=np.float64).reshape(-1, 2).tolist()
    places = np.empty((steps, 2))
    x, y = start
    index = 0
    for step in range(steps):
        if index < len(points):
            tx, ty = points[index]
            dx, dy = tx - x, ty - y
            distance = math.hypot(dx, dy)
            if distance <= velocity:
                x, y = tx, ty
                index += 1
                if repeat and index == len(points):
                    index = 0
            else:
                x += velocity * dx / distance
                y += velocity * dy / distance
        places[step] = x, y
    return places
