"""The power models, compiled for the motion kernels."""

from __future__ import annotations

from numba import njit

from sim_vehicle.energy import power

__all__ = ["multirotor_power", "rover_power", "wing_power"]

multirotor_power = njit(cache=True)(power.multirotor_power)
wing_power = njit(cache=True)(power.wing_power)
rover_power = njit(cache=True)(power.rover_power)
