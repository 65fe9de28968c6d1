"""The power model of rotorcraft, compiled for the motion kernels."""

from __future__ import annotations

from geo.compiled import compiled
from sim_vehicle.energy import power

__all__ = ["multirotor_power"]

multirotor_power = compiled(allocates=False)(power.multirotor_power)
