"""Compiled functions of the wind: gusts from noise, and the wind at a height.

A row of a wind block (`sim_vehicle.weather.atmosphere`) holds all numbers of the wind at one instant, so that
a kernel needs no other input.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from geo.texts import FOOT_M
from sim_vehicle.weather.atmosphere import (
    AIR_EAST,
    AIR_NORTH,
    AIR_UP,
    CONSTANT,
    DECAY,
    HAS_DRYDEN,
    HIGHEST_M,
    LEAK,
    LOGARITHMIC,
    LOWEST_M,
    MEAN_EAST,
    MEAN_NORTH,
    NOISE_FIRST,
    NOISE_MIXED,
    NOISE_SECOND,
    POWER,
    REFERENCE_HEIGHT,
    SHEAR_LAW,
    SHEAR_NUMBER,
    SQUARE_ROOT,
)

Floats = NDArray[np.float64]

LOWEST_GUST_M = 10.0 * FOOT_M
"""Lowest height of MIL-F-8785C's turbulence; below it the vertical gust decreases to 0 at the ground."""


@compiled(allocates=False)
def wind_at(row: Floats, height_m: float) -> tuple[float, float, float]:
    """Return the wind (east, north, up; m/s) at a height above the ground.

    Parameters
    ----------
    row : float64[9]
        Row of a wind block.

    Notes
    -----
    The mean wind follows its law between 3 and 1000 ft; ArduPilot's law already holds from the ground up.
    Dryden's horizontal gusts have the intensity of MIL-F-8785C at `height_m`. Above 10 ft, Dryden's vertical
    gusts do not depend on the height.
    """
    law = row[SHEAR_LAW]
    if law == CONSTANT and row[HAS_DRYDEN] == 0.0:
        return row[AIR_EAST], row[AIR_NORTH], row[AIR_UP]
    mean = 1.0
    height = min(max(height_m, LOWEST_M), HIGHEST_M)
    if law == LOGARITHMIC:
        mean = log(height / row[SHEAR_NUMBER]) / log(row[REFERENCE_HEIGHT] / row[SHEAR_NUMBER])
    elif law == POWER:
        mean = (height / row[REFERENCE_HEIGHT]) ** row[SHEAR_NUMBER]
    elif law == SQUARE_ROOT:
        mean = sqrt(min(max(height_m, 0.0), row[SHEAR_NUMBER]) / row[SHEAR_NUMBER])
    side, rise = 1.0, 1.0
    if row[HAS_DRYDEN] != 0.0:
        height = min(max(height_m, LOWEST_GUST_M), HIGHEST_M)
        reference = min(max(row[REFERENCE_HEIGHT], LOWEST_GUST_M), HIGHEST_M)
        side = (reference_term(reference) / reference_term(height)) ** 0.4
        if height_m < LOWEST_GUST_M:
            rise = max(height_m, 0.0) / LOWEST_GUST_M
    return (
        row[MEAN_EAST] * mean + (row[AIR_EAST] - row[MEAN_EAST]) * side,
        row[MEAN_NORTH] * mean + (row[AIR_NORTH] - row[MEAN_NORTH]) * side,
        row[AIR_UP] * rise,
    )


@compiled(inline="always", allocates=False)
def reference_term(height_m: float) -> float:
    """Return the term of MIL-F-8785C's length scales and intensities that contains the height."""
    return 0.177 + 0.000823 * height_m / FOOT_M


@compiled
def gauss_markov(noise: Floats, decay: float, last: Floats) -> Floats:
    """Return the values of the first-order recursion ``g[i] = decay g[i-1] + noise[i]``, float64[n, 2]."""
    series = np.empty_like(noise)
    for k in range(2):
        value = last[k]
        for i in range(noise.shape[0]):
            value = decay * value + noise[i, k]
            series[i, k] = value
    return series


@compiled
def forming_filters(noise: Floats, filters: Floats, state: Floats) -> Floats:
    """Return gusts of unit intensity (along, across, up) from white noise.

    Parameters
    ----------
    noise : float64[n, 5]
        Independent standard normal numbers.
    filters : float64[3, 5]
        Filters along, across and up, with the columns of `sim_vehicle.weather.atmosphere`.
    state : float64[5]
        State of the filters, changed in place: 1 number along, 2 across and 2 up.

    Returns
    -------
    float64[n, 3]
    """
    gust = np.empty((noise.shape[0], 3))
    direct = sqrt(1.5)
    delayed = (1.0 - sqrt(3.0)) / sqrt(2.0)
    for i in range(noise.shape[0]):
        state[0] = filters[0, DECAY] * state[0] + filters[0, NOISE_FIRST] * noise[i, 0]
        gust[i, 0] = state[0]
        for k in range(1, 3):
            at = 2 * k - 1
            decay, leak = filters[k, DECAY], filters[k, LEAK]
            first, second = state[at], state[at + 1]
            state[at] = decay * first + filters[k, NOISE_FIRST] * noise[i, at]
            state[at + 1] = (
                decay * second
                + leak * first
                + filters[k, NOISE_MIXED] * noise[i, at]
                + filters[k, NOISE_SECOND] * noise[i, at + 1]
            )
            gust[i, k] = direct * state[at] + delayed * state[at + 1]
    return gust
