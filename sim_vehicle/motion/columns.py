"""What all compiled vehicles share: columns of state and counters, events, the grid of wind and track."""

from __future__ import annotations

# State, float64: position 0-2, velocity 3-5, acceleration 6-8 (east, north, up), heading and its rate, energy
# used (J), path length, power (W), step at which the leg is given up (infinity: a new leg), wind, and the
# position that the nose points at (NaN: none).
POSITION, VELOCITY, ACCELERATION = 0, 3, 6
HEADING, YAW_RATE, ENERGY_USED, PATH, POWER, GIVE_UP_STEP, WIND_EAST, WIND_NORTH, LOOK_EAST, LOOK_NORTH = (
    range(9, 19)
)
STATE = 19
# Counters, int64: steps flown, leg, step of the last motion, whether the end was reached, whether nearness
# was told, and points of the track.
STEP, LEG, MOVED_STEP, ARRIVED, NEAR_TOLD, TRACK_POINTS = range(6)
COUNTERS = 6
# Why a kernel returns; WIND: its block of the wind is used up.
RAN, REACHED, WIND, STALLED, ENERGY, NEAR = range(6)
# Steps from one value of the wind, and possible point of the track, to the next.
GRID = 5
