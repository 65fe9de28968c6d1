"""What all compiled vehicles share: columns of state and counters, events, the grid of wind and track."""

from __future__ import annotations

from enum import IntEnum

from sim_vehicle.motion.records import record_type

# State, float64; positions, velocities and accelerations are east, north, up.
State = IntEnum(
    "State",
    "POSITION_X POSITION_Y POSITION_Z VELOCITY_X VELOCITY_Y VELOCITY_Z ACCELERATION_X ACCELERATION_Y "
    "ACCELERATION_Z HEADING "
    "HEADING_RATE "  # Clockwise.
    "ENERGY_USED "  # J.
    "PATH_LENGTH "
    "POWER "  # W.
    "GIVE_UP_STEP "  # Step at which the leg is given up; infinity: a new leg.
    "WIND_EAST WIND_NORTH "
    "LOOK_EAST LOOK_NORTH",  # Position that the nose points at; NaN: none.
    start=0,
)
STATE = record_type(State)
# What is several numbers.
POSITION, VELOCITY, ACCELERATION = slice(0, 3), slice(3, 6), slice(6, 9)
LEVEL_WIND = slice(State.WIND_EAST, State.WIND_NORTH + 1)
LOOK = slice(State.LOOK_EAST, State.LOOK_NORTH + 1)
# Counters, int64.
(
    STEP,  # Steps flown.
    LEG_INDEX,
    MOVED_STEP,  # Step of the last motion.
    ARRIVED,  # Whether the end was reached.
    NEAR_TOLD,  # Whether nearness was told.
    TRACK_POINTS,  # Points of the track.
) = range(6)
COUNTERS = 6
# Why a kernel returns; WIND: its block of the wind is used up.
RAN, REACHED, WIND, STALLED, ENERGY, NEAR = range(6)
# Steps from one value of the wind, and possible point of the track, to the next.
GRID = 5
