"""Rows of numbers with named columns, for compiled code and its callers.

The columns of a row are an `IntEnum`. Code for whole arrays uses the members as indices. A kernel receives
the row as a record with one attribute per column, such as ``state.position_x``, because a record is passed as
one pointer but an array as seven numbers, and because a named column compiles twice as fast as an index.

The module defines the columns that all compiled vehicles share, the events, and the grid of wind and track.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

Record = Any
"""Row of numbers for a kernel; its attributes are the columns in lower case."""


def record_type(*columns: type[IntEnum] | list[str]) -> np.dtype[Any]:
    """Return the record type of a row with these columns in this order.

    Examples
    --------
    >>> record_type(IntEnum("Leg", ["LEFT_M", "HEADING"], start=0)).names
    ('left_m', 'heading')
    """
    names = [name if isinstance(name, str) else name.name.lower() for group in columns for name in group]
    return np.dtype((np.record, [(name, np.float64) for name in names]), align=True)


def row_of(kind: np.dtype[Any], values: Mapping[str, float]) -> NDArray[np.float64]:
    """Return a row of this record type with values by column, and 0 in the other columns.

    Examples
    --------
    >>> row_of(record_type(["left_m", "heading"]), {"heading": 2.0})
    array([0., 2.])
    """
    row = np.zeros(1, kind)
    for name, value in values.items():
        row[name] = value
    return row.view(np.float64)


def record_of(row: NDArray[np.float64], kind: np.dtype[Any]) -> Record:
    """Return a record that shares the memory of a row, float64[n]."""
    return row.view(kind)[0]


def records_of(rows: NDArray[np.float64], kind: np.dtype[Any]) -> NDArray[Any]:
    """Return an array of records that shares the memory of rows, float64[..., n]."""
    return rows.view(kind)[..., 0]


# The state is float64; its vectors are east, north, up.
State = IntEnum(
    "State",
    "POSITION_X POSITION_Y POSITION_Z VELOCITY_X VELOCITY_Y VELOCITY_Z ACCELERATION_X ACCELERATION_Y "
    "ACCELERATION_Z HEADING "
    "HEADING_RATE "  # Rate of the heading, clockwise.
    "ENERGY_USED "  # J.
    "PATH_LENGTH "
    "POWER "  # W.
    "GIVE_UP_STEP "  # Step at which the leg counts as stalled; infinity for a new leg.
    "WIND_EAST WIND_NORTH "
    "LOOK_EAST LOOK_NORTH",  # Region of interest; NaN without one.
    start=0,
)
STATE = record_type(State)
# Slices of the vector quantities.
POSITION, VELOCITY, ACCELERATION = slice(0, 3), slice(3, 6), slice(6, 9)
LEVEL_WIND = slice(State.WIND_EAST, State.WIND_NORTH + 1)
LOOK = slice(State.LOOK_EAST, State.LOOK_NORTH + 1)
# The counters are int64.
(
    STEP,  # Steps flown.
    LEG_INDEX,
    MOVED_STEP,  # Step at which the vehicle last moved.
    ARRIVED,  # Whether the vehicle has reached the end of the route.
    NEAR_SENT,  # Whether NEAR was returned on this leg.
    TRACK_POINTS,  # Number of points in the track.
) = range(6)
COUNTERS = 6
# Reasons why a kernel returns; WIND means that the kernel needs the next wind block.
RAN, REACHED, WIND, STALLED, ENERGY, NEAR = range(6)
# Number of steps between two points of the grid on which wind values and track points lie.
GRID = 5
